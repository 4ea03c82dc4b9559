"""Streams of drawn frequencies: five modes, three springs, windows of ten minutes."""

import numpy as np

from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.sufficient_statistics import (
    SeenFrequency,
    Sensitivities,
    WatchedWindow,
)

STDS = np.array([0.002, 0.001, 0.0008, 0.0015, 0.001])
SENSITIVITIES = Sensitivities(
    stiffness=np.array(
        [[0.05, 0.02, 0.0], [0.0, 0.1, 0.02], [0.08, 0.0, 0.1], [0.0, 0.05, 0.1], [0.0, 0.0, 0.0]]
    ),
    water=np.zeros((5, 2)),
)
WINDOW = 600.0  # [s]
TIDE = 74.5  # [windows]


def level_at(number, amplitude=1.0):
    """Of the water [m]."""
    return amplitude * np.sin(2 * np.pi * number / TIDE)


def window_of(number, generator, *, shift=0.0, level=0.0, slope=0.004, weight=1.0):
    """One window whose frequencies rise by `slope` a metre of water."""
    values = shift + slope * level + STDS * generator.standard_normal(len(STDS))
    seen = tuple(
        SeenFrequency(i, float(v), float(s))
        for i, (v, s) in enumerate(zip(values, STDS, strict=True))
    )
    return WatchedWindow(int(number * 6e11), WINDOW, seen, weight=weight, water_level=level)


def known_of(state):
    """The sensitivities of a state's tracks."""
    n = len(state.sums.tracks)
    return Sensitivities(SENSITIVITIES.stiffness[:n], SENSITIVITIES.water[:n])


def judged(shifts, *, seed):
    """The change as it is told after the last window, whenever the alarm was; and the state."""
    detector, generator, state = ChangeDetector(), np.random.default_rng(seed), ChangeState()
    for number, shift in enumerate(shifts):
        state = detector.updated(state, window_of(number, generator, shift=shift), known_of(state))
    verdict = detector.verdict(state, SENSITIVITIES, window_duration=WINDOW)
    return detector.change(state, verdict, SENSITIVITIES), state


def run(shifts, *, seed, settings=None, tide=0.0):
    """State, verdict and number of the first window with an alarm; None for none."""
    detector, generator = ChangeDetector(settings), np.random.default_rng(seed)
    state = ChangeState()
    for number, shift in enumerate(shifts):
        window = window_of(number, generator, shift=shift, level=level_at(number, tide))
        state = detector.updated(state, window, known_of(state))
        verdict = detector.verdict(state, SENSITIVITIES, window_duration=WINDOW)
        if verdict.alarm:
            return state, verdict, number
    return state, verdict, None


def stepped(n, at, shift):
    """Nothing until `at`, the shift from then on."""
    return [shift if number >= at else np.zeros(len(STDS)) for number in range(n)]


STILL = np.zeros(len(STDS))
