"""A posterior's draws, less its prior, are the likelihood they came from."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.farm.evidence import StackedEvidence, TurbineEvidence, evidence_of
from pipeline.updating.population import SpringCoordinates

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
COORDINATES = SpringCoordinates(NOMINAL)


def posterior_of(points, generator):
    """1000 draws of the posterior of a likelihood that points, (n, 3), have been drawn from, under
    the prior uniform in k."""
    log_prior = COORDINATES.log_jacobian(points)
    weights = np.exp(log_prior - log_prior.max())
    chosen = generator.choice(len(points), 1000, p=weights / weights.sum())
    draws = COORDINATES.to_ratios(points[chosen]) * NOMINAL
    return SimpleNamespace(turbine="t1", draws=np.column_stack([draws, np.zeros(len(draws))]))


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
