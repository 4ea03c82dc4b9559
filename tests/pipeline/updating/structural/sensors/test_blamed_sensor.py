"""Which sensor is to blame, by what fits without it."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.updating.structural.joint_fit import LARGEST_COST
from pipeline.updating.structural.sensors.blamed_sensor import blamed_sensor


def searched(
    elevations: list[float], costs: dict[tuple[int, ...], float | None], with_all: float
) -> tuple[int, ...] | None:
    """Channels that are blamed where the fit without some costs so much [per degree of freedom]."""
    peaks = {
        left: None if c is None else SimpleNamespace(relative_cost=c, misfit=c, u=None)
        for left, c in costs.items()
    }
    fit: Any = SimpleNamespace(
        settings=SimpleNamespace(good_cost=1.5),
        model=SimpleNamespace(layout=SimpleNamespace(elevations=np.array(elevations))),
        best=lambda left, *_, **__: peaks[left],
    )
    evidence: Any = SimpleNamespace(without_channels=lambda channels: channels)
    peak: Any = SimpleNamespace(relative_cost=with_all, misfit=with_all, u=None)
    found = blamed_sensor(fit, evidence, peak)
    return None if found is None else found[0]


@pytest.mark.parametrize("with_all", [2.0, 4.0])
def test_the_sensor_is_blamed_without_which_the_others_fit(with_all: float) -> None:
    costs: dict[tuple[int, ...], float | None] = {(0, 2): 3.0, (1, 3): 0.9}
    assert searched([41.0, 80.0, 41.0, 80.0], costs, with_all) == (1, 3)


def test_no_sensor_is_blamed_where_the_others_do_not_fit_either() -> None:
    assert searched([41.0, 80.0], {(0,): 3.0, (1,): 1.6}, 4.0) is None


def test_the_only_sensor_is_never_blamed() -> None:
    """Without it frequencies alone are compared, which fit with most descriptions."""
    assert searched([80.0, 80.0], {(0, 1): 0.9}, 4.0) is None


@pytest.mark.parametrize("costs", [(0.9, 1.4), (1.4, 0.9)])
def test_of_two_sensors_the_one_is_blamed_without_which_the_others_fit_best(
    costs: tuple[float, float],
) -> None:
    found = searched([41.0, 80.0], {(0,): costs[0], (1,): costs[1]}, 2.0)
    assert found == (int(costs[1] < costs[0]),)


def test_the_search_ends_at_the_first_sensor_whose_absence_explains_a_great_misfit() -> None:
    assert searched([41.0, 80.0], {(0,): 1.4}, 2 * LARGEST_COST) == (0,)  # no cost of the other


@pytest.mark.parametrize("first", [None, 0.9])
def test_a_sensor_without_which_no_structure_is_found_is_not_to_blame(first: float | None) -> None:
    found = searched([41.0, 80.0], {(0,): first, (1,): 1.0 if first is None else None}, 2.0)
    assert found == (int(first is None),)
