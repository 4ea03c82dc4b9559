"""Means between stations are exact; stations of several tables are cut and joined."""

import numpy as np
import pytest

from sensors.structure.decks.stations import edges_of, joined, mean_between


def test_a_mean_is_that_of_the_lines_between_the_stations() -> None:
    x, y = np.array([0.0, 0.5, 1.0]), np.array([0.0, 1.0, 0.0])
    assert mean_between(x, y, 0.0, 1.0) == pytest.approx(0.5)
    assert mean_between(x, y, 0.25, 0.75) == pytest.approx(0.75)


def test_two_stations_at_one_place_are_a_step() -> None:
    x, y = np.array([0.0, 0.5, 0.5, 1.0]), np.array([2.0, 2.0, 1.0, 1.0])
    assert mean_between(x, y, 0.0, 0.5) == pytest.approx(2.0)
    assert mean_between(x, y, 0.5, 1.0) == pytest.approx(1.0)
    assert mean_between(x, y, 0.25, 0.75) == pytest.approx(1.5)


def test_stations_that_are_far_apart_are_cut() -> None:
    assert edges_of([0.0, 9.0, 3.0, 3.0], 3.0) == [0.0, 3.0, 6.0, 9.0]
    assert edges_of([0.0, 9.0], np.inf) == [0.0, 9.0]


def test_stations_of_two_tables_that_are_the_same_but_for_rounding_are_one() -> None:
    assert joined([0.0, 10.0], [0.0, 3.333, 9.99], [3.334, 5.0]) == [0.0, 10.0, 3.333, 5.0]
