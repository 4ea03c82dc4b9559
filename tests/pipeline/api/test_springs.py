"""The foundation's springs at another level, against the outside simulator's pile."""

from itertools import pairwise

import numpy as np
import pytest
from numpy.typing import ArrayLike
from pilewatch import InputError, springs_at

from sensors.arrays import FloatArray
from sensors.structure.foundation import SpringSign, spring_matrix
from tests.outside import sections as outside
from tests.outside.model import NOMINAL, PLANES, SHEAR_COEFFICIENT, Description, assemble

TUBE = (10.0, 0.055)  # of the pile below: diameter, wall [m]
AREA = np.pi * (TUBE[0] - TUBE[1]) * TUBE[1]
SECOND_MOMENT = np.pi * (TUBE[0] ** 4 - (TUBE[0] - 2 * TUBE[1]) ** 4) / 64
BENDING_RIGIDITY = outside.YOUNGS_MODULUS * SECOND_MOMENT
SHEAR_MODULUS = outside.YOUNGS_MODULUS / (2 * (1 + outside.POISSON_RATIO))
SHEAR_RIGIDITY = SHEAR_COEFFICIENT * SHEAR_MODULUS * AREA
SIGNS: tuple[SpringSign, ...] = ("published", "embedded-pile")


def condensed(theta: FloatArray, sign: SpringSign, rise: float, *, shear: bool) -> FloatArray:
    """Springs at the top of a pile of the outside simulator's elements: its stiffness without the
    degrees of freedom below, weightless and under no mass."""
    levels = np.linspace(0.0, rise, 3).tolist()
    cans = tuple(
        outside.Can(low, high, (TUBE[0], TUBE[0]), TUBE[1], outside.MONOPILE_DENSITY)
        for low, high in pairwise(levels)
    )
    pile = Description(cans, (), lumped_top=(0.0, 0.0, 0.0), shear=shear, gravity=0.0)
    structure = assemble(description=pile)
    dofs = np.array([dof for dof, _ in PLANES[0]])  # v and dv/dz fore-aft, of each node
    stiffness = structure.stiffness.copy()
    stiffness[np.ix_(dofs, dofs)] += spring_matrix(theta, sign)
    top = structure.node_starts[-1] + dofs
    bent = (structure.node_starts[:, None] + dofs).ravel()
    sheared = np.arange(6 * len(structure.node_starts), len(stiffness)).reshape(-1, 6)[:, :3]
    inner = np.setdiff1d(np.concatenate([bent, sheared.ravel()]), top)
    across = stiffness[np.ix_(top, inner)]
    kept = stiffness[np.ix_(top, top)]
    kept = kept - across @ np.linalg.solve(stiffness[np.ix_(inner, inner)], across.T)
    return np.array([kept[0, 0], kept[1, 1], kept[0, 1] if sign == "published" else -kept[0, 1]])


@pytest.mark.parametrize("sign", SIGNS)
@pytest.mark.parametrize("shear", [False, True])
@pytest.mark.parametrize("rise", [1.0, 5.0])
def test_springs_at_a_higher_level_are_the_condensed_pile(
    sign: SpringSign, shear: bool, rise: float
) -> None:
    shear_rigidity = SHEAR_RIGIDITY if shear else np.inf
    found = springs_at(
        NOMINAL,
        sign,
        rise=rise,
        bending_rigidity=BENDING_RIGIDITY,
        shear_rigidity=shear_rigidity,
    )
    expected = condensed(NOMINAL, sign, rise, shear=shear)
    assert found == pytest.approx(expected, rel=1e-8)
    back = springs_at(
        found,
        sign,
        rise=-rise,
        bending_rigidity=BENDING_RIGIDITY,
        shear_rigidity=shear_rigidity,
    )
    assert back == pytest.approx(NOMINAL, rel=1e-8)


def test_springs_under_a_rigid_pile_are_carried_and_those_of_two_tubes_are_of_one() -> None:
    k11, k22, k12 = NOMINAL
    carried = springs_at(NOMINAL, "published", rise=2.0, bending_rigidity=1e25)
    expected = [k11, k22 - 2 * 2.0 * k12 + 2.0**2 * k11, k12 - 2.0 * k11]
    assert carried == pytest.approx(expected, rel=1e-8)
    half = springs_at(NOMINAL, "published", rise=1.5, bending_rigidity=BENDING_RIGIDITY)
    twice = springs_at(half, "published", rise=1.5, bending_rigidity=BENDING_RIGIDITY)
    once = springs_at(NOMINAL, "published", rise=3.0, bending_rigidity=BENDING_RIGIDITY)
    assert twice == pytest.approx(once, rel=1e-8)


def test_draws_are_carried_together_and_a_coupling_of_the_other_sign_is_negative() -> None:
    draws = NOMINAL * np.random.default_rng(3).uniform(0.9, 1.1, (50, 3))
    found = springs_at(draws, "published", rise=10.0, bending_rigidity=BENDING_RIGIDITY)
    assert found[7] == pytest.approx(
        springs_at(draws[7], "published", rise=10.0, bending_rigidity=BENDING_RIGIDITY)
    )
    assert np.all(found[:, 2] < 0)  # the published spring stands 6.9 m above the mudline


def test_springs_that_no_lower_ones_can_be_are_one_line() -> None:
    with pytest.raises(InputError, match="no springs 10 m below"):
        springs_at(NOMINAL, "published", rise=-10.0, bending_rigidity=BENDING_RIGIDITY)


@pytest.mark.parametrize(
    ("theta", "sign", "rigidity", "message"),
    [
        ([1.0, 1.0, 2.0], "published", BENDING_RIGIDITY, r"\[1.0, 1.0, 2.0\] are not positive"),
        ([1.0, 2.0], "published", BENDING_RIGIDITY, "they are three numbers"),
        ("springs", "published", BENDING_RIGIDITY, "they are three numbers"),
        (NOMINAL, "pile", BENDING_RIGIDITY, "sign is 'pile'"),
        (NOMINAL, "published", 0.0, "EI = 0 N·m²"),
    ],
)
def test_wrong_input_is_one_line(
    theta: ArrayLike, sign: SpringSign, rigidity: float, message: str
) -> None:
    with pytest.raises(InputError, match=message):
        springs_at(theta, sign, rise=1.0, bending_rigidity=rigidity)


def test_a_rise_that_is_no_number_is_one_line() -> None:
    with pytest.raises(InputError, match="rise is nan"):
        springs_at(NOMINAL, "published", rise=float("nan"), bending_rigidity=BENDING_RIGIDITY)
