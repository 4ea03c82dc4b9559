"""The Gaussian approximation is exact where the model is linear."""

import numpy as np
import pytest

from pipeline.updating.model_matching import laplace_peak
from pipeline.updating.prior import Prior
from tests.pipeline.updating.likelihood.test_likelihood import TRUTH, evidence_of, likelihood_of
from tests.pipeline.updating.small_tower import NOMINAL, LinearTower


def test_the_peak_is_found_from_afar_within_its_own_standard_deviations():
    evidence, _ = evidence_of(4, seed=21)
    likelihood, prior = likelihood_of(evidence), Prior(NOMINAL)
    peak = laplace_peak(likelihood, LinearTower(), prior, np.array([1.4, 0.8, 0.7]))
    offset = peak.ratios - TRUTH
    assert offset @ np.linalg.solve(peak.covariance, offset) < 16.3  # 99.9 % of chi-square(3)


def test_nothing_nearby_is_more_likely_than_the_peak():
    evidence, _ = evidence_of(4, seed=22)
    likelihood, prior = likelihood_of(evidence), Prior(NOMINAL)
    peak = laplace_peak(likelihood, LinearTower(), prior, TRUTH)
    steps = np.random.default_rng(23).multivariate_normal(np.zeros(3), peak.covariance, 200)
    around = np.vstack([peak.ratios, peak.ratios + steps])
    values = likelihood.log_likelihood(LinearTower().modal(around * NOMINAL)).max(axis=1)
    assert values[0] >= values.max() - 0.02


def test_a_direction_that_the_data_do_not_constrain_keeps_a_finite_spread():
    evidence, _ = evidence_of(1, seed=25, labels=("1",), shape_std=10.0)
    tower = LinearTower().subset(("1",))
    peak = laplace_peak(likelihood_of(evidence), tower, Prior(NOMINAL), TRUTH)
    assert np.linalg.eigvalsh(peak.covariance).max() == pytest.approx(1.0, rel=0.1)
