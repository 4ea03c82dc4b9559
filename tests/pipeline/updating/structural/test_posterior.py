"""Draws of a posterior over several σ are those that its mean and covariance state, and σ is what
the errors of all modes have, not what few have."""

from dataclasses import replace
from typing import Any, cast

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.likelihood import sigma_grid
from pipeline.updating.likelihood.mode_errors import ModeErrors, _measured
from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.posterior import JointPosterior, joint_posterior
from pipeline.updating.structural.prior import JointCoordinates
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

POSTERIOR = JointPosterior(
    sigma=np.array([0.0, 0.01, 0.02]),
    weights=np.array([0.5, 0.3, 0.2]),
    means=np.array([[0.0, 1.0], [2.0, 1.0], [-1.0, 3.0]]),
    covariances=np.array([[[1.0, 0.5], [0.5, 1.0]], [[0.5, 0.0], [0.0, 2.0]], 0.1 * np.eye(2)]),
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


MODES, COMPONENTS = 40, 7
STD = 5e-4  # of every error by itself [-]


def peak_of(errors: np.ndarray) -> JointPeak:
    """A peak on whose coordinates nothing depends; errors: (n, 1 + components)."""
    n, p = errors.shape
    groups, rows = np.repeat(np.arange(n), p), np.tile(np.arange(p), n)
    found = ModeErrors(
        pairing=cast(Any, None),
        used=cast(Any, (None,) * n),
        errors=errors.ravel(),
        variances=np.full(n * p, STD**2 / 2),
        floors=np.full(n * p, STD**2 / 2),
        reference=np.ones(n * p),
        jacobian=np.zeros((n * p, 4)),
        groups=groups,
        is_frequency=rows == 0,
        tracks=groups,
        rows=rows,
        units=np.zeros(n * p, dtype=int),
        damping_ratios=np.full(3, np.nan),
        linearisation=cast(Any, None),
    )
    return JointPeak(np.zeros(4), found, 0.0, n * p - 3)


COORDINATES = JointCoordinates(np.array([1.0, 1.0, 0.5]), (), 0.1)


def sigma_of(errors: np.ndarray) -> JointPosterior:
    return joint_posterior(peak_of(errors), COORDINATES, highest_sigma=0.01, n_sigma=60)


@pytest.mark.parametrize("sigma", [5e-4, 1e-3, 3e-3])
def test_the_discrepancy_of_all_modes_is_no_heap_of_gross_errors(sigma: float) -> None:
    """Student's t alone took half of it for gross errors of the identification."""
    for seed in range(5):
        generator = np.random.default_rng(seed)
        errors = np.hypot(STD, sigma) * generator.standard_normal((MODES, 1 + COMPONENTS))
        found = sigma_of(errors)
        mean = found.weights @ found.sigma
        std = np.sqrt(found.weights @ (found.sigma - mean) ** 2)
        assert abs(mean - sigma) < 3 * std + 0.02 * sigma


def test_the_weights_of_sigma_are_those_of_the_integral_over_all_coordinates() -> None:
    """Of linear Gaussian errors in closed form: η − J (u − u₀) ~ N(0, D(σ) + J P⁻¹ Jᵀ)."""
    generator = np.random.default_rng(11)
    peak = peak_of(0.5 * STD * generator.standard_normal((MODES, 1 + COMPONENTS)))
    eta = peak.comparison.errors
    J = 20 * STD * generator.standard_normal((len(eta), 4))
    u = COORDINATES.origin + 0.05 * generator.standard_normal(4)
    peak = replace(peak, u=u, comparison=replace(peak.comparison, jacobian=J))
    found = joint_posterior(peak, COORDINATES, highest_sigma=5 * STD, n_sigma=20)
    at_prior = eta - J @ (u - COORDINATES.origin)
    logs = []
    for sigma in found.sigma:
        wide = np.diag(np.full(len(eta), STD**2 + sigma**2))
        wide += J @ np.linalg.inv(COORDINATES.prior_precision) @ J.T
        square = at_prior @ np.linalg.solve(wide, at_prior)
        logs.append(-0.5 * (square + np.linalg.slogdet(wide)[1]))
    widths = sigma_grid(5 * STD, 20)[1]
    expected = np.exp(np.array(logs) - max(logs)) * widths
    np.testing.assert_allclose(found.weights, expected / expected.sum(), rtol=0.02, atol=1e-4)


def test_few_gross_errors_are_no_discrepancy_of_the_model() -> None:
    errors = STD * np.random.default_rng(7).standard_normal((MODES, 1 + COMPONENTS))
    alone = sigma_of(errors)
    errors[:2] += 20 * STD
    assert sigma_of(errors).weights @ alone.sigma < STD / 2


def test_the_variance_of_a_frequencys_logarithm_is_its_relative_one() -> None:
    estimate = drawn_estimate(np.ones(3), np.random.default_rng(3), tower=LinearTower())
    evidence = ModalEvidence(channels=LAYOUT.channel_names).with_estimate(estimate)
    expected = [mode.frequency_std / mode.frequency for mode in estimate.modes]
    assert np.sqrt(_measured(evidence).log_variances) == pytest.approx(expected, rel=1e-6)
