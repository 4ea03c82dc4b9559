"""A stiffness that wanders or rides with the water, against the whole Gaussian written out."""

import numpy as np
import pytest

from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.random_walk import (
    DRIFT_STEPS,
    RIDE_APART,
    RIDE_TOGETHER,
    RIDES,
    deviation,
)
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import (
    SeenFrequency,
    Sensitivities,
    WatchedWindow,
)
from tests.pipeline.updating.change.streams import (
    SENSITIVITIES,
    STDS,
    WINDOW,
    known_of,
    level_at,
    window_of,
)

S = SENSITIVITIES.stiffness


def followed(stiffness, *, seed, levels=None):
    """State after windows under the given changes of stiffness, (n, 3)."""
    detector, generator, state = ChangeDetector(), np.random.default_rng(seed), ChangeState()
    for number, change in enumerate(stiffness):
        level = 0.0 if levels is None else levels[number]
        window = window_of(number, generator, shift=S @ change, level=level, slope=0.0)
        state = detector.updated(state, window, known_of(state))
    return state


def written_out(values, levels, step, rides):
    """Mean and covariance of x_n − x̄ given all values, (n, J), by one Gaussian of all windows.

    Each mode's mean is unknown; x is a walk from zero and α times the level.
    """
    n, n_modes = values.shape
    ride = (RIDE_TOGETHER**2 * np.ones((3, 3)) + RIDE_APART**2 * np.eye(3)) * rides
    walked = step**2 * np.minimum.outer(np.arange(n), np.arange(n))
    x = np.kron(walked, np.eye(3)) + np.kron(np.outer(levels, levels), ride)  # of x, (3n, 3n)
    seen = np.kron(np.eye(n), S)  # (nJ, 3n)
    noise = np.kron(np.eye(n), np.diag(STDS**2)) + 1e2 * np.kron(np.ones((n, n)), np.eye(n_modes))
    wanted = np.kron(np.eye(n)[-1] - 1 / n, np.eye(3))  # x_n − x̄
    gain = wanted @ x @ seen.T @ np.linalg.inv(seen @ x @ seen.T + noise)
    return gain @ values.ravel(), wanted @ x @ wanted.T - gain @ seen @ x @ wanted.T


@pytest.mark.parametrize("answer", range(len(DRIFT_STEPS)))
def test_the_filter_of_six_numbers_is_the_gaussian_of_all_windows(answer):
    """Nine windows under half a tide, each with all modes; no scatter is learned, no error cut."""
    generator = np.random.default_rng(21)
    levels = 1.5 * np.sin(np.arange(9) / 3)
    values = STDS * generator.standard_normal((9, len(STDS))) + 0.002 * levels[:, None] * S.sum(1)
    detector, state = ChangeDetector(), ChangeState()
    for number, (row, level) in enumerate(zip(values, levels, strict=True)):
        seen = tuple(SeenFrequency(j, float(v), float(STDS[j])) for j, v in enumerate(row))
        window = WatchedWindow(int(number * 6e11), WINDOW, seen, water_level=float(level))
        state = detector.updated(state, window, known_of(state))
        state.sums.scatter[:] = 0.0
    mean, covariance = written_out(values, levels, DRIFT_STEPS[answer], RIDES[answer])
    found = deviation(state.walk)
    assert found.means[answer] == pytest.approx(mean, abs=2e-6)
    assert found.covariances[answer] == pytest.approx(covariance, abs=1e-8)


def test_windows_that_share_a_candidate_count_each_for_itself():
    """Thirty windows of which eight candidates stay: the filter is still the Gaussian of all."""
    generator, n = np.random.default_rng(29), 30
    levels = 1.5 * np.sin(np.arange(n) / 3)
    values = STDS * generator.standard_normal((n, len(STDS)))
    detector, state = ChangeDetector(ChangeSettings(candidates=8)), ChangeState()
    for number, (row, level) in enumerate(zip(values, levels, strict=True)):
        seen = tuple(SeenFrequency(j, float(v), float(STDS[j])) for j, v in enumerate(row))
        window = WatchedWindow(int(number * 6e11), WINDOW, seen, water_level=float(level))
        state = detector.updated(state, window, known_of(state))
        state.sums.scatter[:] = 0.0
    assert len(state.sums.starts_ns) == 8
    answer = len(DRIFT_STEPS) - 1
    mean, covariance = written_out(values, levels, DRIFT_STEPS[answer], RIDES[answer])
    found = deviation(state.walk)
    assert found.means[answer] == pytest.approx(mean, abs=1e-4)
    assert found.covariances[answer] == pytest.approx(covariance, abs=0.01 * covariance.max())


def test_a_foundation_that_stays_adds_next_to_nothing():
    state = followed(np.zeros((72, 3)), seed=22)
    found = deviation(state.walk)
    assert found.weights[DRIFT_STEPS == 0].sum() > 0.5
    assert np.sqrt(np.diag(found.covariance)).max() < 0.006
    assert np.abs(found.mean).max() < 0.003


def test_a_foundation_that_softens_slowly_is_followed():
    lost = -0.2 * np.clip((np.arange(120) - 60) / 60, 0, 1)
    stiffness = np.outer(lost, [0.0, 1.0, 0.0])
    found = deviation(followed(stiffness, seed=23).walk)
    wanted = lost[-1] - lost.mean()
    std = np.sqrt(np.diag(found.covariance))
    assert found.weights[DRIFT_STEPS == 0].sum() < 0.01
    assert abs(found.mean[1] - wanted) < 3 * std[1]
    assert abs(found.mean[0]) < 3 * std[0]
    assert std[1] < 0.05


def test_springs_that_ride_with_the_tide_are_known_at_high_and_low_water():
    """Two tides of ±1.5 m, all springs ±2 % in phase; the deviation at the last window, which is
    at a quarter of the tide, of twelve streams."""
    levels = level_at(np.arange(168), 1.5)
    truth = np.outer(0.02 * levels / 1.5, np.ones(3))
    inside = []
    for seed in range(12):
        found = deviation(followed(truth, seed=[24, seed], levels=levels).walk)
        wanted = truth[-1] - truth.mean(axis=0)
        assert found.weights[RIDES].sum() > 0.8
        inside.append(
            np.abs(found.mean - wanted) < 1.645 * np.sqrt(np.diag(found.covariance)) + 1e-9
        )
    assert np.mean(inside) > 0.75


def test_draws_have_the_moments_of_the_mixture():
    state = followed(np.cumsum(np.full((40, 3), 0.0005), axis=0), seed=25)
    found = deviation(state.walk)
    drawn = found.draws(40_000, np.random.default_rng(26))
    spread = np.sqrt(np.diag(found.covariance))
    assert (drawn.mean(axis=0) - found.mean) / spread == pytest.approx(0, abs=0.03)
    assert np.cov(drawn.T) == pytest.approx(found.covariance, abs=0.06 * spread.max() ** 2)


def test_before_anything_is_known_there_is_no_deviation():
    state = ChangeDetector().updated(ChangeState(), window_of(0, np.random.default_rng(27)))
    found = deviation(state.walk)
    assert np.all(found.means == 0)
    assert np.abs(found.covariances).max() < 1e-3


def test_tracks_without_a_partner_in_the_model_say_nothing_of_a_walk():
    detector, generator, state = ChangeDetector(), np.random.default_rng(28), ChangeState()
    unknown = Sensitivities.unknown(len(STDS))
    for number in range(20):
        state = detector.updated(state, window_of(number, generator, shift=0.01 * number), unknown)
    assert np.all(state.walk.means == 0)
