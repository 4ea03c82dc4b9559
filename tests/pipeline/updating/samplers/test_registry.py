"""Samplers by name: any of them stands in for another."""

from typing import get_args

import numpy as np
import pytest

from pipeline.updating.prior import Prior, UpdatingError, log_prior_volume
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.interface import CountedDensity
from pipeline.updating.samplers.registry import (
    SamplerName,
    SamplingSettings,
    ensemble_start,
    sampler_of,
)
from pipeline.updating.samplers.tmcmc import PublishedSettings, TemperingSettings
from sensors.settings import settings_from_table
from tests.pipeline.updating.known_densities import COVARIANCE, MEAN, gaussian
from tests.pipeline.updating.small_tower import NOMINAL

SETTINGS = {
    "tempering": TemperingSettings(samples=4000),
    "published": PublishedSettings(samples=8000),
}


@pytest.mark.parametrize("name", get_args(SamplerName))
def test_every_sampler_draws_the_same_posterior(name):
    sampler = sampler_of(SamplingSettings(method=name, **SETTINGS), SamplerSettings())
    drawn = sampler(gaussian().target, np.random.default_rng(1))
    deviations = np.sqrt(np.diag(COVARIANCE))
    assert drawn.sampler == name
    assert drawn.ess >= 1000
    assert drawn.flat.shape[1] == 4
    assert (drawn.flat[:, :3].mean(axis=0) - MEAN) / deviations == pytest.approx(0, abs=0.2)
    assert drawn.flat[:, :3].std(axis=0) / deviations == pytest.approx(1, abs=0.12)


def test_chains_start_where_the_last_posterior_was_while_the_peak_lies_there():
    warm = np.random.default_rng(2).multivariate_normal(MEAN, COVARIANCE, size=400)
    target = gaussian(ensemble=warm).target
    start = ensemble_start(target, CountedDensity(target.log_density), 40, np.random.default_rng(3))
    assert set(map(tuple, start)) <= set(map(tuple, warm))


def test_chains_start_round_the_peak_when_the_last_posterior_is_somewhere_else():
    stale = np.random.default_rng(4).normal(0.0, 0.01, size=(400, 3))
    target = gaussian(ensemble=stale).target
    start = ensemble_start(target, CountedDensity(target.log_density), 40, np.random.default_rng(5))
    assert start.shape == (40, 3)
    assert np.abs(start - MEAN).max() < 0.3


@pytest.mark.parametrize(("moved", "warm"), [(4.5, True), (5.5, False)])
def test_the_peak_lies_in_the_last_posterior_up_to_five_of_its_standard_deviations(moved, warm):
    middle = MEAN + moved * np.sqrt(np.diag(COVARIANCE)) * np.array([1.0, 0.0, 0.0])
    along = np.diag(np.diag(COVARIANCE))
    ensemble = np.random.default_rng(6).multivariate_normal(middle, along, size=4000)
    target = gaussian(ensemble=ensemble).target
    start = ensemble_start(target, CountedDensity(target.log_density), 40, np.random.default_rng(7))
    assert (set(map(tuple, start)) <= set(map(tuple, ensemble))) == warm


def test_chains_that_were_too_short_are_not_passed_over_in_silence():
    short = SamplerSettings(burn_in=5, block=10, most_steps=20)
    sampler = sampler_of(SamplingSettings(method="emcee"), short)
    drawn = sampler(gaussian().target, np.random.default_rng(6))
    assert "chain-short" in [warning.code for warning in drawn.warnings]


def test_a_scenario_with_an_unknown_sampler_is_told_which_there_are():
    with pytest.raises(UpdatingError, match="tmcmc-published"):
        settings_from_table(SamplingSettings, {"method": "nuts"}, "a.toml", UpdatingError)
    with pytest.raises(UpdatingError, match="importance, emcee"):
        SamplingSettings(method="nuts")


@pytest.mark.parametrize("sign", [1, -1])
def test_the_prior_s_volume_is_the_share_of_the_box_with_positive_definite_springs(sign):
    prior = Prior(NOMINAL * [1, 1, sign])
    points = np.random.default_rng(7).uniform(0.25, 4.0, size=(400_000, 3))
    expected = np.log(prior.supports(points).mean() * 3.75**3)
    assert log_prior_volume(prior) == pytest.approx(expected, abs=0.005)


def test_chains_never_start_where_the_density_is_nothing():
    """The box grew smaller: one of the last draws is no longer possible."""
    warm = np.random.default_rng(2).multivariate_normal(MEAN, COVARIANCE, size=40)

    def without_one(points):
        values, *more = gaussian().target.log_density(points)
        return (np.where((points == warm[3]).all(axis=-1), -np.inf, values), *more)

    target = gaussian(ensemble=warm).target
    start = ensemble_start(target, CountedDensity(without_one), 40, np.random.default_rng(3))
    assert np.isfinite(without_one(start)[0]).all()
