"""Draws of a posterior over several σ are those that its mean and covariance state."""

import numpy as np
import pytest

from pipeline.updating.structural.posterior import JointPosterior

POSTERIOR = JointPosterior(
    sigma=np.array([0.0, 0.01, 0.02]),
    weights=np.array([0.5, 0.3, 0.2]),
    means=np.array([[0.0, 1.0], [2.0, 1.0], [-1.0, 3.0]]),
    covariances=np.array([[[1.0, 0.5], [0.5, 1.0]], [[0.5, 0.0], [0.0, 2.0]], 0.1 * np.eye(2)]),
    log_evidence=0.0,
)


def test_mean_and_covariance_are_those_of_its_draws() -> None:
    drawn, sigma = POSTERIOR.draws(200_000, np.random.default_rng(1))
    np.testing.assert_allclose(drawn.mean(axis=0), POSTERIOR.mean, atol=0.02)
    np.testing.assert_allclose(np.cov(drawn.T), POSTERIOR.covariance, atol=0.03)
    shares = [np.mean(sigma == each) for each in POSTERIOR.sigma]
    np.testing.assert_allclose(shares, POSTERIOR.weights, atol=0.005)


@pytest.mark.parametrize("widening", [1.0, 1.1])
def test_draws_are_as_much_wider_about_each_mean_as_is_asked(widening: float) -> None:
    """Plain Laplace at the peak is a little too narrow: draws are widened."""
    drawn, sigma = POSTERIOR.draws(200_000, np.random.default_rng(2), widening=widening)
    at_zero = drawn[sigma == 0.0]
    np.testing.assert_allclose(np.cov(at_zero.T), widening**2 * POSTERIOR.covariances[0], atol=0.02)
