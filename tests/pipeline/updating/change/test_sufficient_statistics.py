"""The sums against what they are sums of."""

import numpy as np
import pytest

from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.likelihood_ratios import (
    SHIFTS,
    STIFFNESS_SHIFTS,
    log_drift,
    log_foundation,
    log_step,
)
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import (
    SLOPE_STD,
    UNCUT_MOMENTS,
    WIND_STD,
    Regression,
    SeenFrequency,
    Sensitivities,
    WatchedWindow,
    steps,
    with_tracks_only,
)
from tests.pipeline.updating.change.streams import STDS, STILL, WINDOW, known_of, run, window_of

N = 12  # windows
BEGUN = 8  # the first after the change


def streamed(levels, values, stds, water=(0.0, 0.0), winds=None):
    """State after windows of some modes: levels (n,), values (n, J), stds (J,), winds (n,)."""
    detector, state = ChangeDetector(), ChangeState()
    n_modes = len(stds)
    known = Sensitivities(np.zeros((n_modes, 3)), np.tile(water, (n_modes, 1)))
    winds = np.zeros(len(levels)) if winds is None else winds
    for number, (level, row, wind) in enumerate(zip(levels, values, winds, strict=True)):
        seen = tuple(SeenFrequency(j, float(row[j]), float(stds[j])) for j in range(n_modes))
        window = WatchedWindow(
            int(number * 6e11), WINDOW, seen, water_level=float(level), wind=float(wind)
        )
        state = detector.updated(state, window, known)
    return state


def log_density(values, covariance):
    _, logdet = np.linalg.slogdet(covariance)
    return -0.5 * (logdet + values @ np.linalg.solve(covariance, values))


def written_out(seed, n_modes):
    """Values of windows under tide and wind, and each mode's covariance while nothing changes."""
    generator = np.random.default_rng(seed)
    levels = generator.uniform(-1, 1, N)
    stds = np.array([0.001, 0.002, 0.0015])[:n_modes]
    winds = generator.uniform(-5, 15, N)
    moved = (0.004 * levels + 0.0002 * winds)[:, None]
    values = moved + stds * generator.standard_normal((N, n_modes))
    state = streamed(levels, values, stds, winds=winds)
    factors = state.sums.scatter_factor
    slopes = SLOPE_STD**2 * np.outer(levels, levels) + WIND_STD**2 * np.outer(winds, winds)
    still = [
        factors[j] * (stds[j] ** 2 * np.eye(N) + 1e3**2 * np.ones((N, N)) + slopes)
        for j in range(n_modes)
    ]
    return state, values - values[0], still


AFTER = (np.arange(N) >= BEGUN).astype(float)
NO_WATER = np.zeros((3, 2))


def test_the_likelihood_ratio_of_a_step_is_that_of_the_gaussians_written_out():
    """p(y | step at the eighth window) / p(y), under a flat mean and slopes of level and wind, all
    in units of the scatter learned."""
    state, values, still = written_out(1, 1)
    found = steps(state.sums, NO_WATER[:1], UNCUT_MOMENTS)
    for variance, ratio in zip(SHIFTS**2, log_step(found.g, found.h, SHIFTS**2), strict=True):
        stepped = still[0] + variance * np.outer(AFTER, AFTER)
        exact = log_density(values[:, 0], stepped) - log_density(values[:, 0], still[0])
        assert ratio[BEGUN, 0] == pytest.approx(exact, abs=5e-4)


def test_the_foundations_likelihood_ratio_is_that_of_all_modes_together():
    """Three modes and three springs as one Gaussian vector of 36 numbers."""
    state, values, still = written_out(2, 3)
    S = np.array([[0.1, 0.02, 0.05], [0.0, 0.1, 0.02], [0.08, 0.0, 0.1]])
    stacked = values.T.ravel()
    block = np.zeros((3 * N, 3 * N))
    for j in range(3):
        block[j * N : (j + 1) * N, j * N : (j + 1) * N] = still[j]
    ratios = []
    for size in STIFFNESS_SHIFTS:
        moved = block + size**2 * np.kron(S @ S.T, np.outer(AFTER, AFTER))
        ratios.append(log_density(stacked, moved) - log_density(stacked, block))
    exact = np.log(np.mean(np.exp(ratios)))
    found = log_foundation(steps(state.sums, NO_WATER, UNCUT_MOMENTS), S)
    assert found[BEGUN] == pytest.approx(exact, abs=5e-4)


def test_a_drift_of_every_mode_is_the_product_of_their_steps_and_of_one_mode_its_own():
    state, *_ = written_out(3, 3)
    found = steps(state.sums, NO_WATER)
    each = np.exp(log_step(found.g, found.h, SHIFTS**2))
    products = [np.prod(1 - p + p * each, axis=2) for p in (1.0, 1 / 3, 0.25)]
    assert np.exp(log_drift(found)) == pytest.approx(np.mean(products, axis=(0, 1)), rel=1e-9)


def test_what_the_model_says_of_the_water_is_taken_out_whenever_it_becomes_known():
    """Frequencies on a parabola of the level that the model knows: nothing is left to regress."""
    levels = np.linspace(-1.5, 1.5, 20)
    stds = np.array([1e-4, 1e-4])
    water = np.array([[-0.005, -0.0008], [-0.002, 0.0001]])
    values = np.outer(levels, water[:, 0]) + np.outer(levels**2, water[:, 1])
    state = streamed(levels, values, stds)
    line = Regression.of(state.sums.totals, water)
    assert line.coefficients[1] == pytest.approx(0.0, abs=1e-12)
    expected = -values[0]  # y counts from the first window's value
    assert line.coefficients[0] == pytest.approx(expected, abs=1e-9)
    unaware = Regression.of(state.sums.totals, np.zeros((2, 2)))
    assert unaware.coefficients[1] == pytest.approx(water[:, 0], rel=0.01)


def test_scatter_above_the_stated_deviation_is_learned_and_no_change():
    generator = np.random.default_rng(7)
    wild = [0.003 * generator.standard_normal(len(STDS)) for _ in range(250)]
    state, _, alarm = run(wild, seed=8)
    assert alarm is None
    assert state.sums.scatter_factor.min() > 2


def test_the_sums_stay_the_same_size_for_years_and_forget_no_window():
    state, *_ = run([STILL] * 300, seed=9)
    assert len(state.sums.starts_ns) == ChangeSettings().candidates
    assert state.sums.shares.sum() == pytest.approx(300)
    assert state.sums.starts_ns == tuple(sorted(state.sums.starts_ns))
    assert state.sums.totals[0] == pytest.approx(300 / STDS**2)


def test_thinning_candidates_leaves_the_steps_of_the_others_as_they_were():
    few = ChangeDetector(ChangeSettings(candidates=10))
    many, all_kept, thinned = ChangeDetector(), ChangeState(), ChangeState()
    generator = np.random.default_rng(14)
    for number in range(30):
        window = window_of(number, generator)
        all_kept = many.updated(all_kept, window, known_of(all_kept))
        thinned = few.updated(thinned, window, known_of(thinned))
    rows = [all_kept.sums.starts_ns.index(start) for start in thinned.sums.starts_ns]
    water = np.zeros((len(STDS), 2))
    expected, found = steps(all_kept.sums, water), steps(thinned.sums, water)
    assert len(rows) == 10
    assert found.g == pytest.approx(expected.g[rows], rel=1e-6, abs=1e-3)
    assert found.h == pytest.approx(expected.h[rows], rel=1e-6, abs=1e-3)


def test_a_track_that_is_forgotten_takes_its_column_along():
    state, *_ = run([STILL] * 5, seed=15)
    kept = with_tracks_only(state.sums, [0, 3])
    assert kept.tracks == (0, 3)
    assert np.array_equal(kept.segments, state.sums.segments[:, :, [0, 3]])


def test_old_candidates_lie_no_further_apart_than_a_part_of_their_age():
    """32 candidates on 300 windows: a change is dated to a third of its age."""
    state, *_ = run([STILL] * 300, seed=9)
    starts = np.array(state.sums.starts_ns) / 6e11
    gaps, ages = np.diff(starts)[:-1], starts[-1] - starts[1:-1]
    assert gaps[-6:] == pytest.approx(1.0)
    assert np.all(gaps <= np.maximum(1.0, 0.3 * ages))


def test_what_the_wind_does_to_a_mode_is_learned_and_no_change():
    """A storm rises and calms down, and one mode follows it by .3 %; untold, it is news."""
    generator = np.random.default_rng(16)
    winds = 16 * np.sin(np.pi * np.arange(120) / 120) ** 2 - 5
    stds = np.array([0.0008, 0.001, 0.002])
    follows = 0.0002 * winds[:, None] * [1.0, 0.0, 0.0]
    values = follows + stds * generator.standard_normal((120, 3))
    largest = []
    for told in (winds, None):
        state = streamed(np.zeros(120), values, stds, winds=told)
        found = log_drift(steps(state.sums, np.zeros((3, 2))))
        largest.append(found.max())
    known, unknown = largest
    assert known < 2
    assert unknown > 10
    line = Regression.of(streamed(np.zeros(120), values, stds, winds=winds).sums.totals, NO_WATER)
    assert line.coefficients[2, 0] == pytest.approx(0.0002, abs=4 * 0.0008 / (5 * np.sqrt(120)))
