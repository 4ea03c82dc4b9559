"""The mixture as a density, as a source of draws, and fitted to weighted points."""

import numpy as np
import pytest
from scipy.stats import multivariate_normal, multivariate_t

from pipeline.updating.samplers.student_t import (
    StudentMixture,
    fitted_mixture,
    kish_size,
    mixed,
    weighted_moments,
)

SCALE = np.array([[2.0, 0.9], [0.9, 0.5]])
ONE = StudentMixture.single(np.array([1.0, -1.0]), SCALE)
OTHER = StudentMixture.single(np.array([-40.0, 4.0]), np.eye(2) * 0.25)


def test_one_component_has_the_density_that_scipy_gives_a_multivariate_t():
    points = np.random.default_rng(1).normal(size=(50, 2)) * 3
    expected = multivariate_t(ONE.means[0], SCALE, df=ONE.degrees).logpdf(points)
    assert ONE.log_density(points) == pytest.approx(expected, abs=1e-10)


def test_a_mixture_is_the_weighted_sum_of_its_parts():
    points = np.random.default_rng(2).normal(size=(50, 2)) * 5
    both = mixed((3.0, ONE), (1.0, OTHER))
    expected = 0.75 * np.exp(ONE.log_density(points)) + 0.25 * np.exp(OTHER.log_density(points))
    assert np.exp(both.log_density(points)) == pytest.approx(expected)


def test_draws_have_the_mixture_s_shares_mean_and_covariance():
    draws = mixed((0.75, ONE), (0.25, OTHER)).draws(40_000, np.random.default_rng(3))
    near = draws[:, 0] > -20
    assert near.mean() == pytest.approx(0.75, abs=0.005)
    assert draws[near].mean(axis=0) == pytest.approx(ONE.means[0], abs=0.03)
    covariance = SCALE * ONE.degrees / (ONE.degrees - 2)
    assert np.cov(draws[near].T) == pytest.approx(covariance, rel=0.06)


def test_a_fit_finds_two_clusters_and_their_shares():
    draws = mixed((0.8, ONE), (0.2, OTHER)).draws(3000, np.random.default_rng(4))
    fit = fitted_mixture(draws, np.ones(len(draws)), np.random.default_rng(5), most_components=2)
    order = np.argsort(fit.means[:, 0])
    assert fit.shares[order] == pytest.approx([0.2, 0.8], abs=0.03)
    assert fit.means[order] == pytest.approx(np.array([[-40, 4], [1, -1]]), abs=0.15)


@pytest.mark.parametrize("seed", range(3))
def test_points_of_one_component_are_fitted_with_one(seed: int):
    """By AIC: a second one costs 28 numbers in six dimensions, and 300 points tell less of it."""
    one = StudentMixture.single(np.zeros(6), np.eye(6))
    points = one.draws(300, np.random.default_rng(seed))
    fit = fitted_mixture(points, np.ones(300), np.random.default_rng(9), most_components=4)
    assert len(fit.shares) == 1


def test_weights_turn_a_wide_sample_into_a_narrow_fit():
    generator = np.random.default_rng(6)
    wide = generator.normal(size=(6000, 2)) * 3
    narrow = multivariate_normal(np.array([1.0, 0.5]), SCALE)
    weights = narrow.pdf(wide) / multivariate_normal(np.zeros(2), np.eye(2) * 9).pdf(wide)
    mean, covariance = weighted_moments(wide, weights / weights.sum())
    assert mean == pytest.approx([1.0, 0.5], abs=0.1)
    assert covariance == pytest.approx(SCALE, abs=0.2)
    fit = fitted_mixture(wide, weights, generator, most_components=1)
    assert fit.means[0] == pytest.approx([1.0, 0.5], abs=0.1)


def test_a_sample_without_spread_in_one_direction_can_still_be_fitted():
    points = np.column_stack([np.linspace(0, 1, 40), np.full(40, 2.0)])
    fit = fitted_mixture(points, np.ones(40), np.random.default_rng(7))
    assert np.all(np.isfinite(fit.log_density(points)))


def test_kish_size_counts_equal_weights_fully_and_one_heavy_weight_once():
    assert kish_size(np.full(10, 0.3)) == pytest.approx(10)
    assert kish_size(np.array([1.0, 0, 0, 0])) == pytest.approx(1)
    assert kish_size(np.zeros(3)) == 0
