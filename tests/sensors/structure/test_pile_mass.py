"""Mass of the pile below the mudline, against a pile of finite elements on a bed of springs."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh

from sensors.arrays import FloatArray
from sensors.structure import beam
from sensors.structure.assembly import assemble
from sensors.structure.figures import figures_of, varied
from sensors.structure.foundation import PILE_SHAPES, FoundationSprings, TurbineError
from sensors.structure.structural_model import StructuralModel
from tests.sensors.structure.towers import parked_turbine

STEEL = 13_489.0  # of a pile of 10 m with a wall of 55 mm [kg/m]
RIGIDITY = 210e9 * np.pi / 64 * (10**4 - 9.89**4)  # [N·m²]


def pile(
    bed: Callable[[float], float], *, rigidity: float, mass: float, length: float, parts: int
) -> tuple[FloatArray, FloatArray]:
    """Stiffness and mass of a pile on springs bed(depth) [N/m²], from its toe up to the mudline."""
    stiffness = np.zeros((2 * parts + 2, 2 * parts + 2))
    moving, part = np.zeros_like(stiffness), length / parts
    for i in range(parts):
        own = slice(2 * i, 2 * i + 4)
        depth = length - (i + 0.5) * part
        stiffness[own, own] += beam.bending_stiffness(rigidity, part)
        stiffness[own, own] += beam.bending_mass(bed(depth), part)
        moving[own, own] += beam.bending_mass(mass, part)
    return stiffness, moving


def at_mudline(stiffness: FloatArray, moving: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Both, (2, 2), where everything below follows the mudline as at rest."""
    inner = len(stiffness) - 2
    follows = -np.linalg.solve(stiffness[:inner, :inner], stiffness[:inner, inner:])
    shapes = np.vstack([follows, np.eye(2)])
    return shapes.T @ stiffness @ shapes, shapes.T @ moving @ shapes


@pytest.mark.parametrize("number", range(len(PILE_SHAPES)))
def test_the_mass_of_a_pile_on_a_bed_that_grows_with_the_depth(number: int) -> None:
    power = number / 2
    springs, moving = at_mudline(
        *pile(lambda depth: depth**power, rigidity=1.0, mass=1.0, length=14.0, parts=700)
    )
    length = np.sqrt(springs[1, 1] / springs[0, 0])
    found = (
        springs[0, 1] ** 2 / (springs[0, 0] * springs[1, 1]),
        moving[0, 0] / length,
        -moving[0, 1] / length**2,
        moving[1, 1] / length**3,
    )
    np.testing.assert_allclose(PILE_SHAPES[number], found, rtol=1e-3)


def standing_in(soil: Callable[[float], float]) -> tuple[StructuralModel, FloatArray, FloatArray]:
    """The tower on the springs of a pile, and the pile's own stiffness and mass."""
    matrices = pile(soil, rigidity=RIGIDITY, mass=STEEL, length=45.0, parts=60)
    springs, _ = at_mudline(*matrices)
    foundation = FoundationSprings(
        springs[0, 0], springs[1, 1], -springs[0, 1], "embedded-pile", moving_mass=STEEL
    )
    return assemble(replace(parked_turbine(), foundation=foundation)), *matrices


def frequencies_on(model: StructuralModel, stiffness: FloatArray, mass: FloatArray) -> FloatArray:
    """Of the tower with the pile itself in both planes [Hz]."""
    bare = assemble(
        replace(
            model.description, foundation=replace(model.description.foundation, moving_mass=0.0)
        )
    )
    n, inner = bare.n_dofs, len(stiffness) - 2
    K, M = np.zeros((n + 2 * inner,) * 2), np.zeros((n + 2 * inner,) * 2)
    K[:n, :n], M[:n, :n] = bare.free_stiffness, bare.mass
    for plane, mudline in enumerate(bare.spring_dofs):
        below = n + inner * plane + np.arange(inner)
        own = np.ix_(np.concatenate([below, mudline]), np.concatenate([below, mudline]))
        K[own] += stiffness
        M[own] += mass
    return np.sqrt(eigh(K, M, eigvals_only=True, subset_by_index=(0, 59))) / (2 * np.pi)


@pytest.mark.parametrize(
    "soil",
    [lambda depth: 1e8 + 0 * depth, lambda depth: 5e6 + 1.5e7 * depth],
    ids=["even", "rising"],
)
def test_frequencies_are_those_of_the_tower_on_the_pile_itself(
    soil: Callable[[float], float],
) -> None:
    model, stiffness, mass = standing_in(soil)
    expected = frequencies_on(model, stiffness, mass)
    expected = expected[expected < 9]
    massless = replace(model.description.foundation, moving_mass=0.0)
    without = assemble(replace(model.description, foundation=massless))

    def worst(structure: StructuralModel) -> float:
        values = eigh(structure.stiffness, structure.mass, eigvals_only=True)
        found = np.sqrt(values[: len(expected)]) / (2 * np.pi)
        return float(np.abs(found / expected - 1).max())

    assert worst(model) < 3e-4
    assert worst(without) > 4e-3


def test_a_description_without_moving_mass_has_no_such_parameter() -> None:
    turbine = parked_turbine()
    assert "pile_mass" not in {figure.name for figure in figures_of(turbine)}
    np.testing.assert_array_equal(turbine.foundation.mass, np.zeros((2, 2)))


def test_a_heavier_pile_has_as_much_more_mass() -> None:
    turbine = parked_turbine()
    turbine = replace(turbine, foundation=replace(turbine.foundation, moving_mass=2e4))
    heavier = varied(turbine, {"pile_mass": 0.5}).foundation
    assert heavier.moving_mass == pytest.approx(3e4)
    np.testing.assert_allclose(heavier.mass, 1.5 * turbine.foundation.mass)


def test_the_mass_couples_as_the_springs_do() -> None:
    for sign, direction in (("published", 1), ("embedded-pile", -1)):
        mass = FoundationSprings(1e9, 4e11, 1.4e10, sign, moving_mass=1e4).mass
        assert np.sign(mass[0, 1]) == direction
        assert (np.linalg.eigvalsh(mass) > 0).all()


@pytest.mark.parametrize("mass", [-1.0, 2e6, float("nan")])
def test_a_mass_that_no_pile_has_is_refused(mass: float) -> None:
    with pytest.raises(TurbineError, match="moving_mass is"):
        FoundationSprings(1e9, 4e11, 1.4e10, moving_mass=mass)
