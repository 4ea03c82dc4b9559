"""A posterior's draws, less its prior, are the likelihood they came from."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.farm.evidence import (
    StackedEvidence,
    TurbineEvidence,
    common_errors,
    evidence_of,
)
from pipeline.updating.population import SpringCoordinates

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
COORDINATES = SpringCoordinates(NOMINAL)
COUPLING = NOMINAL[2] / np.sqrt(NOMINAL[0] * NOMINAL[1])  # ρ of the nominal foundation [-]


def posterior_of(points, generator):
    """1000 draws of the posterior of a likelihood that points, (n, 3), have been drawn from, under
    the prior uniform in k."""
    log_prior = COORDINATES.log_jacobian(points)
    weights = np.exp(log_prior - log_prior.max())
    chosen = generator.choice(len(points), 1000, p=weights / weights.sum())
    draws = COORDINATES.to_ratios(points[chosen]) * NOMINAL
    return SimpleNamespace(
        turbine="t1",
        draws=np.column_stack([draws, np.zeros(len(draws))]),
        structure="exact",
        figure_errors=(),
    )


def test_the_prior_is_taken_out_of_a_wide_posterior():
    """The prior uniform in k pulls ln k by 1.5 variances: .13 here, eight times what is allowed."""
    generator = np.random.default_rng(1)
    mean, std = np.array([0.1, -0.1, 0.2]), np.array([0.3, 0.2, 0.2])
    likely = mean + std * generator.standard_normal((200_000, 3))
    found = evidence_of(posterior_of(likely, generator), COORDINATES, generator)
    centre = found.shares @ found.means
    np.testing.assert_allclose(centre, mean, atol=0.03)
    spread = np.einsum("k,kii->i", found.shares, found.covariances) + found.shares @ (
        (found.means - centre) ** 2
    )
    np.testing.assert_allclose(np.sqrt(spread), std, rtol=0.1)


def test_an_uncertain_structures_prior_flat_in_the_logarithms_is_taken_out_as_such():
    generator = np.random.default_rng(4)
    mean, std = np.array([0.1, -0.1, 0.2]), np.array([0.3, 0.2, 0.2])
    likely = mean + std * generator.standard_normal((200_000, 3))
    rho = np.tanh(likely[:, 2] + np.arctanh(COUPLING))
    chosen = generator.choice(len(likely), 1000, p=(1 / rho) / (1 / rho).sum())
    draws = COORDINATES.to_ratios(likely[chosen]) * NOMINAL
    posterior = SimpleNamespace(
        turbine="t1",
        draws=np.column_stack([draws, np.zeros(len(draws))]),
        structure="uncertain",
        figure_errors=(),
    )
    found = evidence_of(posterior, COORDINATES, generator)
    np.testing.assert_allclose(found.shares @ found.means, mean, atol=0.03)


def test_what_errors_of_the_description_make_is_taken_out_of_the_evidence():
    """C = own + LᵀL gives the own part back; where L makes more than C, a hundredth stays."""
    own = np.diag([1.0, 2.0, 3.0])
    L = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0]])
    found = TurbineEvidence(
        "a", np.ones(1), np.zeros((1, 3)), (own + L.T @ L)[None], ("E", "level"), L
    )
    np.testing.assert_allclose(found.of_the_description().covariances[0], own, atol=1e-12)
    small = TurbineEvidence("a", np.ones(1), np.zeros((1, 3)), np.eye(3)[None], ("E",), L[:1])
    left = np.linalg.eigvalsh(small.of_the_description().covariances[0])
    np.testing.assert_allclose(left, [0.01, 1.0, 1.0], atol=1e-12)


def test_errors_that_a_turbine_does_not_share_are_zero_for_it():
    one = TurbineEvidence("a", np.ones(1), np.zeros((1, 3)), np.eye(3)[None])
    L = np.array([[1.0, 2.0, 3.0]])
    two = TurbineEvidence("b", np.ones(1), np.zeros((1, 3)), np.eye(3)[None], ("E",), L)
    names, found = common_errors([one, two])
    assert names == ("E",)
    np.testing.assert_array_equal(found, [np.zeros((1, 3)), L])


def test_two_peaks_are_told_as_two():
    generator = np.random.default_rng(2)
    sides = generator.integers(2, size=50_000)[:, None] * np.array([0.2, 0.0, 0.0])
    likely = sides + 0.02 * generator.standard_normal((50_000, 3))
    found = evidence_of(posterior_of(likely, generator), COORDINATES, generator)
    assert len(found.shares) >= 2
    assert np.ptp(found.means[:, 0]) > 0.15
    assert found.shares.sum() == pytest.approx(1)


def test_what_a_turbine_lacks_has_no_share_among_the_others():
    one = TurbineEvidence("a", np.ones(1), np.zeros((1, 3)), np.eye(3)[None])
    two = TurbineEvidence("b", np.array([0.4, 0.6]), np.ones((2, 3)), np.tile(np.eye(3), (2, 1, 1)))
    stacked = StackedEvidence.of([one, two])
    np.testing.assert_allclose(np.exp(stacked.log_shares), [[1, 0], [0.4, 0.6]])
    assert stacked.means.shape == (2, 2, 3)
