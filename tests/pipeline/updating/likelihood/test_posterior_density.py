"""The posterior with σ integrated out and with σ as a parameter are one posterior."""

from dataclasses import dataclass

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.exact_inference import StiffnessDensity
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    ModeComparison,
)
from pipeline.updating.model_matching import laplace_peak
from pipeline.updating.prior import Prior
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.registry import SamplingSettings, sampler_of
from pipeline.updating.samplers.tmcmc import TemperingSettings
from tests.pipeline.updating.likelihood.joint_density import JointDensity
from tests.pipeline.updating.small_tower import LinearTower, drawn_estimate

TOWER = LinearTower()
PRIOR = Prior(TOWER.nominal)
HIGHEST_SIGMA = PRIOR.settings.highest_sigma
TRUTH = np.array([1.1, 0.9, 1.05])


def likelihood_of_one_window(settings):
    """A tower whose six modes were identified and paired as they are."""
    estimate = drawn_estimate(TRUTH, np.random.default_rng(1), tower=TOWER)
    evidence = ModalEvidence(channels=TOWER.layout.channel_names).with_estimate(estimate)
    modes = range(len(evidence.modes))
    return ModalLikelihood(
        evidence,
        [ModeComparison(number, (number,), shape_used=True, gap=0.0) for number in modes],
        model_columns=modes,
        settings=settings,
        highest_sigma=HIGHEST_SIGMA,
    )


@pytest.fixture(scope="module")
def likelihood():
    return likelihood_of_one_window(LikelihoodSettings())


def stiffness_target(likelihood, seed):
    density = StiffnessDensity(likelihood, TOWER, PRIOR, np.random.default_rng(seed))
    return density.target(laplace_peak(likelihood, TOWER, PRIOR, np.ones(3)))


def joint_target(likelihood):
    peak = laplace_peak(likelihood, TOWER, PRIOR, np.ones(3))
    return JointDensity(likelihood, TOWER, PRIOR).target(peak)


def test_the_joint_density_averaged_over_sigma_is_the_stiffness_density(likelihood):
    joint = JointDensity(likelihood, TOWER, PRIOR)
    sigma = likelihood.sigma
    for ratios in (TRUTH, np.array([1.0, 1.0, 1.0]), np.array([2.0, 1.5, 0.8])):
        points = np.column_stack([np.tile(ratios, (len(sigma), 1)), sigma])
        values = joint(points)[0]
        averaged = np.trapezoid(np.exp(values - values.max()), sigma) / HIGHEST_SIGMA
        expected = StiffnessDensity(likelihood, TOWER, PRIOR, np.random.default_rng(2))(
            ratios[None]
        )[0][0]
        assert values.max() + np.log(averaged) == pytest.approx(expected, abs=1e-3)


def test_between_the_nodes_of_sigma_the_joint_density_is_that_of_a_finer_grid(likelihood):
    def built(sigma_points):
        return likelihood_of_one_window(LikelihoodSettings(sigma_points=sigma_points))

    coarse, fine = built(60), built(600)
    sigma = fine.sigma[5:-5:7]
    points = np.column_stack([np.tile(TRUTH, (len(sigma), 1)), sigma])
    read, known = (JointDensity(each, TOWER, PRIOR)(points)[0] for each in (coarse, fine))
    assert read == pytest.approx(known, abs=0.01)


def test_there_is_no_density_outside_the_prior(likelihood):
    joint = JointDensity(likelihood, TOWER, PRIOR)
    outside = [[0.1, 1, 1, 0.01], [1, 1, 1, -1e-9], [1, 1, 1, 0.11], [0.5, 0.5, 1.5, 0.01]]
    assert np.all(np.isneginf(joint(np.array(outside))[0]))
    stiffness = StiffnessDensity(likelihood, TOWER, PRIOR, np.random.default_rng(2))
    values, sigma = stiffness(np.array([[0.1, 1, 1], [4.1, 1, 1], [0.5, 0.5, 1.5], [1, 1, 1]]))
    assert np.isneginf(values).tolist() == [True, True, True, False]
    assert np.all(np.isfinite(sigma))


@dataclass(frozen=True)
class FallingTower(LinearTower):
    """Falls over where its springs are softer than nominal."""

    def modal(self, theta):
        modes = super().modal(theta)
        falls = theta[:, 0] < self.nominal[0]
        modes.frequencies[falls], modes.shapes[falls] = np.nan, np.nan
        return modes


def test_a_structure_that_falls_over_has_no_density_at_any_sigma(likelihood):
    points = np.array([[0.9, 1, 1, 0.0], [0.9, 1, 1, 0.003], [1.1, 1, 1, 0.003], [0.9, 1, 1, 0.1]])
    with np.errstate(all="raise"):
        values, _ = JointDensity(likelihood, FallingTower(), PRIOR)(points)
    assert np.isneginf(values).tolist() == [True, True, False, True]


@pytest.mark.parametrize(
    "sampled",
    [
        pytest.param(("importance",), id="day"),
        pytest.param(("tmcmc", "importance"), id="night", marks=pytest.mark.nightly),
    ],
)
def test_importance_tempering_and_chains_agree_with_sigma_integrated_out_or_sampled(sampled):
    likelihood = likelihood_of_one_window(LikelihoodSettings(sigma_points=30))
    settings = {"tempering": TemperingSettings(samples=5000, particles=500, pilot=1000)}
    routes = {}
    for name in ("tmcmc", "importance", "emcee"):
        sampler = sampler_of(SamplingSettings(method=name, **settings), SamplerSettings())
        drawn = sampler(stiffness_target(likelihood, 3), np.random.default_rng(4))
        routes[name] = drawn.flat, drawn.log_evidence
    for name in sampled:
        sampler = sampler_of(SamplingSettings(method=name, **settings), SamplerSettings())
        drawn = sampler(joint_target(likelihood), np.random.default_rng(5))
        routes[f"{name}, σ sampled"] = drawn.flat[:, :4], drawn.log_evidence
    first = np.quantile(routes["tmcmc"][0], [0.25, 0.5, 0.75], axis=0)
    for name, (flat, _) in routes.items():
        shift = np.quantile(flat, [0.25, 0.5, 0.75], axis=0) - first
        assert np.abs(shift / (first[2] - first[0])).max() < 0.12, name
    assert np.nanmax([z for _, z in routes.values()]) == pytest.approx(
        np.nanmin([z for _, z in routes.values()]), abs=0.1
    )
