"""The rotor-nacelle assembly as a rigid body, and its blades clamped at the root."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import block_diag, eigh
from scipy.spatial.transform import Rotation

from sensors.structure.components import RigidBody, RotorNacelle
from sensors.structure.foundation import TurbineError
from sensors.structure.rotor_nacelle import (
    ROTATION,
    BladeDirection,
    apex,
    blade_axes,
    blade_bending,
    hanging_stiffness,
    nacelle_mass,
    rigid_body_mass,
    rigid_displacement,
    twisted_blade_bending,
)
from tests.sensors.structure.towers import parked_turbine


def test_a_point_moves_by_u_plus_theta_cross_r() -> None:
    motion = np.array([0.1, 0.02, -0.3, 0.05, 0.2, -0.01])  # u_x, ψ_x, u_y, ψ_y, u_z, θ_z
    rotation = np.array([-0.05, 0.02, -0.01])  # round x, y, z
    arm = np.array([-4.0, 1.5, 3.0])
    expected = np.array([0.1, -0.3, 0.2]) + np.cross(rotation, arm)
    assert pytest.approx(rotation) == ROTATION @ motion
    assert rigid_displacement(arm) @ motion == pytest.approx(expected)


def test_the_parallel_axis_theorem_holds() -> None:
    mass = rigid_body_mass(530e3, (-4.688, 0.0, 4.24), (7e6, 8e6, 9e6))
    nodding, yawing = np.eye(6)[1], np.eye(6)[5]
    assert nodding @ mass @ nodding == pytest.approx(8e6 + 530e3 * (4.688**2 + 4.24**2))
    assert yawing @ mass @ yawing == pytest.approx(9e6 + 530e3 * 4.688**2)


def test_a_tensor_about_the_towers_top_is_that_about_the_centre_and_the_masss() -> None:
    """Two points of 200 t and 100 t: their tensor about any point gives one mass matrix."""
    arms, masses = np.array([[-3.0, 1.0, 4.0], [-6.0, -1.0, 5.5]]), np.array([2e5, 1e5])
    centre = tuple((masses @ arms / masses.sum()).tolist())
    expected = sum(
        rigid_body_mass(m, arm, np.zeros(3)) for m, arm in zip(masses, arms, strict=True)
    )
    for point in ((0.0, 0.0, 0.0), (1.0, 2.0, -3.0), None):
        off = arms - np.array(centre if point is None else point)
        i = sum(m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, off, strict=True))
        body = RigidBody(
            "nacelle",
            float(masses.sum()),
            centre,
            (i[0, 0], i[1, 1], i[2, 2]),
            (i[0, 1], i[0, 2], i[1, 2]),
            point,
        )
        found = nacelle_mass(RotorNacelle(bodies=(body,)))
        np.testing.assert_allclose(found, expected, atol=1e-6 * expected.max())
        again = nacelle_mass(RotorNacelle(bodies=(body.about_centre,)))
        np.testing.assert_allclose(again, expected, atol=1e-6 * expected.max())


def test_a_standing_weight_gives_off_the_energy_by_which_its_centre_sinks() -> None:
    """Translations and a turn about the vertical axis cost none."""
    weight, height, rng = 7.0, 3.0, np.random.default_rng(1)
    for q in (*np.eye(6), *rng.standard_normal((5, 6))):
        small = 1e-4 * q
        centre = Rotation.from_rotvec(ROTATION @ small).apply([0.0, 0.0, height])
        energy = 0.5 * small @ hanging_stiffness(weight * height) @ small
        assert energy == pytest.approx(weight * (centre[2] - height), rel=1e-4, abs=1e-14)


def test_a_nacelle_heavier_than_its_inertia_allows_is_one_line() -> None:
    with pytest.raises(TurbineError, match=r"principal moment of -.*check products and inertia_po"):
        RigidBody("nacelle", 5e5, (-4.7, 0.0, 4.2), (1e6, 1e6, 1e6), inertia_point=(0.0, 0.0, 0.0))


def test_the_nacelle_weighs_what_its_parts_weigh() -> None:
    mass = nacelle_mass(parked_turbine().rotor_nacelle)
    for axis in (0, 2, 4):
        assert mass[axis, axis] == pytest.approx(190000.0 + 530887.918 + 100000.0)
    assert np.all(np.linalg.eigvalsh(mass) > 0)


def test_the_yaw_inertia_of_the_nacelle_is_the_published_one() -> None:
    nacelle = parked_turbine().rotor_nacelle
    bodies_only = RotorNacelle(bodies=nacelle.bodies)
    assert nacelle_mass(bodies_only)[5, 5] == pytest.approx(18886965.482)


def test_the_apex_is_upwind_of_the_tower_and_up_the_tilted_shaft() -> None:
    x, y, z = apex(parked_turbine().rotor_nacelle)
    assert (x, y) == (pytest.approx(-11.075 * np.cos(np.radians(6))), 0.0)
    assert z == pytest.approx(4.3478 + 11.075 * np.sin(np.radians(6)))


@pytest.mark.parametrize("number", [0, 1, 2])
def test_blade_axes_are_orthonormal_and_feathered_edges_lie_along_the_shaft(number: int) -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    axes = blade_axes(turbine.rotor_nacelle, turbine.blades, number)
    triad = np.array([axes.span, axes.flap, axes.edge])
    assert triad @ triad.T == pytest.approx(np.eye(3), abs=1e-12)
    shaft = np.array([-np.cos(np.radians(6)), 0.0, np.sin(np.radians(6))])
    assert abs(axes.edge @ shaft) == pytest.approx(np.cos(np.radians(4)))


def test_blades_begin_three_metres_from_the_apex_on_the_hub() -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    nacelle, blades = turbine.rotor_nacelle, turbine.blades
    for number in range(blades.number):
        axes = blade_axes(nacelle, blades, number)
        assert axes.root - apex(nacelle) == pytest.approx(3.0 * axes.span)


def test_the_first_blade_stands_up_and_the_cone_points_upwind() -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    span = blade_axes(turbine.rotor_nacelle, turbine.blades, 0).span
    lean = np.radians(6 - 4)  # tilt leans the rotor's top downwind, the cone back upwind
    assert span == pytest.approx([np.sin(lean), 0.0, np.cos(lean)])


@pytest.mark.parametrize(("direction", "distributed"), [("flap", 0.555), ("edge", 0.642)])
def test_six_averaged_elements_make_a_clamped_blade_three_to_five_percent_softer(
    direction: BladeDirection, distributed: float
) -> None:
    """Against the distributed blade of NREL/TP-5000-75698: .555 Hz flapwise, .642 Hz edgewise."""
    blades = parked_turbine().blades
    assert blades is not None
    bending = blade_bending(blades, direction)
    squares = eigh(bending.stiffness[2:, 2:], bending.mass[2:, 2:], eigvals_only=True)
    ratio = np.sqrt(squares[0]) / (2 * np.pi) / distributed
    assert 0.95 < ratio < 0.97


def test_a_free_blade_bends_in_no_rigid_motion() -> None:
    blades = parked_turbine().blades
    assert blades is not None
    bending = blade_bending(blades, "flap")
    places = np.array([0.0, *(part.outer for part in blades.elements)])
    inner = np.zeros(len(blades.elements) * blades.modes_per_element)
    turning = np.concatenate([np.stack([places, np.ones_like(places)], axis=1).ravel(), inner])
    largest = np.abs(bending.stiffness).max()
    assert bending.stiffness @ turning == pytest.approx(0, abs=1e-9 * largest)
    inertia = sum(
        part.mass_per_length * (part.outer**3 - part.inner**3) / 3 for part in blades.elements
    )
    assert turning @ bending.mass @ turning == pytest.approx(inertia)


@pytest.mark.parametrize("azimuth", [0.0, 30.0, 90.0, 200.0])
def test_the_azimuth_turns_the_rotor_from_up_towards_the_side(azimuth: float) -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    nacelle, blades = turbine.rotor_nacelle, replace(turbine.blades, azimuth=azimuth, cone=0.0)
    spans = [blade_axes(nacelle, blades, number).span for number in range(blades.number)]
    for number, span in enumerate(spans):
        angle = np.radians(azimuth + 360 * number / blades.number)
        up = np.array([np.sin(np.radians(nacelle.tilt)), 0, np.cos(np.radians(nacelle.tilt))])
        assert span == pytest.approx(np.cos(angle) * up + np.sin(angle) * np.array([0.0, 1, 0]))
    assert np.sum(spans, axis=0) == pytest.approx(np.zeros(3), abs=1e-12)  # the rotor balances


def test_blades_without_twist_bend_in_both_directions_for_themselves() -> None:
    blades = parked_turbine().blades
    assert blades is not None
    blades = replace(blades, elements=tuple(replace(each, twist=0.0) for each in blades.elements))
    both = twisted_blade_bending(blades)
    flap, edge = blade_bending(blades, "flap"), blade_bending(blades, "edge")
    for whole, one, other in (
        (both.mass, flap.mass, edge.mass),
        (both.stiffness, flap.stiffness, edge.stiffness),
    ):
        np.testing.assert_allclose(whole, block_diag(one, other), rtol=1e-12, atol=1e-6)
