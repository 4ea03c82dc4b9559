"""Beam elements against what any beam must do, and against closed forms."""

import numpy as np
import pytest
from numpy.typing import ArrayLike
from scipy.linalg import eigh

from sensors.structure.beam import (
    CLAMPED_CLAMPED_ROOTS,
    bending_mass,
    bending_stiffness,
    craig_bampton_element,
    geometric_stiffness,
    hermite,
    hermite_slope,
    rod_mass,
    rod_stiffness,
    rotary_mass,
    section_rotation,
)

LENGTH, RIGIDITY, MASS = 13.0, 2.5e12, 8.7e3  # m, N·m², kg/m: a tube of the tower
TRANSLATION = np.array([1.0, 0.0, 1.0, 0.0])
ROTATION = np.array([0.0, 1.0, LENGTH, 1.0])  # round the lower end


def test_interpolation_reproduces_every_cubic_and_its_slope() -> None:
    cubic = np.polynomial.Polynomial([0.3, -0.2, 0.05, 0.01])
    slope = cubic.deriv()
    ends = [cubic(0), slope(0), cubic(LENGTH), slope(LENGTH)]
    xi = np.linspace(0, 1, 7)
    assert hermite(xi, LENGTH) @ ends == pytest.approx(cubic(xi * LENGTH))
    assert hermite_slope(xi, LENGTH) @ ends == pytest.approx(slope(xi * LENGTH))


@pytest.mark.parametrize("position", [0.5, np.linspace(0, 1, 3), np.full((2, 3), 0.25)])
def test_the_four_shapes_stand_last_whatever_the_positions_are(position: ArrayLike) -> None:
    for shapes in (hermite, hermite_slope, section_rotation):
        found = shapes(position, LENGTH)
        assert found.shape == (*np.shape(position), 4)
        one = shapes(np.ravel(position)[0], LENGTH)
        np.testing.assert_allclose(found.reshape(-1, 4)[0], one)


@pytest.mark.parametrize("motion", [TRANSLATION, ROTATION])
def test_a_rigid_motion_bends_nothing(motion: np.ndarray) -> None:
    assert bending_stiffness(RIGIDITY, LENGTH) @ motion == pytest.approx(0, abs=1e-4)


def test_a_constant_curvature_stores_its_bending_energy() -> None:
    curvature = 1e-4
    bent = curvature * np.array([0, 0, LENGTH**2 / 2, LENGTH])
    energy = bent @ bending_stiffness(RIGIDITY, LENGTH) @ bent / 2
    assert energy == pytest.approx(RIGIDITY * curvature**2 * LENGTH / 2)


def test_mass_of_rigid_motions_is_mass_and_moment_of_inertia() -> None:
    mass = bending_mass(MASS, LENGTH)
    assert TRANSLATION @ mass @ TRANSLATION == pytest.approx(MASS * LENGTH)
    assert ROTATION @ mass @ ROTATION == pytest.approx(MASS * LENGTH**3 / 3)
    assert TRANSLATION @ mass @ ROTATION == pytest.approx(MASS * LENGTH**2 / 2)


def test_consistent_mass_is_the_text_books() -> None:
    L = LENGTH
    expected = (MASS * L / 420) * np.array(
        [
            [156, 22 * L, 54, -13 * L],
            [22 * L, 4 * L**2, 13 * L, -3 * L**2],
            [54, 13 * L, 156, -22 * L],
            [-13 * L, -3 * L**2, -22 * L, 4 * L**2],
        ]
    )
    assert bending_mass(MASS, L) == pytest.approx(expected)


def test_parts_of_a_wetted_element_add_up_to_the_whole() -> None:
    parts = bending_mass(MASS, LENGTH, end=0.37) + bending_mass(MASS, LENGTH, start=0.37)
    assert parts == pytest.approx(bending_mass(MASS, LENGTH))
    assert TRANSLATION @ bending_mass(MASS, LENGTH, end=0.37) @ TRANSLATION == pytest.approx(
        0.37 * MASS * LENGTH
    )


def test_tension_works_against_a_rigid_rotation() -> None:
    stiffness = geometric_stiffness(3e6, 1e6, LENGTH)
    assert ROTATION @ stiffness @ ROTATION == pytest.approx(2e6 * LENGTH)
    assert stiffness @ TRANSLATION == pytest.approx(0, abs=1e-6)


def test_constant_tension_is_the_text_books() -> None:
    L = LENGTH
    expected = (1e6 / (30 * L)) * np.array(
        [
            [36, 3 * L, -36, 3 * L],
            [3 * L, 4 * L**2, -3 * L, -(L**2)],
            [-36, -3 * L, 36, -3 * L],
            [3 * L, -(L**2), -3 * L, 4 * L**2],
        ]
    )
    assert geometric_stiffness(1e6, 1e6, L) == pytest.approx(expected, rel=1e-10)


def test_rod_stretches_and_weighs_as_a_rod() -> None:
    assert rod_stiffness(5e9, LENGTH) @ [0, 1] == pytest.approx([-5e9 / LENGTH, 5e9 / LENGTH])
    assert rod_mass(MASS, LENGTH).sum() == pytest.approx(MASS * LENGTH)


def test_craig_bampton_modes_are_those_of_the_clamped_beam() -> None:
    element = craig_bampton_element(RIGIDITY, MASS, LENGTH, modes=3)
    squares = np.diag(element.stiffness)[4:] / np.diag(element.mass)[4:]
    expected = np.array(CLAMPED_CLAMPED_ROOTS) ** 2 * np.sqrt(RIGIDITY / MASS) / LENGTH**2
    assert np.sqrt(squares) == pytest.approx(expected)
    inner_mass = element.mass[4:, 4:]
    assert inner_mass == pytest.approx(np.diag(np.diag(inner_mass)), abs=1e-6 * MASS)


def test_one_craig_bampton_element_has_the_cantilevers_frequencies() -> None:
    element = craig_bampton_element(RIGIDITY, MASS, LENGTH, modes=3)
    free = slice(2, None)  # clamp the lower end
    squares = eigh(element.stiffness[free, free], element.mass[free, free], eigvals_only=True)
    roots = np.array([1.8751040687, 4.6940911330, 7.8547574382])  # of the clamped-free beam
    expected = roots**2 * np.sqrt(RIGIDITY / MASS) / LENGTH**2
    assert np.sqrt(squares[:2]) == pytest.approx(expected[:2], rel=5e-4)
    assert np.sqrt(squares[2]) == pytest.approx(expected[2], rel=2e-3)


@pytest.mark.parametrize("modes", [0, 1, 2, 3])
def test_craig_bampton_interface_is_the_ordinary_element(modes: int) -> None:
    element = craig_bampton_element(RIGIDITY, MASS, LENGTH, modes=modes)
    assert element.stiffness[:4, :4] == pytest.approx(bending_stiffness(RIGIDITY, LENGTH))
    assert element.mass[:4, :4] == pytest.approx(bending_mass(MASS, LENGTH))
    assert np.all(np.linalg.eigvalsh(element.mass) > 0)


SHEAR = 2.4  # Φ of such a tube [-]


@pytest.mark.parametrize("motion", [TRANSLATION, ROTATION])
def test_a_rigid_motion_shears_nothing(motion: np.ndarray) -> None:
    forces = bending_stiffness(RIGIDITY, LENGTH, SHEAR) @ motion
    assert forces / RIGIDITY == pytest.approx(0, abs=1e-14)
    xi = np.linspace(0, 1, 7)
    turned = section_rotation(xi, LENGTH, SHEAR) @ motion
    assert turned == pytest.approx(np.full(7, motion[1]))
    assert hermite_slope(xi, LENGTH, SHEAR) @ motion == pytest.approx(turned)


def test_the_slope_between_the_nodes_is_that_of_the_displacement() -> None:
    xi, step = np.linspace(0.1, 0.9, 5), 1e-6
    rise = hermite(xi + step, LENGTH, SHEAR) - hermite(xi - step, LENGTH, SHEAR)
    assert hermite_slope(xi, LENGTH, SHEAR) == pytest.approx(rise / (2 * step * LENGTH), abs=1e-6)


def test_a_cantilever_with_shear_gives_by_bending_and_by_shear() -> None:
    free = bending_stiffness(RIGIDITY, LENGTH, SHEAR)[2:, 2:]
    by_bending = LENGTH**3 / (3 * RIGIDITY)
    by_shear = SHEAR * LENGTH**3 / (12 * RIGIDITY)  # L / κGA
    assert np.linalg.inv(free)[0, 0] == pytest.approx(by_bending + by_shear)


@pytest.mark.parametrize("number", [1, 2, 3])
def test_a_hinged_beam_with_shear_has_timoshenkos_frequencies(number: int) -> None:
    """EI k⁴ − m ω² − (ρI + m EI / κGA) k² ω² + ρI m / κGA ω⁴ = 0 with k = n π / length."""
    n_elements, whole = 80, 40.0
    length = whole / n_elements
    shear_rigidity, rotary = 6.0e10, 1.1e5  # κGA [N], ρI [kg·m]
    shear = 12 * RIGIDITY / (shear_rigidity * length**2)
    n = 2 * (n_elements + 1)
    stiffness, mass = np.zeros((n, n)), np.zeros((n, n))
    for element in range(n_elements):
        dofs = np.arange(2 * element, 2 * element + 4)
        where = np.ix_(dofs, dofs)
        stiffness[where] += bending_stiffness(RIGIDITY, length, shear)
        mass[where] += bending_mass(MASS, length, shear=shear) + rotary_mass(rotary, length, shear)
    free = np.delete(np.arange(n), [0, n - 2])
    squares = eigh(stiffness[np.ix_(free, free)], mass[np.ix_(free, free)], eigvals_only=True)
    k = number * np.pi / whole
    exact = np.roots(
        [
            rotary * MASS / shear_rigidity,
            -MASS - (rotary + MASS * RIGIDITY / shear_rigidity) * k**2,
            RIGIDITY * k**4,
        ]
    )
    assert squares[number - 1] == pytest.approx(exact.min(), rel=2e-3)
