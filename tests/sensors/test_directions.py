"""North lies between 359 and 1 degrees."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.directions import DirectionSum, mean_direction, turned_from


@pytest.mark.parametrize(
    ("directions", "mean"),
    [
        ([0.0, 0.0], 0.0),
        ([30.0] * 7, 30.0),
        ([359.7, 0.3], 0.0),
        ([359.0, 0.0], 359.5),
        ([360.0], 0.0),
        ([170.0, 200.0], 185.0),
        ([-170.0, 160.0], 175.0),
        ([-30.0, -20.0], -25.0),
        ([math.nan, 1.0], math.nan),
        ([1.0, math.nan], math.nan),
        ([], math.nan),
    ],
)
def test_a_mean_is_that_of_the_unit_vectors(directions: list[float], mean: float) -> None:
    assert mean_direction(np.array(directions)) == pytest.approx(mean, abs=1e-9, nan_ok=True)


@given(st.floats(0.0, 360.0), st.lists(st.floats(-40.0, 40.0), min_size=1, max_size=9))
def test_a_mean_turns_with_its_directions(turn: float, around: list[float]) -> None:
    """Within ± 40° the mean of the vectors lies within the directions, wherever north is."""
    directions = (np.array(around) + turn) % 360.0
    mean = mean_direction(directions)
    assert 0.0 <= mean < 360.0
    assert min(around) - 1e-6 <= turned_from(np.array([mean]), turn)[0] <= max(around) + 1e-6
    assert np.ptp(turned_from(directions, mean)) == pytest.approx(np.ptp(around), abs=1e-6)


def test_a_sum_may_come_in_pieces() -> None:
    directions = np.array([350.0, 5.0, 20.0])
    pieces = DirectionSum().plus(directions[:2]).plus(directions[2:]).plus(directions[3:])
    assert pieces.mean == mean_direction(directions) == 5.0
