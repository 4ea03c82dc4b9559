"""A farm of posteriors: errors shrink, an outlier stands out, and what cannot be pooled is told."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.farm.farm import (
    Interval,
    PoolingSettings,
    _sentence,
    in_order,
    members_of,
    pooled_farm,
)
from pipeline.farm.settings import FarmError, GibbsSettings
from tests.pipeline.farm.farms import (
    NOMINAL,
    SPREAD,
    drawn_farm,
    of_one_description,
    posterior_of,
    untrusted,
)

QUICK = PoolingSettings(gibbs=GibbsSettings(chains=16, burn_in=60, sweeps=80, rounds=1))
BRIEF = PoolingSettings(gibbs=GibbsSettings(chains=16, burn_in=30, sweeps=30, rounds=1))


@pytest.fixture(scope="module")
def farm():
    """Twenty turbines, one of which has 15 % less k22."""
    posteriors, _ = drawn_farm(20, seed=5, outlier=7)
    return pooled_farm(posteriors, QUICK)


def test_the_turbine_with_less_stiffness_is_the_only_outlier_and_says_so(farm):
    assert [each.turbine for each in farm.turbines if each.outlying] == ["t7"]
    assert farm.turbines[6].text.startswith("t7: k22 1")
    assert "below the farm's, unlike the others with probability" in farm.turbines[6].text
    assert farm.turbines[6].deviations[1].p05 < -0.15 < farm.turbines[6].deviations[1].p95


def test_a_pooled_interval_holds_nine_of_ten_of_its_draws(farm):
    for turbine in farm.turbines:
        for spring, draws in zip(turbine.pooled, turbine.draws.T, strict=True):
            assert np.mean(draws < spring.p05) == pytest.approx(0.05, abs=0.02)
            assert np.mean(draws > spring.p95) == pytest.approx(0.05, abs=0.02)


def test_the_farm_knows_how_much_its_turbines_differ_and_about_what(farm):
    for each in farm.spread:
        assert each.p05 < SPREAD < each.p95
    for spring in farm.centre:  # the truths' mean is known to SPREAD / √20
        assert spring.median / spring.nominal == pytest.approx(1.0, abs=3 * SPREAD / np.sqrt(20))


def test_errors_of_a_farm_fall_by_a_quarter_and_intervals_still_hold():
    own, shrunk, held = [], [], []
    for seed in (31, 32):
        posteriors, truth = drawn_farm(20, seed=seed)
        found = pooled_farm(posteriors, BRIEF)
        for each, true in zip(found.turbines, truth, strict=True):
            own.append([s.median / s.nominal / t - 1 for s, t in zip(each.own, true, strict=True)])
            shrunk.append(
                [s.median / s.nominal / t - 1 for s, t in zip(each.pooled, true, strict=True)]
            )
            held.append(
                [s.p05 <= t * s.nominal <= s.p95 for s, t in zip(each.pooled, true, strict=True)]
            )
    assert np.median(np.abs(shrunk)) < 0.75 * np.median(np.abs(own))
    # of 120, a turbine's three hardly apart from each other: as 50, three deviations below .9
    assert np.mean(held) > 0.77


def test_an_error_of_the_description_is_as_large_for_a_farm_as_for_one_turbine():
    """Twenty turbines of which every spring is known to a few percent of its own, to 10 % by one
    figure of the description: pooled, that stays; how they differ is known as well as ever."""
    posteriors, truth = of_one_description(20, seed=4)
    found = pooled_farm(posteriors, BRIEF)
    widths = [(k.p95 - k.p05) / 2 / k.median for each in found.turbines for k in each.pooled]
    assert min(widths) > 0.14  # 1.64 × .1, less what some hundred draws of it err by
    centre = np.exp(np.log(truth).mean(axis=0))
    off = [
        [abs(1 + each.median - t) for each, t in zip(turbine.deviations, true, strict=True)]
        for turbine, true in zip(found.turbines, truth / centre, strict=True)
    ]
    assert np.median(off) < 0.015
    assert max(each.half_width for turbine in found.turbines for each in turbine.deviations) < 0.06
    assert found.population.figures == ("added_mass",)


def test_the_order_of_the_posteriors_makes_no_difference():
    posteriors, _ = drawn_farm(3, seed=6)
    one, other = (pooled_farm(each, BRIEF) for each in (posteriors, posteriors[::-1]))
    np.testing.assert_array_equal(one.turbines[0].draws, other.turbines[0].draws)
    assert [each.turbine for each in other.turbines] == ["t1", "t2", "t3"]


def test_the_latest_posterior_of_a_turbine_is_the_one_that_counts():
    posteriors, _ = drawn_farm(2, seed=7)
    newer = replace(posteriors[0], window=3, time_ns=posteriors[0].time_ns + 1, n_windows=4)
    found = pooled_farm([newer, *posteriors], BRIEF)
    assert [each.n_windows for each in found.turbines] == [4, 1]


def test_an_embedded_piles_negative_coupling_is_pooled_alike():
    nominal = NOMINAL * [1, 1, -1]
    posteriors, _ = drawn_farm(8, seed=8, nominal=nominal)
    found = pooled_farm(posteriors, BRIEF)
    coupling = found.turbines[0].pooled[2]
    assert coupling.p05 < coupling.median < coupling.p95 < 0
    assert abs(coupling.median / coupling.nominal - 1) < 0.1


def test_what_cannot_be_pooled_is_left_out_with_its_reason():
    posteriors, _ = drawn_farm(6, seed=9)
    posteriors[1] = untrusted(posteriors[1])
    posteriors[2] = replace(posteriors[2], population="19 turbines")
    posteriors[3] = posterior_of("t4", np.ones((1000, 3)), nominal=2 * NOMINAL)
    posteriors[4] = replace(posteriors[4], draws=posteriors[4].draws[:10])
    posteriors.append(
        posterior_of("t7", np.array([1.0, 1.0, 2.0]) + 1e-3 * np.eye(3)[np.arange(100) % 3])
    )
    posteriors.append(posterior_of("t8", np.exp(0.01 * np.ones((100, 3)))))
    found = pooled_farm([*posteriors[:-1]], BRIEF)
    reasons = {each.turbine: each.reason for each in found.left_out}
    assert reasons.keys() == {"t2", "t3", "t4", "t5", "t7"}
    assert "not trusted" in reasons["t2"]
    assert "19 turbines" in reasons["t3"]
    assert "nominal" in reasons["t4"]
    assert "10 draws" in reasons["t5"]
    assert "no foundation" in reasons["t7"]


def test_one_turbine_is_no_farm():
    posteriors, _ = drawn_farm(2, seed=10)
    with pytest.raises(FarmError, match=r"1 of 2 turbines can be pooled.*t2: its posterior is not"):
        pooled_farm([posteriors[0], untrusted(posteriors[1])])
    with pytest.raises(FarmError, match=r"^1 of 1 turbine can be pooled; at least 2 are needed"):
        pooled_farm([posteriors[0]])


def test_turbine_two_comes_before_turbine_ten():
    assert sorted(["t10", "t2", "b", "t1"], key=in_order) == ["b", "t1", "t2", "t10"]


def test_the_population_is_where_the_farm_is_and_wider_than_its_mean(farm):
    drawn = np.log(farm.population.draws(20_000, np.random.default_rng(11)))
    middle = [s.median / s.nominal for s in farm.centre]
    np.testing.assert_allclose(np.median(drawn, axis=0), np.log(middle), atol=0.004)
    low, high = np.quantile(drawn, [0.16, 0.84], axis=0)
    np.testing.assert_array_less([s.p05 for s in farm.spread], (high - low) / 2)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1e10])
def test_one_impossible_draw_leaves_a_turbine_out(bad: float) -> None:
    rng = np.random.default_rng(1)
    whole = [posterior_of(f"t{n}", 1 + 0.01 * rng.normal(size=(200, 3))) for n in range(3)]
    draws = whole[1].draws.copy()
    draws[7, 0] = bad
    members, left_out = members_of([whole[0], replace(whole[1], draws=draws), whole[2]])
    assert [each.turbine for each in members] == ["t0", "t2"]
    assert left_out[0].reason == "its posterior has springs that no foundation has"


@pytest.mark.parametrize(
    ("sign", "probability", "words"),
    [
        (-1, 0.9996, "below the farm's, unlike the others with probability > .999"),
        (1, 0.55, "above the farm's, unlike the others with probability .550"),
        (1, 0.549, "above the farm's, like the others with probability .451"),
    ],
)
def test_a_turbine_is_unlike_the_others_from_the_probability_that_marks_it(
    sign: int, probability: float, words: str
) -> None:
    p05, p95 = sorted((sign * 0.07, sign * 0.12))
    as_all = Interval(0.0, -0.01, 0.01)
    off = [as_all, Interval(sign * 0.1, p05, p95), as_all]
    text = f"t1: k22 10.0 % [7.0, 12.0] {words}"
    assert _sentence("t1", off, 1, probability) == text
