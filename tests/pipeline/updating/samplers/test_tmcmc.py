"""Tempering as published, whose bias is shown, and mended, which has none."""

import numpy as np
import pytest

from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.interface import CountedDensity
from pipeline.updating.samplers.tmcmc import (
    CorrectedTmcmc,
    PublishedSettings,
    PublishedTmcmc,
    TemperingSettings,
    next_exponent,
    tempered_population,
)
from tests.pipeline.updating.known_densities import (
    COVARIANCE,
    MEAN,
    banana,
    gaussian,
    kolmogorov_distance,
    target_of,
    two_peaks,
)

MENDED = CorrectedTmcmc(TemperingSettings(samples=100_000))
PUBLISHED = PublishedTmcmc(PublishedSettings(samples=5000))


def test_the_next_exponent_makes_the_weights_vary_as_much_as_asked():
    log_likelihood = -1e4 * np.random.default_rng(1).random(2000)
    exponent = next_exponent(log_likelihood, 0.0, 0.5)
    weights = np.exp(exponent * (log_likelihood - log_likelihood.max()))
    assert weights.std() / weights.mean() == pytest.approx(0.5, rel=1e-6)


def test_a_likelihood_that_says_nothing_is_tempered_in_one_stage():
    assert next_exponent(np.full(100, -3.0), 0.0, 0.5) == 1.0


def test_a_prior_without_any_likelihood_is_an_error_that_says_so():
    target = target_of(lambda points: np.full(len(points), -np.inf), np.zeros(2), np.eye(2))
    with pytest.raises(UpdatingError, match="none of 1000 draws"):
        tempered_population(
            target,
            CountedDensity(target.log_density),
            TemperingSettings(),
            np.random.default_rng(2),
        )


@pytest.mark.parametrize("known", [gaussian(), banana(), two_peaks()], ids=["sharp", "bent", "two"])
def test_a_hundred_thousand_draws_lie_within_a_hundredth_of_the_true_marginals(known):
    drawn = MENDED(known.target, np.random.default_rng(3))
    distances = [
        kolmogorov_distance(column, marginal)
        for column, marginal in zip(drawn.flat.T, known.marginals, strict=False)
        if marginal is not None
    ]
    assert len(drawn.flat) == 100_000
    assert max(distances) < 0.01
    assert drawn.evaluations <= 250_000
    assert drawn.log_evidence == pytest.approx(known.log_evidence, abs=0.01)
    assert not drawn.warnings


def test_the_second_peak_is_found_without_being_told_of_it():
    drawn = MENDED(two_peaks(peak=(-2.0, -2.0)).target, np.random.default_rng(4))
    assert (drawn.flat[:, 0] > 0).mean() == pytest.approx(0.25, abs=0.01)


def test_springs_that_cannot_stand_count_as_prior_without_likelihood():
    """A likelihood of one on half of the prior and of zero on the rest: the evidence is 1/2."""
    target = target_of(
        lambda points: np.where(points[:, 0] > 0, 0.0, -np.inf), np.ones(2), np.eye(2)
    )
    population = tempered_population(
        target, CountedDensity(target.log_density), TemperingSettings(), np.random.default_rng(5)
    )
    assert population.log_evidence == pytest.approx(np.log(0.5), abs=0.07)
    assert np.all(population.points[:, 0] > 0)


def test_the_published_sampler_finds_the_posterior_but_misses_its_evidence_by_many_deviations():
    known = gaussian()
    drawn = PUBLISHED(known.target, np.random.default_rng(6))
    deviations = np.sqrt(np.diag(COVARIANCE))
    assert (drawn.flat[:, :3].mean(axis=0) - MEAN) / deviations == pytest.approx(0, abs=0.25)
    assert abs(drawn.log_evidence - known.log_evidence) > 5 * drawn.log_evidence_std
    assert [warning.code for warning in drawn.warnings] == ["tmcmc-published"]


def test_every_stage_of_the_published_sampler_has_as_many_samples_as_the_first():
    drawn = PUBLISHED(gaussian().target, np.random.default_rng(7))
    assert len(drawn.flat) == 5000
    assert drawn.evaluations % 5000 == 0
    assert np.array_equal(drawn.flat[:, 0], drawn.flat[:, 3])  # companions stay with their points


@pytest.mark.parametrize("settings", [{"particles": 7}, {"samples": 50}])
def test_a_setting_that_cannot_work_is_refused_with_its_value(settings):
    with pytest.raises(UpdatingError, match=str(next(iter(settings.values())))):
        TemperingSettings(**settings)
