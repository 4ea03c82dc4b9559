"""Partial pooling against integrals by quadrature, its limits, its prior, and its own promises."""

import numpy as np
import pytest
from scipy import stats

from pipeline.farm.evidence import StackedEvidence, TurbineEvidence
from pipeline.farm.gibbs import Gibbs, inverse_wishart
from pipeline.farm.pooling import pooled
from pipeline.farm.settings import FarmError, GibbsSettings, PopulationPrior
from tests.benchmarks.pooling import expected_errors
from tests.tiers import and_at_night

BRIEF = GibbsSettings(chains=16, burn_in=40, sweeps=50, rounds=1)
ONE_SPREAD = 1e3  # degrees of freedom that make Σ = τ² S to a few percent
SHORT = GibbsSettings(chains=16, burn_in=40, sweeps=80, rounds=1)


def seen(means, stds):
    """Gaussian evidence of turbines at means, (n, d), each with standard deviations, (n, d)."""
    return StackedEvidence.of(
        [
            TurbineEvidence(f"t{i}", np.ones(1), np.array([m]), np.array([np.diag(np.square(s))]))
            for i, (m, s) in enumerate(zip(np.atleast_2d(means), np.atleast_2d(stds), strict=True))
        ]
    )


class Quadrature:
    """The same posterior in one dimension, summed over a grid of μ, τ and ε; of each turbine's
    being an outlier, with the others' data alone."""

    def __init__(self, means, stds, prior):
        tau = np.geomspace(1e-4, 0.6, 100)
        self.mu, self.tau, share = np.meshgrid(
            np.linspace(-0.12, 0.12, 81), tau, np.linspace(0.005, 0.6, 40), indexing="ij"
        )
        log = stats.norm.logpdf(self.mu, scale=prior.mean_std)
        log += stats.t.logpdf(self.tau / prior.spread_scale, prior.spread_degrees)
        log += np.log(np.gradient(tau))[None, :, None]
        log += stats.beta.logpdf(share, prior.outliers, prior.regular)
        regular, outlying = [], []
        for m, s in zip(means, stds, strict=True):
            width = self.tau**2 + s**2
            regular.append((1 - share) * stats.norm.pdf(m, self.mu, np.sqrt(width)))
            wide = np.sqrt(width + prior.outlier_std**2)
            outlying.append(share * stats.norm.pdf(m, self.mu, wide))
        log += sum(np.log(a + b) for a, b in zip(regular, outlying, strict=True))
        self.weights = np.exp(log - log.max())
        self.weights /= self.weights.sum()
        odds = prior.outliers / prior.regular
        self.outlying = []
        for a, b in zip(regular, outlying, strict=True):
            others = np.exp(log - np.log(a + b) - log.max())  # what the others alone say
            evidence = odds * (others * b / share).sum() / (others * a / (1 - share)).sum()
            self.outlying.append(float(evidence / (1 + evidence)))

    def mean(self, values):
        return float((self.weights * values).sum())


def test_chains_agree_with_quadrature_in_one_dimension_outlier_included():
    means = np.array([0.012, -0.018, 0.004, 0.021, -0.007, -0.16])
    stds = np.array([0.01, 0.012, 0.02, 0.008, 0.015, 0.02])
    prior = PopulationPrior(outlier_std=0.2, alike=ONE_SPREAD)
    exact = Quadrature(means, stds, prior)
    settings = GibbsSettings(chains=48, sweeps=600, rounds=1)
    drawn = pooled(seen(means[:, None], stds[:, None]), prior, np.random.default_rng(1), settings)
    tau = np.sqrt(drawn.covariances[:, 0, 0])
    assert drawn.means.mean() == pytest.approx(exact.mean(exact.mu), abs=6e-4)
    spread = np.sqrt(exact.mean(exact.mu**2) - exact.mean(exact.mu) ** 2)
    assert drawn.means.std() == pytest.approx(spread, rel=0.08)
    for level in (0.005, 0.015, 0.04):
        share = exact.mean(exact.tau < level)
        assert np.mean(tau < level) == pytest.approx(share, abs=0.025)
    np.testing.assert_allclose(drawn.outlier_probabilities, exact.outlying, atol=0.02)
    assert drawn.outlier_probabilities[5] > 0.7


@pytest.mark.parametrize(("rhat", "sweeps"), [(1.0, 40), (100.0, 10)])
def test_chains_that_disagree_are_drawn_once_more_and_twice_as_long(rhat, sweeps):
    """No chains have an R̂ below 1; every R̂ is below 100."""
    settings = GibbsSettings(chains=4, burn_in=5, sweeps=10, rounds=3, rhat=rhat)
    evidence = seen(np.zeros((3, 1)), np.full((3, 1), 0.02))
    drawn = pooled(evidence, PopulationPrior(), np.random.default_rng(3), settings)
    assert len(drawn.means) == settings.chains * sweeps


def test_turbines_that_cannot_differ_have_the_precision_weighted_mean():
    generator = np.random.default_rng(2)
    means, stds = 0.02 * generator.standard_normal((5, 3)), generator.uniform(0.01, 0.03, (5, 3))
    alike = PopulationPrior(spread_scale=1e-6, regular=1e9, mean_std=100.0)
    drawn = pooled(seen(means, stds), alike, np.random.default_rng(3), SHORT)
    precision = (stds**-2.0).sum(axis=0)
    expected = (means / stds**2).sum(axis=0) / precision
    std = precision**-0.5
    for turbine in range(5):
        points = drawn.points[:, turbine]
        np.testing.assert_array_less(np.abs(points.mean(axis=0) - expected), 0.15 * std)
        np.testing.assert_allclose(points.std(axis=0), std, rtol=0.15)


def test_turbines_of_a_farm_without_bounds_keep_what_they_know_themselves():
    generator = np.random.default_rng(4)
    means, stds = 3.0 * generator.standard_normal((5, 2)), np.full((5, 2), 0.02)
    unlike = PopulationPrior(spread_scale=1e3, mean_std=1e3)
    drawn = pooled(seen(means, stds), unlike, np.random.default_rng(5), SHORT)
    np.testing.assert_allclose(drawn.points.mean(axis=0), means, atol=0.15 * 0.02)
    np.testing.assert_allclose(drawn.points.std(axis=0), stds, rtol=0.15)


def test_turbines_that_saw_nothing_leave_the_prior_as_it_was():
    prior = PopulationPrior(alike=ONE_SPREAD)
    nothing = seen(np.zeros((3, 2)), np.full((3, 2), 1e4))
    settings = GibbsSettings(chains=48, burn_in=60, sweeps=120, rounds=1)
    drawn = pooled(nothing, prior, np.random.default_rng(6), settings)
    spreads = np.sqrt(np.diagonal(drawn.covariances, axis1=1, axis2=2)) / prior.spread_scale
    for level in (0.25, 0.5, 0.9):  # half-Student-t of two degrees of freedom
        assert np.mean(spreads < stats.t.ppf(0.5 + level / 2, 2)) == pytest.approx(level, abs=0.04)
    correlation = drawn.covariances[:, 0, 1] / spreads.prod(axis=1) / prior.spread_scale**2
    assert np.mean(correlation) == pytest.approx(0, abs=0.02)
    assert np.std(correlation) == pytest.approx(ONE_SPREAD**-0.5, rel=0.3)
    assert drawn.outlier_shares.mean() == pytest.approx(1 / 20, abs=0.01)
    assert drawn.means.std() == pytest.approx(prior.mean_std, rel=0.1)


def test_two_peaked_evidence_is_settled_by_the_other_turbines():
    others = [
        TurbineEvidence(f"t{i}", np.ones(1), np.full((1, 1), m), np.full((1, 1, 1), 1e-6))
        for i, m in enumerate((0.00, 0.01, -0.01, 0.005))
    ]
    two = TurbineEvidence(
        "two", np.array([0.3, 0.7]), np.array([[0.0], [0.3]]), np.full((2, 1, 1), 1e-4)
    )
    evidence = StackedEvidence.of([*others, two])
    drawn = pooled(evidence, PopulationPrior(), np.random.default_rng(7), SHORT)
    assert np.mean(np.abs(drawn.points[:, 4, 0]) < 0.05) > 0.98


def test_intervals_hold_the_truth_of_drawn_farms_at_their_rate():
    prior, held, own_held = PopulationPrior(regular=1e6), [], []
    for seed in range(11, 15):
        generator = np.random.default_rng(seed)
        factor = 0.02 * np.array([[1.0, 0.0], [0.7, 0.7]])
        truth = 0.1 * generator.standard_normal(2) + generator.standard_normal((15, 2)) @ factor.T
        stds = generator.uniform(0.005, 0.05, truth.shape)
        means = truth + stds * generator.standard_normal(truth.shape)
        drawn = pooled(seen(means, stds), prior, generator, BRIEF)
        low, high = np.quantile(drawn.points, [0.05, 0.95], axis=0)
        held.append((low <= truth) & (truth <= high))
        own_held.append(np.abs(means - truth) < 1.645 * stds)
    # 120 intervals of 90 %: three standard deviations of a share of theirs are .082
    assert 0.818 < np.mean(held) < 0.982
    assert 0.818 < np.mean(own_held) < 0.982


@pytest.mark.parametrize("seeds", and_at_night(range(20), range(30)))
def test_truths_drawn_from_the_prior_rank_anywhere_among_the_draws(seeds):
    """Simulation-based calibration (Talts et al. 2018, arXiv:1804.06788) by farms of four; five of
    them a bin are what the test of a flat histogram needs."""
    prior, ranks = PopulationPrior(outliers=2.0, regular=8.0, alike=ONE_SPREAD), []
    for seed in seeds:
        generator = np.random.default_rng([51, seed])
        mu = prior.mean_std * generator.standard_normal()
        tau = prior.spread_scale * abs(generator.standard_t(prior.spread_degrees))
        outlying = generator.random(4) < generator.beta(prior.outliers, prior.regular)
        widths = np.sqrt(tau**2 + outlying * prior.outlier_std**2)
        truth = mu + widths * generator.standard_normal(4)
        stds = generator.uniform(0.01, 0.1, 4)
        means = truth + stds * generator.standard_normal(4)
        settings = GibbsSettings(chains=19, burn_in=20, sweeps=10, rounds=1)
        drawn = pooled(seen(means[:, None], stds[:, None]), prior, generator, settings)
        last = slice(-19, None)  # one of each chain
        spread = np.sqrt(drawn.covariances[last, 0, 0])
        ranks.append(
            [
                (drawn.means[last, 0] < mu).sum(),
                (spread < tau).sum(),
                (drawn.points[last, 0, 0] < truth[0]).sum(),
            ]
        )
    for column in np.array(ranks).T:
        counts = np.histogram(column, np.linspace(0, 20, 5))[0]
        assert stats.chisquare(counts).pvalue > 0.003


def test_an_outlier_does_not_widen_the_others():
    generator = np.random.default_rng(21)
    means = 0.01 * generator.standard_normal((12, 2))
    stds = np.full_like(means, 0.01)
    alone = pooled(seen(means[:-1], stds[:-1]), PopulationPrior(), np.random.default_rng(22), SHORT)
    means[-1] = [0.0, -0.16]
    beside = pooled(seen(means, stds), PopulationPrior(), np.random.default_rng(23), SHORT)
    assert beside.outlier_probabilities[-1] > 0.95
    assert beside.outlier_probabilities[:-1].max() < 0.2
    widths = [d.points[:, :11].std(axis=0) for d in (alone, beside)]
    np.testing.assert_allclose(widths[1], widths[0], rtol=0.15)


def test_a_spread_given_twenty_differences_is_their_scatter_beside_the_priors():
    """Conjugate: E Σ = (Σ b bᵀ + ν τ² S) / (ν + n), of ν degrees that hold Σ to τ² S."""
    generator, tau, alike = np.random.default_rng(12), 0.02, 10.0
    shape = np.array([[1.0, 0.3], [0.3, 2.0]])
    offsets = generator.multivariate_normal(np.zeros(2), 4 * tau**2 * shape, 20)
    evidence = StackedEvidence.of(
        [
            TurbineEvidence("t", np.ones(1), np.zeros((1, 2)), 1e-6 * np.eye(2)[None])
            for _ in offsets
        ]
    )
    gibbs = Gibbs(evidence, PopulationPrior(alike=alike), generator, shape)
    n_chains = 20_000
    drawn = gibbs._covariance(np.tile(offsets, (n_chains, 1, 1)), np.full(n_chains, tau))
    expected = (offsets.T @ offsets + alike * tau**2 * shape) / (alike + 20)
    np.testing.assert_allclose(drawn.mean(axis=0), expected, atol=0.02 * expected.max())


def test_inverse_wishart_draws_have_their_mean_and_spread():
    scale, degrees = np.array([[2.0, 0.5], [0.5, 1.0]]), 12.0
    drawn = inverse_wishart(degrees, np.tile(scale, (20_000, 1, 1)), np.random.default_rng(41))
    np.testing.assert_allclose(drawn.mean(axis=0), scale / (degrees - 3), rtol=0.03)
    expected = stats.invwishart.rvs(degrees, scale, size=20_000, random_state=42)
    np.testing.assert_allclose(drawn.std(axis=0), expected.std(axis=0), rtol=0.06)


@pytest.mark.parametrize("setting", ["mean_std", "spread_scale", "outlier_std", "regular"])
def test_a_population_without_width_is_refused_by_its_name(setting):
    with pytest.raises(FarmError, match=setting):
        PopulationPrior(**{setting: 0.0})


def test_what_a_farm_that_shows_its_own_mean_can_give_at_most():
    """Five turbines seen as well as they differ: an oracle of mean and spread halves the variance;
    where the mean is learned, a fifth of what it saved is lost again (closed form and drawn)."""
    spread = 0.02**2 * np.eye(2)
    covariances = np.broadcast_to(spread, (5, 2, 2))
    alone, oracle, learned = expected_errors(covariances, spread, np.eye(2))
    assert (oracle / alone, learned / alone) == pytest.approx((0.5, 0.5 + 0.5 / 5))
    truths, noise = 0.02 * np.random.default_rng(1).standard_normal((2, 20_000, 5, 2))
    measured = truths + noise
    shrunk = 0.5 * (measured + measured.mean(axis=1, keepdims=True))
    assert np.mean((shrunk - truths) ** 2) == pytest.approx(learned, rel=0.02)
