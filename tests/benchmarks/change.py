"""Changes found and false alarms, on modal estimates drawn with the errors a recording has.

    python -m tests.benchmarks change [--windows 22617] [--trials 200]

Frequencies, their standard deviations and how often each mode is found come from the shipped
recording of the parked turbine. Thresholds are the average time between false alarms, nothing else
is set:

    quiet       every frequency moves by ±.5 % with the water level, nothing changes
    shift       144 windows, modes 1 to 5 together shift by .2 % in the middle
    k22 drops   144 windows, 10 % of k22 gone in the middle, one false alarm in ten times 36 h
"""

import argparse
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.reader import read_messages
from pipeline.updating.change import (
    ChangeDetector,
    ChangeSettings,
    ChangeState,
    SeenFrequency,
    WatchedWindow,
)
from pipeline.updating.updater import FoundationUpdater
from sensors.layout import biaxial_layout
from sensors.turbine.description import load_turbine
from sensors.turbine.modal import ModalModel

FloatArray = NDArray[np.float64]

SEED = 20261121
WINDOW = 600.0  # [s]
TIDE = 12.42 * 3600.0  # [s]
RECORDING = Path("recordings/parked.mcap")
LAYOUT = biaxial_layout(
    "tower-1", turbine="iea15mw", unit="tower", elevations=(41.0, 80.0, 106.0, 145.0)
)


@dataclass(frozen=True, slots=True, eq=False)
class Watched:
    """The modes as the recording's windows report them."""

    labels: tuple[str, ...]
    log_frequencies: FloatArray  # (J,)
    stds: FloatArray  # (J,) relative, of one window
    presence: FloatArray  # (J,) share of the windows
    sensitivities: FloatArray  # (J, 3) ∂ ln f / ∂ ratio at nominal


def watched_modes() -> Watched:
    """Identified and paired from the shipped recording."""
    node = IdentificationNode()
    answers = [
        a for m in read_messages(RECORDING) if isinstance(m, node.inputs) for a in node.handle(m)
    ]
    estimates = [each for each in answers if isinstance(each, ModalEstimate)]
    model = ModalModel(load_turbine("iea15mw_monopile"), LAYOUT)
    updater = FoundationUpdater(model, LAYOUT, seed=1)
    state = updater.initial_state()
    for estimate in estimates[:-1]:
        state = replace(state, evidence=state.evidence.with_estimate(estimate))
    state, posterior = updater.updated(state, estimates[-1])
    by_name = {mode.name: mode for mode in state.evidence.modes}
    pairs = [pair for pair in posterior.pairs if by_name[pair.identified].n_windows > 1]
    modes = [by_name[pair.identified] for pair in pairs]
    columns = [model.labels.index(pair.model) for pair in pairs]
    points = 1 + 1e-4 * np.vstack([np.zeros(3), np.eye(3)])
    logs = np.log(model.modal(points * model.nominal).frequencies[:, columns])
    return Watched(
        labels=tuple(pair.model for pair in pairs),
        log_frequencies=np.log([mode.frequency for mode in modes]),
        stds=np.array([m.frequency_std / m.frequency * np.sqrt(m.n_windows) for m in modes]),
        presence=np.array([mode.n_windows for mode in modes]) / len(estimates),
        sensitivities=(logs[1:] - logs[0]).T / 1e-4,
    )


def window(
    number: int, watched: Watched, shift: FloatArray, generator: np.random.Generator, tide: float
) -> WatchedWindow:
    """One window's drawn estimates. tide: amplitude of ln f; its level has that of 1 m."""
    start = number * WINDOW
    level = float(np.sin(2 * np.pi * (start + WINDOW / 2) / TIDE))
    found = np.flatnonzero(generator.random(len(watched.stds)) < watched.presence)
    errors = watched.stds[found] * generator.standard_normal(len(found))
    logs = watched.log_frequencies[found] + shift[found] + tide * level + errors
    seen = tuple(
        SeenFrequency(int(track), float(value), float(watched.stds[track]))
        for track, value in zip(found, logs, strict=True)
    )
    return WatchedWindow(int(start * 1e9), WINDOW, seen, water_level=level)


def sensitivities_of(state: ChangeState, watched: Watched) -> FloatArray:
    """S in the order of the state's tracks."""
    return watched.sensitivities[list(state.tracks)]


def quiet(watched: Watched, n_windows: int) -> str:
    """Alarms in years without a change."""
    detector, generator = ChangeDetector(), np.random.default_rng(SEED)
    state, alarms, highest = detector.initial_state(), 0, 0.0
    begun = time.process_time()
    for number in range(n_windows):
        drawn = window(number, watched, np.zeros(len(watched.stds)), generator, 0.005)
        state = detector.updated(state, drawn)
        verdict = detector.verdict(state, sensitivities_of(state, watched), window_duration=WINDOW)
        highest = max(
            highest, verdict.drift / verdict.threshold, verdict.foundation / verdict.threshold
        )
        if verdict.alarm:
            alarms += 1
            state = detector.initial_state()
    seconds = (time.process_time() - begun) / n_windows
    return (
        f"quiet: {alarms} alarms in {n_windows} windows, largest R / A {highest:.3f}, "
        f"{1e3 * seconds:.2f} ms CPU a window (drawing included)"
    )


def delays(
    watched: Watched, shift: FloatArray, settings: ChangeSettings, trials: int
) -> tuple[list[int], int, list[str], list[FloatArray]]:
    """Windows from the change to the alarm, false alarms before it, kinds, changes of ratios."""
    detector = ChangeDetector(settings)
    found, false, kinds, changes = [], 0, [], []
    for trial in range(trials):
        generator = np.random.default_rng([SEED, trial])
        state = detector.initial_state()
        for number in range(144):
            shifted = shift if number >= 72 else np.zeros_like(shift)
            state = detector.updated(state, window(number, watched, shifted, generator, 0.005))
            S = sensitivities_of(state, watched)
            verdict = detector.verdict(state, S, window_duration=WINDOW)
            if verdict.alarm:
                change = detector.change(state, verdict, S)
                if number < 72:
                    false += 1
                    state = detector.restarted(state, change.restart)
                    continue
                found.append(number - 71)
                kinds.append(change.kind)
                changes.append(change.ratios)
                break
    return found, false, kinds, changes


def line(name: str, trials: int, found: list[int], false: int, kinds: list[str]) -> str:
    """One row of the table."""
    median, late = np.quantile(found, [0.5, 0.95]) if found else (np.nan, np.nan)
    called = kinds.count("foundation") / max(len(kinds), 1)
    return (
        f"{name}: {len(found)} of {trials} found, delay median {median:.0f} / 95 % {late:.0f} "
        f"windows, {false} false alarms before, called a foundation's change {called:.0%}"
    )


def main(arguments: list[str]) -> None:
    """Print the three rows."""
    parser = argparse.ArgumentParser(prog="change", description=__doc__)
    parser.add_argument("--windows", type=int, default=22_617)
    parser.add_argument("--trials", type=int, default=200)
    chosen = parser.parse_args(arguments)
    watched = watched_modes()
    print(
        f"{len(watched.labels)} modes, stds {100 * watched.stds.min():.3f} to "
        f"{100 * watched.stds.max():.3f} %"
    )
    shift = 0.002 * np.isin(watched.labels, ["1", "2", "3", "4", "5"])
    found, false, kinds, _ = delays(watched, shift, ChangeSettings(), chosen.trials)
    print(line("shift of modes 1 to 5 by .2 %", chosen.trials, found, false, kinds))
    settings = ChangeSettings(years_between_false_alarms=360 / 8766)
    drop = watched.sensitivities @ np.array([0.0, -0.1, 0.0])
    found, false, kinds, changes = delays(watched, drop, settings, chosen.trials)
    print(line("10 % of k22", chosen.trials, found, false, kinds))
    if changes:
        print(
            "   change of k11, k22, k12 found: median "
            + " ".join(f"{each:+.3f}" for each in np.median(changes, axis=0))
        )
    print(quiet(watched, chosen.windows))
