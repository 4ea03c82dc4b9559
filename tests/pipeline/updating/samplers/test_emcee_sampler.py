"""Chains against densities whose moments are known."""

import numpy as np
import pytest

from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.emcee_sampler import Chains, SamplerSettings, ensemble_chains

SETTINGS = SamplerSettings(effective_draws=3000)
MEAN = np.array([1.0, 2.0, -0.5])
FACTOR = np.array([[0.01, 0, 0], [0.018, 0.004, 0], [0.012, 0.003, 0.001]])  # correlations to .99


def gaussian(points):
    white = np.linalg.solve(FACTOR, (points - MEAN).T)
    return -0.5 * (white**2).sum(axis=0), np.zeros(len(points)) + points[:, 0]


def banana(points):
    """x ~ N(0, 1), y − x²/2 ~ N(0, .5²), z ~ N(0, 1)."""
    x, y, z = points.T
    return -0.5 * (x**2 + ((y - x**2 / 2) / 0.5) ** 2 + z**2), x


def around(mean, spread, seed):
    return mean + spread * np.random.default_rng(seed).standard_normal((40, 3))


def test_a_sharp_correlated_gaussian_is_recovered_in_mean_and_covariance():
    chains = ensemble_chains(gaussian, around(MEAN, 0.02, 1), SETTINGS, np.random.default_rng(1))
    covariance = FACTOR @ FACTOR.T
    draws = chains.flat[:, :3]
    assert chains.long_enough
    assert (draws.mean(axis=0) - MEAN) / np.sqrt(np.diag(covariance)) == pytest.approx(0, abs=0.08)
    assert np.cov(draws.T) / covariance == pytest.approx(1.0, abs=0.1)


def test_chains_of_a_gaussian_forget_within_a_few_steps():
    chains = ensemble_chains(gaussian, around(MEAN, 0.02, 2), SETTINGS, np.random.default_rng(2))
    assert chains.autocorrelation_time < 6
    assert chains.rhat < 1.05


def test_a_bent_density_keeps_its_moments():
    settings = SamplerSettings(effective_draws=2000, most_steps=1500)
    chains = ensemble_chains(
        banana, around(np.zeros(3), 0.5, 3), settings, np.random.default_rng(3)
    )
    x, y, z, _ = chains.flat.T
    assert np.std(x) == pytest.approx(1.0, abs=0.08)
    assert np.mean(y) == pytest.approx(0.5, abs=0.08)
    assert np.std(z) == pytest.approx(1.0, abs=0.08)


def test_a_density_with_an_edge_is_not_left_beyond_it():
    def half(points):
        value, companion = gaussian(points)
        return np.where(points[:, 0] > MEAN[0], value, -np.inf), companion

    start = around(MEAN, 0.0, 4) + np.abs(around(np.zeros(3), 0.01, 4))
    chains = ensemble_chains(half, start, SETTINGS, np.random.default_rng(4))
    assert chains.flat[:, 0].min() > MEAN[0]
    expected = MEAN[0] + 0.01 * np.sqrt(2 / np.pi)
    assert chains.flat[:, 0].mean() == pytest.approx(expected, abs=0.0008)


def test_the_companion_stays_with_its_point():
    chains = ensemble_chains(gaussian, around(MEAN, 0.02, 5), SETTINGS, np.random.default_rng(5))
    assert np.array_equal(chains.flat[:, 0], chains.flat[:, 3])


def test_the_same_generator_walks_the_same_chains_whatever_ran_before():
    start = around(MEAN, 0.02, 6)
    first = ensemble_chains(gaussian, start, SETTINGS, np.random.default_rng([7, 3]))
    np.random.seed(99)  # noqa: NPY002  # somebody else's use of the global state
    second = ensemble_chains(gaussian, start, SETTINGS, np.random.default_rng([7, 3]))
    assert np.array_equal(first.points, second.points)


def test_a_chain_that_is_too_short_says_so():
    settings = SamplerSettings(burn_in=5, block=10, most_steps=20)
    chains = ensemble_chains(gaussian, around(MEAN, 0.02, 8), settings, np.random.default_rng(8))
    assert not chains.long_enough
    assert len(chains.points) == 20


def test_an_odd_number_of_walkers_is_refused_with_it():
    with pytest.raises(UpdatingError, match="41"):
        SamplerSettings(walkers=41)


def test_the_ensemble_is_where_the_walkers_stand_at_the_end():
    points = np.arange(24.0).reshape(3, 4, 2)  # steps, walkers, dimensions
    chains = Chains(points, np.zeros((3, 4)), 1.0, 1.0, 1.0, True)
    assert chains.ensemble.tolist() == [[16, 17], [18, 19], [20, 21], [22, 23]]
    assert chains.flat[-4:, :2].tolist() == chains.ensemble.tolist()
