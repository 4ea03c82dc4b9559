"""What is published of a posterior is what its draws say."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import FoundationPosterior
from pipeline.updating.acceptance import AcceptanceSettings
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.posterior_message import spring_summaries
from pipeline.updating.prior import Prior
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.importance import ImportanceSettings
from pipeline.updating.samplers.registry import SamplingSettings
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.updater import FoundationUpdater
from tests.pipeline.updating.small_tower import LAYOUT, NOMINAL, LinearTower, drawn_estimate

TRUTH = np.array([1.1, 0.9, 0.95])
N_DRAWS = 1000  # as many as a message holds: what is published are all the draws
SETTINGS = UpdatingSettings(
    pairing=PairingSettings(search_draws=200, tried=6, refined=2),
    likelihood=LikelihoodSettings(sigma_points=40),
    sampling=SamplingSettings(importance=ImportanceSettings(effective_draws=400, draws=N_DRAWS)),
)


def posterior_of(settings: UpdatingSettings, *, tower: LinearTower | None = None):
    tower = tower or LinearTower()
    updater = FoundationUpdater(tower, LAYOUT, settings, seed=3)
    estimate = drawn_estimate(TRUTH, np.random.default_rng(5), tower=tower)
    _, posterior = updater.updated(updater.initial_state(), estimate)
    assert isinstance(posterior, FoundationPosterior)
    return posterior


@pytest.fixture(scope="module")
def posterior():
    return posterior_of(SETTINGS)


def test_the_published_interval_holds_nine_tenths_of_the_draws_and_its_median_halves_them(
    posterior,
):
    assert posterior.draws.shape[0] == N_DRAWS
    for column, parameter in enumerate(posterior.parameters):
        draws = np.sort(posterior.draws[:, column])
        published = (parameter.p05, parameter.median, parameter.p95)
        for share, quantile in zip((0.05, 0.5, 0.95), published, strict=True):
            rank = round(share * N_DRAWS)  # between this draw and the next, give or take one
            assert draws[rank - 2] <= quantile <= draws[rank + 1]


def test_draws_and_quantiles_are_in_the_units_of_the_springs(posterior):
    for column, (parameter, nominal) in enumerate(
        zip(posterior.parameters[:3], NOMINAL, strict=True)
    ):
        assert parameter.nominal == nominal
        assert 0.5 < parameter.median / nominal < 2
        assert 0.5 < np.median(posterior.draws[:, column]) / nominal < 2
    assert [each.unit for each in posterior.parameters] == ["N/m", "N·m/rad", "N/rad", "-"]


def test_the_published_correlation_is_that_of_the_draws(posterior):
    of_draws = np.corrcoef(posterior.draws[:, :3].T)
    assert posterior.correlation == pytest.approx(of_draws, abs=1e-6)


def test_contraction_is_the_intervals_share_of_the_priors_nine_tenths(posterior):
    """The prior's 90 % interval is nine tenths of its box: 0 where nothing, 1 where all is known
    would be another convention; whichever it is, it follows from p05, p95 and the box."""
    bounds = SETTINGS.prior
    extent = 0.9 * (bounds.highest_ratio - bounds.lowest_ratio)
    for parameter in posterior.parameters[:3]:
        share = (parameter.p95 - parameter.p05) / parameter.nominal / extent
        assert parameter.contraction == pytest.approx(share, rel=1e-9) or (
            parameter.contraction == pytest.approx(1 - share, rel=1e-9)
        )


@pytest.mark.parametrize("ratio", [0.3, 1.0, 4.0])
def test_springs_known_to_a_factor_beforehand_are_compared_by_their_factors(ratio: float) -> None:
    """Known to a fifth of the prior's interval, whether soft or stiff; k12 is negative."""
    log_interval = 3.0
    nominal = np.array([2.0, 5.0, -3.0])
    ratios = ratio * np.exp(log_interval / 5 * np.linspace(-0.5, 0.5, 1001) / 0.9)
    drawn = np.column_stack([*[ratios] * 3, np.full(1001, 0.5)])
    summaries = spring_summaries(drawn, Prior(nominal, SETTINGS.prior), np.full(3, log_interval))
    assert [each.contraction for each in summaries[:3]] == pytest.approx([0.8] * 3, abs=0.01)


def test_pairs_show_the_model_at_the_median_not_at_nominal(posterior):
    medians = np.array([each.median for each in posterior.parameters[:3]])
    modes = LinearTower().modal(medians[None])
    frequencies = dict(zip(posterior.model_labels, posterior.model_frequencies, strict=True))
    for pair in posterior.pairs:
        assert pair.model_frequency == frequencies[pair.model]
        assert pair.mac > 0.9
    expected = np.sort(modes.frequencies[0])
    assert np.sort(posterior.model_frequencies) == pytest.approx(expected, rel=2e-3)
    nominal = np.sort(LinearTower().modal(NOMINAL[None]).frequencies[0])
    assert np.abs(expected / nominal - 1).max() > 5e-3


def test_the_information_of_all_modes_adds_up_to_the_whole(posterior):
    shares = np.array([pair.information for pair in posterior.pairs])
    assert np.all(shares >= 0)
    assert shares.sum() == pytest.approx(1.0, rel=1e-6)


def test_frequencies_that_fit_have_misfits_of_about_one_standard_deviation(posterior):
    misfits = np.array([pair.misfit for pair in posterior.pairs])
    assert np.sqrt(np.mean(misfits**2)) < 2
    assert posterior.reduced_chi_square < 3


def test_chains_that_are_too_short_are_not_to_be_trusted_although_all_modes_fit():
    short = SamplerSettings(
        walkers=16, burn_in=4, block=4, most_steps=8, effective_draws=5000,
        chain_in_autocorrelation_times=1000.0,
    )  # fmt: skip
    chained = replace(SETTINGS, sampling=SamplingSettings(method="emcee"), sampler=short)
    posterior = posterior_of(chained)
    codes = {warning.code for warning in posterior.warnings}
    assert codes & {"chain-short", "not-converged"}
    assert not codes & {"misfit", "few-pairs", "pairing-cost"}
    assert not posterior.trusted
    assert posterior_of(SETTINGS).trusted


def test_chains_that_disagree_more_than_the_guard_allows_are_named():
    chained = replace(SETTINGS, sampling=SamplingSettings(method="emcee"))
    strict = replace(chained, guards=AcceptanceSettings(rhat=1.0))
    posterior = posterior_of(strict)
    assert 1.0 < posterior.rhat < 1.05
    assert "not-converged" in {warning.code for warning in posterior.warnings}
    assert "not-converged" not in {warning.code for warning in posterior_of(chained).warnings}
