"""A turbine's own record of a change: what it says, and what it makes of a farm."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.farm.evidence import StackedEvidence, TurbineEvidence
from pipeline.farm.farm import PoolingSettings, pooled_farm
from pipeline.farm.own_changes import OwnChange, beside_the_others, own_change
from pipeline.farm.pooling import pooled
from pipeline.farm.results import farm_json
from pipeline.farm.settings import GibbsSettings, PopulationPrior
from pipeline.messages import RelativeStiffness
from pipeline.updating.population import SpringCoordinates
from pipeline.updating.prior import PARAMETER_NAMES
from tests.pipeline.farm.farms import NOMINAL, drawn_farm, event_of, posterior_of

QUICK = PoolingSettings(gibbs=GibbsSettings(chains=12, burn_in=40, sweeps=60, rounds=1))


def farm_of_five(lost: float, seed: int = 41):
    """Posteriors of five turbines, of which the first has lost a share of its k22."""
    posteriors, _ = drawn_farm(5, seed=seed)
    ratios = posteriors[0].draws[:, :3] / NOMINAL * [1, 1 - lost, 1]
    return [posterior_of("t1", ratios), *posteriors[1:]]


def test_a_tenth_of_k22_that_five_turbines_cannot_show_is_told_where_it_was_seen_to_go():
    posteriors = farm_of_five(0.1)
    unseen = pooled_farm(posteriors, QUICK)
    seen = pooled_farm([event_of(posteriors[0], -0.1), *posteriors], QUICK)
    assert unseen.turbines[0].outlier_probability < 0.5
    assert [each.outlying for each in seen.turbines] == [True, False, False, False, False]
    assert "by its own measurements k22 has changed by -10.0 %" in seen.turbines[0].text
    told = farm_json(seen)["turbines"]
    assert told[0]["own_change"]["k22"]["median"] == pytest.approx(-0.1)
    assert told[0]["own_change"]["k22"]["p05"] == pytest.approx(-0.1164, abs=2e-4)
    assert told[1]["own_change"] is None


def test_a_change_that_every_turbine_went_through_makes_none_of_them_unlike_the_others():
    posteriors, _ = drawn_farm(5, seed=42)
    events = [event_of(each, -0.1) for each in posteriors]
    found = pooled_farm([*posteriors, *events], QUICK)
    assert max(each.outlier_probability for each in found.turbines) < 0.3


def test_a_small_change_says_no_more_of_a_turbine_than_its_springs_do():
    posteriors, _ = drawn_farm(5, seed=43)
    found = pooled_farm([*posteriors, event_of(posteriors[0], -0.02)], QUICK)
    assert not found.turbines[0].outlying


def test_a_turbine_that_came_back_to_the_others_is_like_them():
    """It was a tenth stiffer than the others and lost that: its change is sure, and so is where it
    is now; only where the springs are can make the change count for much."""
    posteriors = farm_of_five(0.0, seed=44)
    changed = pooled_farm([*posteriors, event_of(posteriors[0], -0.1)], QUICK)
    assert not changed.turbines[0].outlying


def test_changes_add_up_and_the_last_is_as_all_windows_since_show_it():
    posterior = posterior_of("t1", np.exp(0.01 * np.random.default_rng(1).normal(size=(200, 3))))
    earlier, later = event_of(posterior, -0.05, windows_ago=9), event_of(posterior, -0.04)
    both = own_change(posterior, [later, earlier, later])
    np.testing.assert_allclose(both.logs, [0, np.log(0.95 * 0.96), 0], atol=1e-12)
    relative = tuple(
        RelativeStiffness(name, ratio, ratio - 0.005, ratio + 0.005, 0)
        for name, ratio in zip(PARAMETER_NAMES, (1.0, 0.97, 1.0), strict=True)
    )
    revised = own_change(replace(posterior, relative=relative), [later, earlier])
    assert revised.logs[1] == pytest.approx(np.log(0.95 * 0.97))
    assert revised.stds[1] < both.stds[1]


def test_errors_of_changes_one_after_the_other_are_independent():
    """Two of the same size and the same interval: √2 of one's standard deviation."""
    posterior = posterior_of("t1", np.ones((200, 3)))
    once = event_of(posterior, -0.05)
    before = event_of(posterior, -0.05, windows_ago=9)
    one, two = own_change(posterior, [once]), own_change(posterior, [once, before])
    np.testing.assert_allclose(two.stds, np.sqrt(2) * one.stds, rtol=1e-9)
    np.testing.assert_allclose(two.logs, 2 * one.logs, rtol=1e-9)


def test_what_no_foundation_explains_what_others_saw_and_what_came_later_do_not_count():
    posterior = posterior_of("t1", np.ones((200, 3)))
    drift = event_of(posterior, 0.0, kind="modal-drift")
    other = replace(event_of(posterior, -0.1), turbine="t2")
    later = replace(event_of(posterior, -0.1), time_ns=posterior.time_ns + 1)
    impossible = event_of(posterior, -1.2)
    assert own_change(posterior, [drift, other, later, impossible]) is None


def test_two_turbines_of_three_that_changed_leave_the_third_as_it_was():
    change = OwnChange(np.array([0.0, -0.1, 0.0]), np.full(3, 0.01), np.ones(3))
    first, second, third = beside_the_others([change, change, None])
    np.testing.assert_allclose(first.logs, [0, -0.05, 0])
    np.testing.assert_allclose(second.logs, first.logs)
    assert third is None


def test_a_change_in_coordinates_is_the_difference_of_the_springs():
    coordinates = SpringCoordinates(NOMINAL)
    before, after = np.ones(3), np.array([1.0, 0.99, 1.0])
    change = OwnChange(np.log(after / before), np.array([0.01, 0.02, 0.03]), after)
    step, covariance = change.in_coordinates(coordinates)
    exact = coordinates.of_ratios(after) - coordinates.of_ratios(before)
    np.testing.assert_allclose(step, exact, rtol=0.02)
    draws = change.stds * np.random.default_rng(2).standard_normal((20_000, 3))
    points = coordinates.of_ratios(after * np.exp(0.1 * draws)) - coordinates.of_ratios(after)
    np.testing.assert_allclose(np.cov(points.T) / 0.01, covariance, rtol=0.05, atol=2e-5)


def test_the_probability_with_a_change_is_the_integral_over_it_in_closed_form():
    """Two hundred turbines that are known exactly show mean and spread; of one more, springs and
    own change are two Gaussian observations of its difference."""
    prior = PopulationPrior(alike=1e3)
    spread, x, seen, std = 0.02, -0.06, -0.05, 0.01
    means = spread * np.random.default_rng(3).standard_normal(200)
    means = spread * (means - means.mean()) / means.std()
    known = [
        TurbineEvidence(f"t{i}", np.ones(1), np.array([[m]]), np.full((1, 1, 1), 1e-8))
        for i, m in enumerate(means)
    ]
    changed = TurbineEvidence(
        "x",
        np.ones(1),
        np.array([[x]]),
        np.full((1, 1, 1), 1e-8),
        change=(np.array([seen]), np.array([[std**2]])),
    )
    settings = GibbsSettings(chains=12, burn_in=40, sweeps=150, rounds=1)
    drawn = pooled(StackedEvidence.of([*known, changed]), prior, np.random.default_rng(4), settings)

    def density(outlying: bool) -> float:
        shared = prior.outlier_std**2 if outlying else 0.0
        rows = [[spread**2 + shared, shared], [shared, std**2 + prior.regular_change**2 + shared]]
        covariance, both = np.array(rows), np.array([x, seen])
        q = both @ np.linalg.solve(covariance, both)
        return float(np.exp(-q / 2) / np.sqrt(np.linalg.det(covariance)))

    one, other = density(True), density(False)
    # of regular turbines' changes a tenth says nothing: they are spread as an outlier's are
    wide = prior.outlier_std**2 + prior.regular_change**2 + std**2
    unsaid = (
        np.exp(-x * x / 2 / spread**2) / spread * np.exp(-seen * seen / 2 / wide) / np.sqrt(wide)
    )
    other = (1 - prior.other_causes) * other + prior.other_causes * unsaid
    odds = prior.outliers / prior.regular * one / other
    assert drawn.outlier_probabilities[-1] == pytest.approx(odds / (1 + odds), abs=0.05)
