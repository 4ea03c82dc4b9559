"""Poles of many model orders become modes: which belong together, and what they differ by."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.oma.ssi.stabilization import (
    PoleCloud,
    clusters,
    recurring,
    unexplained_spread,
)

ALONG = np.array([1.0, 0.0])


def turned(mac: float) -> np.ndarray:
    """A shape whose MAC with `ALONG` is given: cos² of the angle between them."""
    return np.array([np.sqrt(mac), np.sqrt(1 - mac)])


def cloud(
    frequencies: list[float],
    stds: list[float],
    shapes: list[np.ndarray],
    *,
    deviations: np.ndarray | None = None,
) -> PoleCloud:
    """One pole an order, by default with errors that are independent of each other."""
    n = len(frequencies)
    return PoleCloud(
        orders=np.arange(n),
        indices=np.zeros(n, dtype=int),
        frequencies=np.array(frequencies),
        damping_ratios=np.full(n, 0.01),
        shapes=np.array(shapes, dtype=complex),
        frequency_deviations=np.diag(stds) if deviations is None else deviations,
        damping_deviations=np.zeros((n, n)),
    )


@pytest.mark.parametrize(("mac", "n_modes"), [(0.99, 1), (0.93, 1), (0.87, 2), (0.5, 2)])
def test_poles_of_one_frequency_are_one_mode_only_if_their_shapes_agree(
    mac: float, n_modes: int
) -> None:
    """A MAC of .9 is an angle of 18°: what two orders make of one mode differs by less."""
    shapes = [ALONG] * 10 + [turned(mac)] * 10
    found = clusters(cloud([1.0] * 20, [1e-3] * 20, shapes), n_orders=20, minimum_presence=0.4)
    assert len(found) == n_modes
    assert sum(len(each.members) for each in found) == 20


def test_poles_that_come_back_in_few_orders_are_worth_no_uncertainty() -> None:
    """At 1 Hz in ten orders of twenty, at 2 Hz in five, at 3 Hz in ten whose shapes differ."""
    frequencies = [1.0] * 10 + [2.0] * 5 + [3.0] * 5
    shapes = [ALONG] * 15 + [turned(0.5)] * 2 + [turned(0.0)] * 3
    poles = cloud(frequencies, [1e-3] * 20, shapes)
    found = recurring(poles, n_orders=20, minimum_presence=0.4)
    assert found.tolist() == [True] * 10 + [False] * 10
    again = recurring(poles, n_orders=20, minimum_presence=0.25)
    assert again.tolist() == [True] * 15 + [False] * 5


def spread_with(blurred_std: float) -> float:
    """Of twenty sharp poles at 1 Hz, whose errors are the same, and a blurred one .19 % higher."""
    deviations = np.zeros((21, 2))
    deviations[:20, 0], deviations[20, 1] = 1e-5, blurred_std
    poles = cloud([1.0] * 20 + [1.0019], [], [ALONG] * 21, deviations=deviations)
    (mode,) = clusters(poles, n_orders=21, minimum_presence=0.5)
    return mode.frequency_spread


def test_a_pole_known_half_as_well_adds_a_quarter_as_much_to_the_spread() -> None:
    """Poles are weighted by their inverse variances, as independent estimates of one frequency."""
    assert spread_with(1e-4) ** 2 / spread_with(2e-4) ** 2 == pytest.approx(4, rel=0.05)


def test_three_four_five() -> None:
    """Estimates five apart, of which a standard deviation of three is explained, leave four."""
    differences, deviations = np.full(8, 5.0), np.full((8, 9), 1.0)
    spread = unexplained_spread(differences, deviations, weights=np.ones(8))
    assert spread == pytest.approx(4.0)


def test_what_estimates_differ_by_is_not_counted_twice() -> None:
    """Independent estimates whose stds are right leave on average no spread to be explained."""
    generator, n = np.random.default_rng(21), 20_000
    stds = generator.uniform(0.5, 2.0, n)
    differences = stds * generator.standard_normal(n)
    spread = unexplained_spread(differences, stds[:, None], weights=stds**-2)
    assert spread < 0.15 * stds.mean()
    truly_apart = differences + 1.5 * generator.standard_normal(n)
    spread = unexplained_spread(truly_apart, stds[:, None], weights=np.ones(n))
    assert spread == pytest.approx(1.5, rel=0.03)


def test_of_two_poles_of_one_order_the_nearer_one_to_the_centre_belongs_to_the_mode() -> None:
    """Twenty orders at 1 Hz; the last has another pole .15 % away, the noise's."""
    poles = cloud([1.0] * 20 + [1.0015], [1e-4] * 21, [ALONG] * 21)
    twice = replace(poles, orders=np.append(np.arange(20), 19))
    (mode,) = clusters(twice, n_orders=20, minimum_presence=0.5)
    assert len(mode.members) == 20
    assert 20 not in mode.members


def test_poles_have_the_spread_of_damping_that_they_differ_by() -> None:
    """Half of them are .004 above the one that is kept, with the same weight: .004 / √2."""
    poles = cloud([1.0] * 20, [1e-3] * 20, [ALONG] * 20)
    (alike,) = clusters(poles, n_orders=20, minimum_presence=0.5)
    assert alike.damping_spread == 0.0
    ratios = np.where(np.arange(20) % 2 == 0, 0.01, 0.014)
    (apart,) = clusters(replace(poles, damping_ratios=ratios), n_orders=20, minimum_presence=0.5)
    assert apart.damping_spread == pytest.approx(0.004 / np.sqrt(2))


@pytest.mark.parametrize("beside", [0.997, 1.003])
def test_of_two_poles_of_one_order_the_one_nearer_to_the_mode_is_its_member(beside: float) -> None:
    """Ten orders have a pole at 1 Hz; five of them another one .3 % beside it, as sharp."""
    poles = cloud([1.0] * 10 + [beside] * 5, [2e-3] * 15, [ALONG] * 15)
    poles = replace(poles, orders=np.r_[np.arange(10), np.arange(5)])
    (mode,) = clusters(poles, n_orders=10, minimum_presence=0.6)
    assert sorted(mode.members) == list(range(10))
    assert mode.presence == 1.0


def test_a_mode_is_kept_from_the_least_number_of_orders_on() -> None:
    for n_seen, n_modes in ((4, 1), (3, 0)):
        poles = cloud([1.0] * n_seen, [1e-3] * n_seen, [ALONG] * n_seen)
        assert len(clusters(poles, n_orders=10, minimum_presence=0.4)) == n_modes
    assert clusters(cloud([1.0], [1e-3], [ALONG]), n_orders=1, minimum_presence=0.4) == []


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
@pytest.mark.parametrize(
    ("apart", "std", "n_modes"),
    [
        (0.01, 0.003, 1),  # 3 √2 stds are more than what lies between
        (0.01, 0.001, 2),
        (0.0015, 1e-6, 1),  # whatever their stds: twice a thousandth may be one mode
        (0.03, 0.02, 2),  # and three hundredths never are
    ],
)
def test_poles_are_one_mode_by_what_lies_between_them_over_their_frequency(
    apart: float, std: float, n_modes: int, scale: float
) -> None:
    frequencies = [scale] * 10 + [scale * (1 + apart)] * 10
    poles = cloud(frequencies, [std * scale] * 20, [ALONG] * 20)
    found = clusters(poles, n_orders=20, minimum_presence=0.4)
    assert len(found) == n_modes
