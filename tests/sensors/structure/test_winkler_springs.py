"""A pile on Winkler springs against what is known of such piles."""

import numpy as np
import pytest

from sensors.structure.description import load_turbine
from sensors.structure.winkler_springs import PileInSoil

# A long pile's head in soil whose stiffness grows with depth, T = (EI / n_h)^(1/5):
# deflection 2.435 and slope 1.623 under a force, 1.623 and 1.749 under a moment
# (Reese and Matlock 1956)
FLEXIBILITY = np.array([[2.435, -1.623], [-1.623, 1.749]])


def test_a_long_piles_head_is_as_stiff_as_reese_and_matlock_say():
    rigidity, gradient = 4.5e12, 2e8
    T = (rigidity / gradient) ** 0.2
    pile = PileInSoil(length=6 * T, bending_rigidity=rigidity, soil_gradient=gradient)
    scale = np.array([T**1.5, T**0.5])
    flexibility = FLEXIBILITY * np.outer(scale, scale) / rigidity
    stiffness = np.linalg.inv(flexibility)
    expected = [stiffness[0, 0], stiffness[1, 1], abs(stiffness[0, 1])]
    assert pile.springs(0.0) == pytest.approx(expected, rel=0.01)


def test_scour_of_a_long_pile_is_a_free_cantilever_on_a_shorter_one():
    """Soil gone to depth s and the same gradient below: flexibility of the pile there, and of the
    free stretch above it."""
    rigidity, gradient, depth = 4.5e12, 2e8, 4.0
    whole = PileInSoil(length=60.0, bending_rigidity=rigidity, soil_gradient=gradient)
    shorter = PileInSoil(length=56.0, bending_rigidity=rigidity, soil_gradient=gradient)
    k11, k22, k12 = shorter.springs(0.0)
    below = np.linalg.inv([[k11, -k12], [-k12, k22]])
    free = np.array([[depth**3 / 3, -(depth**2) / 2], [-(depth**2) / 2, depth]]) / rigidity
    stiffness = np.linalg.inv(_carried(below, depth) + free)
    expected = [stiffness[0, 0], stiffness[1, 1], abs(stiffness[0, 1])]
    assert whole.springs(depth) == pytest.approx(expected, rel=0.005)


def _carried(below, depth):
    """Flexibility of the head by the soil's part alone, u and slope positive alike."""
    u, cross, slope = below[0, 0], below[0, 1], below[1, 1]
    return np.array(
        [
            [u + 2 * depth * abs(cross) + depth**2 * slope, -(abs(cross) + depth * slope)],
            [-(abs(cross) + depth * slope), slope],
        ]
    )


def test_the_soil_that_makes_the_described_k11_makes_the_other_springs_too():
    """An independent check of the publication's foundation: 3 and 6 % off."""
    description = load_turbine("iea15mw_monopile")
    pile = PileInSoil.of(description)
    assert pile.springs(0.0) == pytest.approx(description.nominal, rel=0.07)
    assert pile.springs(0.0)[0] == pytest.approx(description.nominal[0], rel=1e-6)


def test_depths_between_the_tabled_ones_are_as_the_pile_computes_them():
    pile = PileInSoil.of(load_turbine("iea15mw_monopile"))
    for depth, share in zip([0.7, 3.3, 12.9], pile.scoured([0.7, 3.3, 12.9]), strict=True):
        assert share == pytest.approx(pile.springs(depth) / pile.springs(0.0), rel=1e-3)
