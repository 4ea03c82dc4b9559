"""The contract of accuracy: what the product publishes, held against truths and a reference.

24 hours of modal estimates of 24 turbines, drawn by the independent simulator and kept in a file,
go through the updating at its default settings. Tolerances are several standard errors of what is
compared (given beside each), so that chance breaks none of them once in a thousand runs, and a
change of one per cent in what the sampler targets breaks them.
"""

from collections.abc import Sequence

import numpy as np
import pytest
from scipy.stats import binom

from pipeline.messages import FoundationPosterior
from tests.acceptance.cached_day import FOLDER, HOURS, KINDS, WINDOWS, cached_day, drawn_day
from tests.acceptance.contract import NAMES, Published, cases, of_day, reference
from tests.outside.model import NOMINAL

LEVEL = 0.9  # of the published intervals [-]
RARE = 1e-3  # chance by which a right product may fail [-]


@pytest.fixture(scope="module", params=list(cases()))
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


_kept: dict[str, list[FoundationPosterior]] = {}


@pytest.fixture(scope="module")
def posteriors(kind: str) -> list[FoundationPosterior]:
    """One for each hour, by default settings."""
    if kind not in _kept:
        _kept[kind] = of_day(kind, cases()[kind])
    return _kept[kind]


@pytest.fixture(scope="module")
def published(posteriors: list[FoundationPosterior]) -> list[Published]:
    return [Published.of(each) for each in posteriors]


@pytest.fixture(scope="module")
def expected(kind: str) -> list[Published]:
    return reference(kind)


def column(figures: Sequence[Published], name: str) -> np.ndarray:
    return np.array([getattr(each, name) for each in figures])


def test_every_hour_gives_a_posterior_of_all_its_windows(
    posteriors: list[FoundationPosterior],
) -> None:
    assert len(posteriors) == HOURS
    assert {each.n_windows for each in posteriors} == {WINDOWS}


def test_intervals_hold_the_truth_as_often_as_they_say(
    kind: str, posteriors: list[FoundationPosterior]
) -> None:
    """For each spring within the binomial's 99.9 % bounds about 90 % of 24."""
    truths = np.array([hour.theta for hour in cached_day(kind)])
    low, high = binom.ppf([RARE / 2, 1 - RARE / 2], HOURS, LEVEL)
    for index, name in enumerate(NAMES):
        springs = [each.parameter(name) for each in posteriors]
        held = sum(s.p05 <= k <= s.p95 for s, k in zip(springs, truths[:, index], strict=True))
        assert low <= held <= high, name


def test_errors_are_as_large_as_the_intervals_say(kind: str, published: list[Published]) -> None:
    """rms of (median − truth) over the standard deviation: 1 ± .45 is beyond 99.9 % of χ²(24)/24.
    The floors, which are wider than most modes need, may only make it smaller."""
    truths = np.array([hour.theta for hour in cached_day(kind)]) / NOMINAL
    errors = (column(published, "median") - truths) / column(published, "std")
    rms = np.sqrt(np.mean(errors**2, axis=0))
    assert np.all(rms < 1.45)
    assert np.all(rms > 0.45)


def test_half_the_hours_have_their_median_above_the_truth(
    kind: str, published: list[Published]
) -> None:
    """A bias that the interval hides still shows in the sign."""
    truths = np.array([hour.theta for hour in cached_day(kind)]) / NOMINAL
    above = np.sum(column(published, "median") > truths, axis=0)
    low, high = binom.ppf([RARE / 2, 1 - RARE / 2], HOURS, 0.5)
    assert np.all((low <= above) & (above <= high))


def test_published_quantiles_are_those_of_the_published_draws(
    posteriors: list[FoundationPosterior],
) -> None:
    """Shares of 1000 draws below p05, median, p95, averaged over 24 hours and 4 parameters: a
    standard error of √(.05 · .95 / 96 000) = .0007, some three times that as draws repeat."""
    shares = []
    for each in posteriors:
        for index, parameter in enumerate(each.parameters):
            draws = each.draws[:, index]
            shares.append(
                [np.mean(draws < q) for q in (parameter.p05, parameter.median, parameter.p95)]
            )
    assert np.mean(shares, axis=0) == pytest.approx([0.05, 0.5, 0.95], abs=0.005)


def test_standard_deviations_are_the_references_within_two_percent(
    published: list[Published], expected: list[Published]
) -> None:
    """An effective thousand draws know a std to 2.2 %, 24 hours together to .5 %."""
    ratios = column(published, "std") / column(expected, "std")
    assert np.mean(ratios, axis=0) == pytest.approx(1.0, abs=0.02)
    assert np.abs(ratios - 1).max() < 0.15


def test_widths_are_the_references_within_three_percent(
    published: list[Published], expected: list[Published]
) -> None:
    """A quantile at 5 % is known to 2.1 / √1000 std: a width to 2.8 %, 24 of them to .6 %."""
    ratios = column(published, "width") / column(expected, "width")
    assert np.mean(ratios, axis=0) == pytest.approx(1.0, abs=0.03)
    assert np.abs(ratios - 1).max() < 0.2
    sigma = column(published, "sigma") / column(expected, "sigma")
    assert np.mean(sigma) == pytest.approx(1.0, abs=0.03)


def test_medians_and_correlations_are_the_references(
    published: list[Published], expected: list[Published]
) -> None:
    """A median of an effective thousand draws is known to 1.25 / √1000 = .04 of a std."""
    apart = (column(published, "median") - column(expected, "median")) / column(expected, "std")
    assert np.sqrt(np.mean(apart**2)) < 0.07
    assert np.abs(apart).max() < 0.25
    assert np.abs(np.mean(apart, axis=0)).max() < 0.03
    correlations = column(published, "correlation") - column(expected, "correlation")
    assert np.abs(correlations).max() < 0.15
    assert np.abs(np.mean(correlations, axis=0)).max() < 0.02


def test_the_fit_is_judged_as_in_the_reference(
    posteriors: list[FoundationPosterior], published: list[Published], expected: list[Published]
) -> None:
    """χ² is taken at the median, whose scatter moves it by some per cent."""
    ratios = column(published, "reduced_chi_square") / column(expected, "reduced_chi_square")
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.02)
    shares = column(published, "paired_share") - column(expected, "paired_share")
    assert np.abs(shares).max() < 0.03
    assert np.mean([each.trusted for each in posteriors]) >= 22 / 24


# Each hour has draws of its own and the same model: what moves one moves every one.
SOME = range(0, HOURS, 6)
OTHERS = [hour for hour in range(HOURS) if hour not in SOME]


@pytest.mark.parametrize("hours", [SOME, pytest.param(OTHERS, marks=pytest.mark.nightly)])
@pytest.mark.parametrize("cached", KINDS)
def test_the_cached_hours_are_small_and_those_of_the_outside_model(
    cached: str, hours: Sequence[int]
) -> None:
    """Drawn again they agree to the single precision of the file."""
    assert (FOLDER / f"{cached}.npz").stat().st_size < 500_000
    day = cached_day(cached)
    for hour, drawn in zip(hours, drawn_day(cached, hours), strict=True):
        kept = day[hour]
        assert kept.theta == pytest.approx(drawn.theta)
        for one, other in zip(kept.estimates, drawn.estimates, strict=True):
            assert [m.pair_id for m in one.modes] == [m.pair_id for m in other.modes]
            for ours, theirs in zip(one.modes, other.modes, strict=True):
                assert ours.frequency == pytest.approx(theirs.frequency, rel=1e-6)
                assert ours.frequency_std == pytest.approx(theirs.frequency_std, rel=1e-5)
                assert ours.shape == pytest.approx(theirs.shape, abs=1e-5)
