"""The assembled structure: what it weighs, how it stands, and uniform towers in closed form."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.optimize import brentq

from sensors.structure.assembly import added_mass, assemble, inner_water_mass, wetted_share
from sensors.structure.components import PointMass, RigidBody, Water
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError
from sensors.structure.rotor_nacelle import blade_axes, rigid_bodies
from sensors.structure.structural_model import StructuralModel
from tests.sensors.structure.towers import CLAMPED, LENGTH, parked_turbine, uniform_tower

# Middles of 450 slices of an element; the water level falls between two of them
MIDDLES = (np.arange(450) + 0.5) / 450
CANTILEVER_ROOTS = np.array([1.875104068711961, 4.694091132974174, 7.854757438237613])


def frequencies(turbine: TurbineDescription, **assembly: object) -> np.ndarray:
    """All natural frequencies [Hz], each bending mode twice (fore-aft and side-side)."""
    model = assemble(turbine, **assembly)  # type: ignore[arg-type]
    flexibilities = eigh(model.mass, model.stiffness, eigvals_only=True)  # low modes keep digits
    return 1 / (2 * np.pi * np.sqrt(flexibilities[::-1]))


def turbine_with_point_masses() -> TurbineDescription:
    """The parked turbine with a mass where two tubes meet and one in the middle of a tube."""
    turbine = parked_turbine()
    meeting, held = turbine.tubes[3].top, turbine.tubes[7]
    masses = (
        PointMass("transition piece", meeting, 80e3),
        PointMass("platform", (held.bottom + held.top) / 2, 50e3),
    )
    return replace(turbine, point_masses=masses)


def rigid_motion(
    model: StructuralModel, translation: np.ndarray, rotation: np.ndarray
) -> np.ndarray:
    """The model's coordinates when the whole turbine moves rigidly about (0, 0, 0)."""
    turbine = model.description
    q = np.zeros(model.n_dofs + 1)  # the last one takes what is fixed
    x, y, z = rotation
    for elevation, dofs in zip(model.elevations, model.tower_dofs, strict=True):
        u = translation + np.cross(rotation, [0, 0, elevation])
        q[dofs] = [u[0], y, u[1], -x, u[2], z]
    if turbine.blades is not None:
        for number in range(turbine.blades.number):
            axes = blade_axes(turbine.rotor_nacelle, turbine.blades, number)
            root = np.array([0, 0, turbine.tower_top]) + axes.root
            for part, dofs in zip(turbine.blades.elements, model.blade_dofs[number], strict=True):
                u = translation + np.cross(rotation, root + part.outer * axes.span)
                slope = np.cross(rotation, axes.span)
                q[dofs] = [axes.flap @ u, axes.flap @ slope, axes.edge @ u, axes.edge @ slope]
    return q[:-1]


def rigid_kinetic_energy(
    turbine: TurbineDescription, translation: np.ndarray, rotation: np.ndarray
) -> float:
    """Twice the kinetic energy of that motion, summed over thin slices of everything."""
    assert turbine.water is not None
    assert turbine.blades is not None

    def moved(places: np.ndarray) -> np.ndarray:
        return translation + np.cross(rotation, places)

    total = 0.0
    for tube in turbine.tubes:
        z = tube.bottom + tube.length * MIDDLES
        u = moved(z[:, None] * [0.0, 0.0, 1.0])
        wet = np.where(z < turbine.water.level, added_mass(tube, turbine.water), 0.0)
        energy = tube.mass_per_length * (u**2).sum(axis=1) + wet * (u[:, :2] ** 2).sum(axis=1)
        energy += 2 * tube.density * tube.second_moment * rotation[2] ** 2
        total += energy.mean() * tube.length
    for point in turbine.point_masses:
        u = moved(np.array([0, 0, point.elevation]))
        total += point.mass * (u @ u)
    top = np.array([0, 0, turbine.tower_top])
    for body in rigid_bodies(turbine.rotor_nacelle):
        u = moved(top + body.centre)
        total += body.mass * (u @ u) + rotation @ body.tensor @ rotation
    tilt = np.radians(turbine.rotor_nacelle.tilt)
    round_shaft = rotation @ [-np.cos(tilt), 0, np.sin(tilt)]
    total += turbine.rotor_nacelle.hub_inertia * (rotation @ rotation + round_shaft**2) / 2
    for number in range(turbine.blades.number):
        axes = blade_axes(turbine.rotor_nacelle, turbine.blades, number)
        for part in turbine.blades.elements:
            s = part.inner + part.length * MIDDLES
            u = moved(top + axes.root + s[:, None] * axes.span)
            total += part.mass_per_length * (u**2).sum(axis=1).mean() * part.length
    return total


@pytest.mark.parametrize("direction", range(6))
@pytest.mark.parametrize("described", [parked_turbine, turbine_with_point_masses])
def test_a_rigid_motion_has_the_kinetic_energy_of_all_the_parts(
    described: Callable[[], TurbineDescription], direction: int
) -> None:
    turbine = described()
    translation, rotation = np.zeros(3), np.zeros(3)
    (translation if direction < 3 else rotation)[direction % 3] = 1.0
    model = assemble(turbine)
    motion = rigid_motion(model, translation, rotation)
    held = turbine.tubes[0]  # heave and twist of the mudline are fixed: their part is missing
    energy = motion @ model.mass @ motion
    expected = rigid_kinetic_energy(turbine, translation, rotation)
    if direction == 2:
        expected -= held.mass_per_length * held.length * (1 - 1 / 3)
    if direction == 5:
        expected -= 2 * held.density * held.second_moment * held.length * (1 - 1 / 3)
    assert energy == pytest.approx(expected, rel=1e-5)


@pytest.mark.parametrize("direction", [0, 1, 3, 4])
def test_without_gravity_and_springs_nothing_resists_a_rigid_motion(direction: int) -> None:
    turbine = replace(parked_turbine(), gravity=0.0)
    model = assemble(turbine)
    translation, rotation = np.zeros(3), np.zeros(3)
    (translation if direction < 3 else rotation)[direction % 3] = 1.0
    motion = rigid_motion(model, translation, rotation)
    force = model.free_stiffness @ motion
    # what rounding leaves of entries of up to 1e13
    assert np.abs(force).max() < 1e-11 * np.abs(model.stiffness).max() * np.abs(motion).max()


@pytest.mark.parametrize("described", [parked_turbine, turbine_with_point_masses])
def test_gravity_tips_the_whole_like_an_inverted_pendulum(
    described: Callable[[], TurbineDescription],
) -> None:
    turbine = described()
    assert turbine.blades is not None
    model = assemble(turbine)
    about_mudline = rigid_motion(
        model, np.cross([0, 1, 0], [0, 0, -turbine.mudline]), np.array([0.0, 1.0, 0.0])
    )
    moment = sum(
        tube.mass_per_length * tube.length * ((tube.bottom + tube.top) / 2 - turbine.mudline)
        for tube in turbine.tubes
    )
    moment += sum(m.mass * (m.elevation - turbine.mudline) for m in turbine.point_masses)
    height = turbine.tower_top - turbine.mudline
    moment += sum(b.mass * (height + b.centre[2]) for b in rigid_bodies(turbine.rotor_nacelle))
    for number in range(turbine.blades.number):
        axes = blade_axes(turbine.rotor_nacelle, turbine.blades, number)
        for part in turbine.blades.elements:
            middle = axes.root + (part.inner + part.outer) / 2 * axes.span
            moment += part.mass_per_length * part.length * (height + middle[2])
    resisted = about_mudline @ model.free_stiffness @ about_mudline
    assert resisted == pytest.approx(-turbine.gravity * moment, rel=1e-6)


@pytest.mark.parametrize("refinement", [1, 2])
def test_mass_and_stiffness_are_symmetric_and_positive_definite(refinement: int) -> None:
    model = assemble(parked_turbine(), tube_refinement=refinement)
    for matrix in (model.mass, model.stiffness):
        assert np.allclose(matrix, matrix.T, rtol=1e-12, atol=1e-12 * np.abs(matrix).max())
        scale = np.sqrt(np.diag(matrix))
        assert np.linalg.eigvalsh(matrix / np.outer(scale, scale))[0] > 0


def test_a_clamped_uniform_tower_has_the_cantilevers_frequencies() -> None:
    tower = uniform_tower()
    tube = tower.tubes[0]
    wave = np.sqrt(tube.bending_rigidity / tube.mass_per_length) / LENGTH**2
    expected = CANTILEVER_ROOTS**2 * wave / (2 * np.pi)
    first, _, second, _, torsion, third = frequencies(tower)[:6]
    assert np.array([first, second, third]) == pytest.approx(expected, rel=1e-3)
    shear_wave = np.sqrt(tube.torsional_rigidity / (2 * tube.density * tube.second_moment))
    assert torsion == pytest.approx(shear_wave / (4 * LENGTH), rel=2e-3)


def test_frequencies_converge_with_the_fourth_power_of_the_element_length() -> None:
    tower = uniform_tower(elements=2)
    tube = tower.tubes[0]
    wave = np.sqrt(tube.bending_rigidity / tube.mass_per_length) / LENGTH**2
    exact = CANTILEVER_ROOTS[1] ** 2 * wave / (2 * np.pi)
    coarse, fine = (frequencies(tower, tube_refinement=n)[2] / exact - 1 for n in (2, 4))
    assert coarse > fine > 0  # Ritz: from above
    assert np.log2(coarse / fine) == pytest.approx(4, abs=0.2)


def test_a_tip_mass_lowers_the_first_frequency_as_the_transcendental_equation_says() -> None:
    tip = 300e3
    tower = uniform_tower(top=RigidBody("tip", mass=tip))
    tube = tower.tubes[0]
    ratio = tip / (tube.mass_per_length * LENGTH)

    def clamped_with_tip_mass(b: float) -> float:
        return (
            1
            + np.cos(b) * np.cosh(b)
            + ratio * b * (np.cos(b) * np.sinh(b) - np.sin(b) * np.cosh(b))
        )

    root = brentq(clamped_with_tip_mass, 0.5, 1.87)
    wave = np.sqrt(tube.bending_rigidity / tube.mass_per_length) / LENGTH**2
    assert frequencies(tower)[0] == pytest.approx(root**2 * wave / (2 * np.pi), rel=1e-6)


def test_a_rigid_tower_on_springs_swings_as_two_degrees_of_freedom() -> None:
    springs = FoundationSprings(k11=2e9, k22=5e11, k12=1e10)
    tower = uniform_tower(foundation=springs, youngs_modulus=210e15)
    m = tower.tubes[0].mass_per_length
    mass = np.array([[m * LENGTH, m * LENGTH**2 / 2], [m * LENGTH**2 / 2, m * LENGTH**3 / 3]])
    stiffness = np.array([[2e9, 1e10], [1e10, 5e11]])
    expected = np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2 * np.pi)
    assert frequencies(tower)[:4:2] == pytest.approx(expected, rel=1e-4)


def test_the_embedded_pile_sign_swings_as_its_own_two_degrees_of_freedom() -> None:
    springs = FoundationSprings(k11=2e9, k22=5e11, k12=1e10, sign="embedded-pile")
    tower = uniform_tower(foundation=springs, youngs_modulus=210e15)
    m = tower.tubes[0].mass_per_length
    mass = np.array([[m * LENGTH, m * LENGTH**2 / 2], [m * LENGTH**2 / 2, m * LENGTH**3 / 3]])
    stiffness = np.array([[2e9, -1e10], [-1e10, 5e11]])
    expected = np.sqrt(eigh(stiffness, mass, eigvals_only=True)) / (2 * np.pi)
    assert frequencies(tower)[:4:2] == pytest.approx(expected, rel=1e-4)


def test_a_tower_of_its_own_weight_buckles_at_greenhills_height() -> None:
    """A clamped column stands while m g L³ / EI < 7.8373 (Greenhill, 1881)."""
    tube = uniform_tower().tubes[0]
    critical = 7.8373 * tube.bending_rigidity / (tube.mass_per_length * LENGTH**3)
    stands, falls = (
        eigh(model.stiffness, model.mass, eigvals_only=True)[0]
        for model in (assemble(uniform_tower(gravity=f * critical)) for f in (0.999, 1.001))
    )
    assert stands > 0 > falls


def test_a_heavy_top_buckles_the_tower_at_eulers_load() -> None:
    tube = uniform_tower().tubes[0]
    euler = np.pi**2 * tube.bending_rigidity / (4 * LENGTH**2)
    light = 1e-6 * tube.density  # so that only the top weighs
    lowest = []
    for share in (0.999, 1.001):
        top = RigidBody("top", mass=share * euler / 9.81)
        model = assemble(uniform_tower(gravity=9.81, density=light, top=top))
        lowest.append(np.linalg.eigvalsh(model.stiffness)[0])
    assert lowest[0] > 0 > lowest[1]


def test_water_wets_the_tubes_up_to_its_level() -> None:
    turbine = parked_turbine()
    wet = [wetted_share(tube, turbine.water) for tube in turbine.tubes]
    assert wet[:6] == [1.0] * 6
    assert wet[6] == pytest.approx(3.0 / 4.5)
    assert not any(wet[7:])
    assert added_mass(turbine.tubes[0], turbine.water) == pytest.approx(80503.3, rel=1e-6)


def test_a_rising_tide_lowers_frequencies_smoothly() -> None:
    levels = np.linspace(-4.0, 4.0, 5)  # across a node at 1.5 m
    second = np.array([frequencies(parked_turbine().with_water_level(z))[8] for z in levels])
    steps = np.diff(second)
    assert np.all(steps < 0)
    assert np.ptp(np.diff(steps)) < 0.2 * abs(steps.mean())


def test_finer_tubes_move_the_lowest_modes_by_less_than_a_ten_thousandth() -> None:
    coarse, fine = (frequencies(parked_turbine(), tube_refinement=n)[:20] for n in (1, 2))
    assert fine == pytest.approx(coarse, rel=1e-4)


def test_a_displacement_row_reads_a_rigid_motion_anywhere_on_the_tower() -> None:
    model = assemble(parked_turbine())
    motion = rigid_motion(model, np.array([0.3, -0.2, 0.0]), np.array([0.01, 0.02, 0.0]))
    for elevation in (-30.0, -27.1, 15.0, 80.0, 111.3, 145.0):
        x, y = 0.3 + 0.02 * elevation, -0.2 - 0.01 * elevation
        for direction in ((1, 0, 0), (0, 1, 0), (0.6, 0.8, 0)):
            row = model.tower_displacement(elevation, direction)
            assert row @ motion == pytest.approx(direction[0] * x + direction[1] * y)
            slope = model.tower_slope(elevation, direction) @ motion
            assert slope == pytest.approx(direction[0] * 0.02 - direction[1] * 0.01)


def test_a_blades_row_reads_a_rigid_motion_in_tower_axes() -> None:
    model = assemble(parked_turbine())
    turbine = model.description
    assert turbine.blades is not None
    translation, rotation = np.array([0.3, -0.2, 0.1]), np.array([0.01, 0.02, -0.03])
    motion = rigid_motion(model, translation, rotation)
    for blade, node in ((0, 1), (1, 3), (2, 6)):
        axes = blade_axes(turbine.rotor_nacelle, turbine.blades, blade)
        reach = turbine.blades.elements[node - 1].outer
        place = np.array([0, 0, turbine.tower_top]) + axes.root + reach * axes.span
        expected = translation + np.cross(rotation, place)
        rows = [model.blade_displacement(blade, node, axis) for axis in np.eye(3).tolist()]
        assert np.array(rows) @ motion == pytest.approx(expected, rel=1e-9)


def test_a_place_off_the_tower_is_refused() -> None:
    with pytest.raises(TurbineError, match=r"elevation 150 m is outside .* -30 to 145 m"):
        assemble(parked_turbine()).tower_displacement(150.0, (1, 0, 0))


def test_the_stiffness_at_another_foundation_is_that_assembled_with_it() -> None:
    turbine = parked_turbine()
    theta = turbine.nominal * [1.3, 0.8, 0.9]
    other = assemble(turbine).on_springs(theta).stiffness
    assert np.array_equal(other, assemble(turbine, stiffness=theta).stiffness)


def test_a_clamped_foundation_is_stiffer_than_any_soil() -> None:
    on_soil = FoundationSprings(k11=1e9, k22=1e11, k12=0.0)
    soft, stiff = (frequencies(uniform_tower(foundation=f))[0] for f in (on_soil, CLAMPED))
    assert soft < stiff


def test_a_flooded_tube_carries_the_water_that_its_steel_leaves_room_for() -> None:
    """Outer circle = steel + water inside: two routes to one mass."""
    sea = Water(density=1025.0, added_mass_coefficient=1.0)
    for tube in parked_turbine().tubes[:7]:
        inside = inner_water_mass(tube, replace(sea, inside=True))
        steel = tube.mass_per_length / tube.density  # its cross-section [m²]
        room = np.pi * tube.diameter**2 / 4 - steel
        assert inside == pytest.approx(sea.density * room, rel=1e-9)
    assert inner_water_mass(parked_turbine().tubes[0], sea) == 0.0
    assert added_mass(parked_turbine().tubes[0], None) == 0.0


def test_water_inside_does_not_follow_the_tide() -> None:
    """An independent model of this turbine has it up to the mean level, as the updating has."""
    sea = Water(added_mass_coefficient=1e-9, inside=True)
    flooded = replace(parked_turbine(), water=sea)
    one, other = (assemble(flooded.with_water_level(level)).mass for level in (0.0, 2.0))
    assert abs(other - one).max() < 1e-8 * abs(one).max()


def test_what_displaces_its_own_water_moves_it() -> None:
    """Archimedes: with C_a = 1 the added mass is that of the displaced water."""
    tube = parked_turbine().tubes[0]
    sea = Water(density=1000.0, added_mass_coefficient=1.0)
    displaced = 1000.0 * np.pi * (tube.diameter / 2) ** 2
    assert added_mass(tube, sea) == pytest.approx(displaced)
    doubled = replace(sea, added_mass_coefficient=2.0)
    assert added_mass(tube, doubled) == pytest.approx(2 * displaced)
