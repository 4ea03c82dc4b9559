"""Normal and heavy-tailed errors against their formulas, and what one bad mode may do."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import invgamma, norm
from scipy.stats import t as student_t

from pipeline.updating.likelihood.error_distributions import (
    GaussianErrors,
    StudentErrors,
    tail_nodes,
)
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.model_matching import laplace_peak
from pipeline.updating.prior import Prior, UpdatingError
from tests.pipeline.updating.likelihood.test_likelihood import TRUTH, evidence_of, likelihood_of
from tests.pipeline.updating.small_tower import NOMINAL, LinearTower

SIGMA = np.array([0.0, 0.001, 0.01])
DEGREES = 4.0


def student(variances, floors, reference, groups=(0,), degrees=DEGREES):
    return StudentErrors(
        variances=np.array(variances),
        floors=np.array(floors),
        reference=np.array(reference),
        sigma=SIGMA,
        groups=np.array(groups),
        degrees=degrees,
    )


@pytest.mark.parametrize("error", [0.0, 1e-3, 4e-3, 1.2e-2])
def test_heavy_tails_are_the_integral_over_each_modes_own_scale(error):
    """Five nodes of λ against quadrature: within .25 nats from the core to twelve floors."""
    variance, floor, reference = 0.5e-6, 1e-6, 1.0
    model = student([variance], [floor], [reference])
    computed = model.log_density(model.whitened(np.array([[0.0], [error]])) ** 2)
    for index, sigma in enumerate(SIGMA):

        def density(scale, at, sigma=sigma):
            std = np.sqrt(variance + scale * (sigma**2 * reference + floor))
            return norm.pdf(at, 0, std) * invgamma.pdf(scale, DEGREES / 2, scale=DEGREES / 2)

        exact = [quad(density, 0, np.inf, args=(at,), limit=200)[0] for at in (0.0, error)]
        difference = computed[1, index] - computed[0, index]
        assert difference == pytest.approx(np.log(exact[1] / exact[0]), abs=0.25)


def test_without_measurement_noise_the_tails_are_those_of_students_t():
    model = student([1e-12], [1e-6], [0.0])
    errors = np.array([0.0, 2e-3, 8e-3])
    computed = model.log_density(model.whitened(errors[:, None]) ** 2)[:, 0]
    exact = student_t.logpdf(errors / 1e-3, DEGREES)
    assert computed - computed[0] == pytest.approx(exact - exact[0], abs=0.35)


def test_the_nodes_of_the_scale_are_probabilities_that_reach_the_tail():
    scales, shares = tail_nodes(DEGREES)
    assert shares.sum() == pytest.approx(1.0)
    assert np.all(shares > 0)
    assert scales.max() > 50, "an error of seven times the usual size must be foreseen"


def test_many_degrees_of_freedom_are_a_normal_distribution():
    errors = np.array([[0.0, 0.0], [1e-3, -2e-3]])
    heavy = student([1e-6, 2e-6], [1e-6, 1e-6], [1.0, 2.0], groups=(0, 1), degrees=1e5)
    normal = GaussianErrors(np.diag([2e-6, 3e-6]), np.array([1.0, 2.0]), SIGMA)
    ours, theirs = (m.log_density(m.whitened(errors) ** 2) for m in (heavy, normal))
    assert ours[1] - ours[0] == pytest.approx(theirs[1] - theirs[0], abs=0.02)


def test_an_outlying_mode_weighs_less_and_its_good_shape_does_not_vouch_for_it():
    model = student([1e-7] * 4, [1e-6] * 4, [1.0] * 4, groups=(0, 1, 1, 2))
    weights = model.weights(np.array([100.0, 1.0, 1.0, 1.0]))
    assert weights[0] < 0.1
    assert weights[1:].min() > 0.3


def outlying_evidence():
    """Twelve windows in which the third mode comes out 1 % too low."""
    evidence, _ = evidence_of(12, seed=17)
    modes = list(evidence.modes)
    shifted = np.zeros_like(modes[2].information_mean)
    shifted[0] = 0.01 * modes[2].frequency
    moved = modes[2].information_mean - modes[2].information @ shifted
    modes[2] = replace(modes[2], information_mean=moved)
    return replace(evidence, modes=tuple(modes))


@pytest.mark.parametrize(("tails", "largest"), [("student-t", 0.015), ("gaussian", np.inf)])
def test_one_mode_off_by_a_percent_moves_the_stiffness_little(tails, largest):
    settings = LikelihoodSettings(tails=tails)
    peaks = [
        laplace_peak(likelihood_of(e, settings), LinearTower(), Prior(NOMINAL), TRUTH)
        for e in (evidence_of(12, seed=17)[0], outlying_evidence())
    ]
    moved = np.abs(peaks[1].ratios - peaks[0].ratios).max()
    assert moved < largest
    if tails == "gaussian":
        assert moved > 0.015, "else this test says nothing"


def test_heavy_tails_with_joint_covariances_are_refused_with_what_to_set():
    with pytest.raises(UpdatingError, match="joint_covariance = false"):
        LikelihoodSettings(tails="student-t", joint_covariance=True)
