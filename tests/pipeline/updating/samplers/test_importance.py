"""Importance sampling against known densities, and the chains that stand behind it."""

import numpy as np
import pytest

from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.importance import (
    Adaptation,
    ImportanceSampler,
    ImportanceSettings,
    WeightedDraws,
    systematic_choice,
    weighted_draws,
)
from pipeline.updating.samplers.interface import CountedDensity
from pipeline.updating.samplers.registry import EnsembleSampler
from pipeline.updating.samplers.student_t import StudentMixture
from tests.pipeline.updating.known_densities import (
    COVARIANCE,
    MEAN,
    banana,
    gaussian,
    kolmogorov_distance,
    target_of,
)

CHAINS = EnsembleSampler(SamplerSettings(effective_draws=400, most_steps=200))
SAMPLER = ImportanceSampler(ImportanceSettings(), chains=CHAINS)


def refreshed(known, seed):
    return SAMPLER(known.target, np.random.default_rng(seed))


def test_a_sharp_gaussian_is_drawn_with_its_moments_and_its_evidence():
    known = gaussian()
    drawn = refreshed(known, 1)
    ratios = drawn.flat[:, :3]
    deviations = np.sqrt(np.diag(COVARIANCE))
    assert (ratios.mean(axis=0) - MEAN) / deviations == pytest.approx(0, abs=0.1)
    assert np.cov(ratios.T) / COVARIANCE == pytest.approx(1.0, abs=0.12)
    assert drawn.log_evidence == pytest.approx(known.log_evidence, abs=0.05)


def test_a_refresh_costs_less_than_three_likelihoods_an_effective_draw():
    warm = np.random.default_rng(2).multivariate_normal(MEAN, COVARIANCE * 1.5, size=400)
    drawn = refreshed(gaussian(ensemble=warm), 2)
    assert drawn.sampler == "importance"
    assert drawn.ess >= 1000
    assert drawn.evaluations < 3 * drawn.ess


def test_a_peak_that_is_five_deviations_off_is_walked_away_from():
    known = gaussian(peak=MEAN + 0.05, covariance=COVARIANCE * 4)
    drawn = refreshed(known, 3)
    assert drawn.sampler == "importance"
    assert drawn.log_evidence == pytest.approx(known.log_evidence, abs=0.06)


def test_a_stale_ensemble_far_away_does_no_harm():
    stale = np.random.default_rng(4).normal(MEAN + 0.5, 0.01, size=(400, 3))
    known = gaussian(ensemble=stale)
    drawn = refreshed(known, 4)
    assert drawn.log_evidence == pytest.approx(known.log_evidence, abs=0.05)
    assert np.abs(drawn.flat[:, :3].mean(axis=0) - MEAN).max() < 0.004


def test_a_bent_posterior_keeps_its_marginals():
    known = banana()
    drawn = refreshed(known, 5)
    x, _, z = drawn.flat[:, :3].T
    assert kolmogorov_distance(x, known.marginals[0]) < 0.05
    assert kolmogorov_distance(z, known.marginals[2]) < 0.05


def test_the_stated_deviation_of_the_evidence_is_the_one_seen_over_many_seeds():
    known = gaussian()
    runs = [refreshed(known, 100 + seed) for seed in range(40)]
    offsets = [(run.log_evidence - known.log_evidence) / run.log_evidence_std for run in runs]
    assert np.sqrt(np.mean(np.square(offsets))) == pytest.approx(1.0, abs=0.3)


def test_the_edge_of_the_prior_cuts_the_posterior_where_it_lies():
    """Half of the Gaussian lies outside: the other half remains, with half the evidence."""

    def below(points):
        return np.where(points[:, 0] > 0, -np.inf, -0.5 * (points**2).sum(axis=1) / 0.04)

    target = target_of(below, np.zeros(2), np.eye(2) * 0.04)
    drawn = SAMPLER(target, np.random.default_rng(6))
    assert drawn.flat[:, 0].max() <= 0
    assert drawn.flat[:, 0].mean() == pytest.approx(-0.2 * np.sqrt(2 / np.pi), abs=0.015)
    expected = np.log(np.pi * 0.04) - target.log_prior_volume
    assert drawn.log_evidence == pytest.approx(expected, abs=0.06)


def test_chains_take_over_where_too_few_draws_count_and_say_so():
    """A ring a hundred times thinner than wide, for one component and two pilot rounds."""

    def ring(points):
        return -0.5 * ((np.linalg.norm(points, axis=1) - 2.0) / 0.02) ** 2

    angles = np.random.default_rng(7).uniform(0, 2 * np.pi, 400)
    warm = 2.0 * np.column_stack([np.cos(angles), np.sin(angles)])
    target = target_of(ring, np.zeros(2), np.eye(2), ensemble=warm)
    few = ImportanceSettings(components=1, most_pilots=2)
    drawn = ImportanceSampler(few, chains=CHAINS)(target, np.random.default_rng(8))
    assert drawn.sampler == "emcee"
    assert drawn.efficiency < 0.1
    assert drawn.warnings[0].code == "importance-efficiency"
    assert np.linalg.norm(drawn.flat[:, :2], axis=1).mean() == pytest.approx(2.0, abs=0.01)


def test_the_same_generator_gives_the_same_draws_and_the_companion_stays_with_its_point():
    first, second = refreshed(gaussian(), 9), refreshed(gaussian(), 9)
    assert np.array_equal(first.flat, second.flat)
    assert np.array_equal(first.flat[:, 0], first.flat[:, 3])


def test_batches_that_agree_have_an_rhat_of_one_and_batches_that_do_not_show_it():
    generator = np.random.default_rng(10)
    points = generator.normal(size=(4000, 2))
    zeros = np.zeros(4000)
    assert WeightedDraws(points, zeros, zeros, zeros).rhat() == pytest.approx(1.0, abs=0.01)
    points[::4] += 3.0
    assert WeightedDraws(points, zeros, zeros, zeros).rhat() > 1.5


def test_systematic_choice_takes_every_index_its_share_of_times():
    weights = np.array([0.5, 0.0, 0.25, 0.25])
    chosen = systematic_choice(weights, 8, np.random.default_rng(11))
    assert np.bincount(chosen, minlength=4).tolist() == [4, 0, 2, 2]


@pytest.mark.parametrize(
    ("settings", "number"),
    [({"pilot": 3}, "3"), ({"components": 0}, "0")],
)
def test_a_setting_that_cannot_work_is_refused_with_its_value(settings, number):
    with pytest.raises(UpdatingError, match=number):
        ImportanceSettings(**settings)


def test_an_index_is_chosen_as_often_as_its_weight_says_on_average():
    """Systematic resampling is unbiased only because its grid begins anywhere."""
    generator = np.random.default_rng(41)
    weights = np.array([0.13, 0.07, 0.42, 0.38])
    counts = np.mean(
        [np.bincount(systematic_choice(weights, 3, generator), minlength=4) for _ in range(4000)],
        axis=0,
    )
    assert counts == pytest.approx(3 * weights, abs=0.03)  # four standard errors


def test_a_large_round_and_a_small_one_give_the_same_posterior_as_two_equal_ones():
    """Balance heuristic: every draw is weighted by all rounds' proposals, each as large as it was.
    With N(0, 1) between two proposals, the fitted one has its mean at 0 whichever was larger."""
    generator = np.random.default_rng(42)

    def normal(points):
        return -0.5 * (points**2).sum(axis=1), points[:, 0].copy()

    left, right = (StudentMixture.single(np.array([m, m]), np.eye(2)) for m in (-1.5, 1.5))
    adaptation = Adaptation(CountedDensity(normal), left, generator, components=1)
    adaptation.learn(weighted_draws(CountedDensity(normal), left, 300, generator))
    adaptation.proposal = right
    adaptation.learn(weighted_draws(CountedDensity(normal), right, 6000, generator))
    mean = adaptation.proposal.shares @ adaptation.proposal.means
    assert mean == pytest.approx(0, abs=0.15)  # equal shares would put it at .6


def test_rhat_of_batches_that_differ_by_their_own_width_is_root_two():
    """R̂² = 1 + between / within: four batches of unit variance whose means scatter by one."""
    n = 4 * 5000
    generator = np.random.default_rng(43)
    batches = np.arange(n) % 4
    offsets = np.array([-1.5, -0.5, 0.5, 1.5]) / np.sqrt(5 / 3)  # of variance 1
    points = (generator.standard_normal(n) + offsets[batches])[:, None]
    drawn = WeightedDraws(points, points[:, 0], np.zeros(n), np.zeros(n))
    assert drawn.rhat() == pytest.approx(np.sqrt(2), rel=0.02)
