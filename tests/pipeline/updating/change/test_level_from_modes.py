"""A water level that nothing reports is read off the modes that it moves."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.change.detector import ChangeDetector, ChangeState, apart_from_water
from pipeline.updating.change.level_from_modes import LastLevel, with_level_from_modes
from pipeline.updating.change.sufficient_statistics import Sensitivities, seen_in
from tests.pipeline.updating.change.streams import SENSITIVITIES, STDS, WINDOW, level_at, window_of

WATER = np.array([[0.001, 0.0], [0.012, 0.002], [-0.004, 0.0], [0.015, -0.003], [0.0, 0.0]])
KNOWN = replace(SENSITIVITIES, water=WATER, level_std=1.0)


def unreported(number, generator, *, shift=0.0, amplitude=1.0):
    """A window whose frequencies the tide moves, and nobody reports it."""
    level = level_at(number, amplitude)
    moved = shift + WATER[:, 0] * level + WATER[:, 1] * level**2
    return replace(window_of(number, generator, shift=moved), level_std=1.0)


def level_of(window, state):
    """Of the water, from the window's modes [m]."""
    seen = seen_in(state.sums, window)
    found = with_level_from_modes(window, state.sums, seen, WATER, state.last_level)
    return found.water_level


def first(known, n):
    return replace(known, stiffness=known.stiffness[:n], water=known.water[:n])


def watched(n, *, seed, step=None, at=0, level_std=1.0):
    """State after n windows, and the first alarm's window."""
    detector, generator, state = ChangeDetector(), np.random.default_rng(seed), ChangeState()
    known = replace(KNOWN, level_std=level_std)
    for number in range(n):
        shift = step if step is not None and number >= at else 0.0
        window = replace(unreported(number, generator, shift=shift), level_std=level_std)
        state = detector.updated(state, window, first(known, len(state.sums.tracks)))
        if number and detector.verdict(state, known, window_duration=WINDOW).alarm:
            return state, number
    return state, None


def test_levels_of_a_tide_come_out_to_some_centimetres():
    generator, state, detector = np.random.default_rng(31), ChangeState(), ChangeDetector()
    found = []
    for number in range(75):
        window = unreported(number, generator)
        if number:
            found.append(level_of(window, state))
        state = detector.updated(state, window, first(KNOWN, len(state.sums.tracks)))
    errors = np.array(found) - [level_at(number) for number in range(1, 75)]
    bound = np.sum(WATER[:, 0] ** 2 / STDS**2) ** -0.5  # of one window, the line known [m]
    assert errors.std() < 1.5 * bound
    assert abs(errors.mean()) < 3 * bound  # the first window's own errors stay in the intercepts


def test_one_mode_taken_for_another_does_not_move_the_level():
    generator, state, detector = np.random.default_rng(32), ChangeState(), ChangeDetector()
    for number in range(30):
        window = unreported(number, generator)
        state = detector.updated(state, window, first(KNOWN, len(state.sums.tracks)))
    window = unreported(30, generator)
    wild = replace(window.seen[1], log_frequency=window.seen[1].log_frequency + 0.03)
    wrong = replace(window, seen=(window.seen[0], wild, *window.seen[2:]))
    assert level_of(wrong, state) == pytest.approx(level_of(window, state), abs=0.2)  # of .9 by
    # plain least squares; only two of these modes say much about the level


@pytest.mark.parametrize("seed", range(41, 45))
def test_a_tide_that_nothing_reports_is_no_change(seed):
    assert watched(150, seed=seed)[1] is None
    assert watched(150, seed=seed, level_std=0.0)[1] is not None  # as if it stood still


@pytest.mark.parametrize("seed", [51, 52])
def test_a_change_of_the_springs_shows_beside_it(seed):
    step = SENSITIVITIES.stiffness @ [-0.05, -0.05, -0.05]
    state, alarm = watched(80, seed=seed, step=step, at=60)
    assert alarm is not None
    assert 60 <= alarm <= 66
    detector = ChangeDetector()
    verdict = detector.verdict(state, KNOWN, window_duration=WINDOW)
    found = detector.change(state, verdict, KNOWN)
    errors = found.step.ratios + 0.05
    assert np.abs(errors / np.sqrt(np.diag(found.step.covariance))).max() < 3


def test_what_a_rise_of_the_water_would_do_as_well_is_no_evidence_of_a_change():
    state, _ = watched(40, seed=61)
    seen = apart_from_water(KNOWN, state.sums)
    information = state.sums.totals[0]
    shared = (WATER[:, 0] * information) @ seen.stiffness
    before = (WATER[:, 0] * information) @ KNOWN.stiffness
    assert np.abs(shared).max() < 1e-3 * np.abs(before).max()
    alike = Sensitivities(WATER[:, :1] * [1.0, 0.5, 0.0], WATER, level_std=1.0)
    assert np.abs(apart_from_water(alike, state.sums).stiffness).max() < 1e-5


def test_a_level_can_move_as_the_tide_does_and_no_further():
    last, hour = LastLevel(0.3, 10**18), 3600 * 10**9
    assert last.mobility(10**18 + hour // 6, 1.0) == pytest.approx(0.084, abs=0.001)
    assert last.mobility(10**18 + 7 * hour, 1.0) == last.mobility(10**18 + 9000 * hour, 1.0) == 2.0
    assert LastLevel().mobility(10**18, 0.7) == 0.7


def test_reported_levels_leave_everything_as_it_is():
    state, _ = watched(5, seed=62)
    known = replace(KNOWN, level_std=0.0)
    assert apart_from_water(known, state.sums) is known


def test_modes_that_scatter_more_than_they_state_move_the_level_less():
    state, _ = watched(12, seed=33)
    last = state.last_level
    window = unreported(12, np.random.default_rng(8))
    moved = []
    for factor in (1.0, 9.0):
        scatter = np.array([[factor * 1e4], [1e4]]) * np.ones((2, len(state.sums.tracks)))
        scattered = replace(state, sums=replace(state.sums, scatter=scatter))
        moved.append(abs(level_of(window, scattered) - last.level))
    assert moved[1] < 0.99 * moved[0]
