"""What is thought of a change between two periods before any mode is looked at."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from pipeline.updating.structural.periods.relative_change import CHANGE_STDS, _prior
from pipeline.updating.structural.prior import JointCoordinates, UncertainFigure

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
COORDINATES = JointCoordinates(NOMINAL, (UncertainFigure("steel_modulus", 0.01),), 0.3)
N, LEVEL = COORDINATES.n_dim, 4
OWN = np.array([0, 1, 2, LEVEL])


def beforehand(level_correlation: float) -> np.ndarray:
    """Covariance of both periods' coordinates."""
    fit = cast(Any, SimpleNamespace(coordinates=COORDINATES))
    return np.linalg.inv(_prior(fit, OWN, level_correlation))


@pytest.mark.parametrize("spring", [0, 1, 2])
def test_springs_beforehand_differ_little_between_two_periods(spring: int) -> None:
    """Two of precision p each, tied by c: the difference has 2 / (p + 2 c), the sum 2 / p."""
    covariance = beforehand(0.0)
    then, now = np.eye(N + 4)[[spring, N + spring]]
    p, c = COORDINATES.prior_precision[spring, spring], CHANGE_STDS[spring] ** -2
    assert (now - then) @ covariance @ (now - then) == pytest.approx(2 / (p + 2 * c))
    assert (now + then) @ covariance @ (now + then) == pytest.approx(2 / p)


@pytest.mark.parametrize("correlation", [0.0, 0.6, -0.4])
def test_levels_of_two_periods_are_correlated_as_stated(correlation: float) -> None:
    covariance = beforehand(correlation)
    both = np.ix_([LEVEL, N + 3], [LEVEL, N + 3])
    np.testing.assert_allclose(covariance[both], [[1.0, correlation], [correlation, 1.0]])


def test_a_figure_of_the_structure_is_one_for_both_periods() -> None:
    assert beforehand(0.5).shape == (N + 4, N + 4)
    assert beforehand(0.5)[3, 3] == pytest.approx(1 / COORDINATES.prior_precision[3, 3])
