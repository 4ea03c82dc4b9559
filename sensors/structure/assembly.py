"""assemble(description) → StructuralModel: mass and stiffness of tower, rotor-nacelle and blades.

Small motions about the parked position:  M q'' + K(θ) q = Hᵀ F,  reading u = H q.

The degrees of freedom stand in `structural_model`.
Source of the mesh: [foundation-updating] §3.1; what is not stated there stands in the docstrings.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray, IndexArray
from sensors.structure import beam
from sensors.structure.components import TOUCHING, PointMass, Tube, Water
from sensors.structure.description import TurbineDescription
from sensors.structure.rotor_nacelle import (
    ROTATION,
    BladeAxes,
    BladeDirection,
    blade_axes,
    blade_bending,
    hanging_stiffness,
    nacelle_mass,
    rigid_bodies,
    rigid_displacement,
    twisted_blade_bending,
)
from sensors.structure.structural_model import FIXED, HEAVE, PLANE_COLUMNS, TWIST, StructuralModel

BLADE_PLANE: dict[BladeDirection, slice] = {"flap": slice(0, 2), "edge": slice(2, 4)}


def assemble(
    description: TurbineDescription,
    *,
    stiffness: ArrayLike | None = None,
    tube_refinement: int = 1,
) -> StructuralModel:
    """Return the finite-element model of a turbine.

    Parameters
    ----------
    stiffness : ArrayLike, optional, shape (3,)
        θ = (k11, k22, k12) [N/m, N·m/rad, N/rad]; None: the description's.
    tube_refinement : int, optional
        Elements for each tube; the blades keep their elements.
    """
    turbine = description.refined(tube_refinement)
    theta = turbine.nominal if stiffness is None else np.asarray(stiffness, dtype=np.float64)
    tower_dofs, blade_dofs, blade_inner_dofs, n_dofs = _number_dofs(turbine)
    system = _System(np.zeros((n_dofs, n_dofs)), np.zeros((n_dofs, n_dofs)))
    _add_tubes(system, turbine, tower_dofs)
    _add_point_masses(system, turbine, tower_dofs)
    for plane in PLANE_COLUMNS.values():
        system.add(tower_dofs[0, plane], mass=turbine.foundation.mass)
    system.add(
        tower_dofs[-1],
        mass=nacelle_mass(turbine.rotor_nacelle),
        stiffness=_top_hanging_stiffness(turbine),
    )
    without_blades = system.mass.copy()
    _add_blades(system, turbine, tower_dofs, blade_dofs, blade_inner_dofs)
    return StructuralModel(
        description=turbine,
        theta=theta,
        mass=system.mass,
        free_stiffness=system.stiffness,
        blade_mass=system.mass - without_blades,
        elevations=np.array([turbine.mudline, *(tube.top for tube in turbine.tubes)]),
        tower_dofs=tower_dofs,
        blade_dofs=blade_dofs,
        blade_inner_dofs=blade_inner_dofs,
    )


@dataclass(frozen=True, slots=True, eq=False)
class _System:
    """Mass and stiffness while they are being assembled."""

    mass: FloatArray
    stiffness: FloatArray

    def add(
        self,
        dofs: IndexArray,
        *,
        mass: FloatArray | None = None,
        stiffness: FloatArray | None = None,
    ) -> None:
        """Add an element on these degrees of freedom; fixed ones drop out."""
        free = np.flatnonzero(dofs != FIXED)
        kept, places = (free[:, None], free), dofs[free]
        where = places[:, None], places  # as np.ix_ has it, which takes four times as long
        if mass is not None:
            self.mass[where] += mass[kept]
        if stiffness is not None:
            self.stiffness[where] += stiffness[kept]


def _number_dofs(turbine: TurbineDescription) -> tuple[IndexArray, IndexArray, IndexArray, int]:
    """Number the degrees of freedom: tower nodes from the mudline up, then blade after blade.

    The mudline's heave and twist are fixed.
    """
    n_nodes = len(turbine.tubes) + 1
    tower = np.arange(-2, 6 * n_nodes - 2).reshape(n_nodes, 6)
    tower[0] = [0, 1, 2, 3, FIXED, FIXED]
    first = 6 * n_nodes - 2
    if turbine.blades is None:
        return tower, np.zeros((0, 0, 4), np.intp), np.zeros((0, 0), np.intp), first
    number, n_elements = turbine.blades.number, len(turbine.blades.elements)
    inner = 2 * turbine.blades.modes_per_element * n_elements
    dofs = first + np.arange(number * (4 * n_elements + inner)).reshape(number, -1)
    nodes = dofs[:, : 4 * n_elements].reshape(number, n_elements, 4)
    return tower, nodes, dofs[:, 4 * n_elements :], first + dofs.size


def _add_tubes(system: _System, turbine: TurbineDescription, tower_dofs: IndexArray) -> None:
    for i, (tube, compression) in enumerate(zip(turbine.tubes, _compression(turbine), strict=True)):
        carried = growth_mass(tube, turbine.water) + inner_water_mass(tube, turbine.water)
        below_mean = share_below_mean(tube, turbine.water), carried
        wetted = wetted_share(tube, turbine.water), added_mass(tube, turbine.water)
        mass, stiffness = _tube_matrices(tube, compression, wetted, below_mean)
        system.add(tower_dofs[i : i + 2].ravel(), mass=mass, stiffness=stiffness)


@lru_cache(maxsize=1024)  # a structure is assembled a hundred times with nearly the same tubes
def _tube_matrices(
    tube: Tube,
    compression: tuple[float, float],
    wetted: tuple[float, float],
    below_mean: tuple[float, float],
) -> tuple[FloatArray, FloatArray]:
    """(12, 12) mass and stiffness of a tube under a compression at its bottom and its top [N].

    wetted, below_mean    share of its length from below [-] and mass of what is there [kg/m]
    """
    shear = tube.shear_parameter
    bending = beam.bending_stiffness(tube.bending_rigidity, tube.length, shear)
    bending += beam.geometric_stiffness(-compression[0], -compression[1], tube.length, shear)
    moving = beam.bending_mass(tube.mass_per_length, tube.length, shear=shear)
    if tube.shear:
        moving += beam.rotary_mass(tube.density * tube.second_moment, tube.length, shear)
    for share, mass_per_length in (wetted, below_mean):
        moving += beam.bending_mass(mass_per_length, tube.length, end=share, shear=shear)
    mass, stiffness = np.zeros((12, 12)), np.zeros((12, 12))
    dofs = np.arange(12).reshape(2, 6)
    for plane in PLANE_COLUMNS.values():
        where = np.ix_(dofs[:, plane].ravel(), dofs[:, plane].ravel())
        mass[where], stiffness[where] = moving, bending
    along, around = (np.ix_(dofs[:, column], dofs[:, column]) for column in (HEAVE, TWIST))
    mass[along] = beam.rod_mass(tube.mass_per_length, tube.length)
    stiffness[along] = beam.rod_stiffness(tube.youngs_modulus * tube.area, tube.length)
    mass[around] = beam.rod_mass(2 * tube.density * tube.second_moment, tube.length)
    stiffness[around] = beam.rod_stiffness(tube.torsional_rigidity, tube.length)
    return mass, stiffness


def _add_point_masses(system: _System, turbine: TurbineDescription, tower_dofs: IndexArray) -> None:
    """On the element that holds each, by the same cubics as its displacement."""
    for point in turbine.point_masses:
        number = next(i for i, t in enumerate(turbine.tubes) if point.elevation <= t.top + TOUCHING)
        tube = turbine.tubes[number]
        xi = (point.elevation - tube.bottom) / tube.length
        N = beam.hermite(xi, tube.length, tube.shear_parameter)
        along = np.array([1 - xi, xi])
        for plane in PLANE_COLUMNS.values():
            dofs = tower_dofs[number : number + 2, plane].ravel()
            system.add(dofs, mass=point.mass * np.outer(N, N))
        system.add(tower_dofs[number : number + 2, HEAVE], mass=point.mass * np.outer(along, along))


def wetted_share(tube: Tube, water: Water | None) -> float:
    """Share of the tube's length, from below, that stands in water, in [0, 1]."""
    if water is None:
        return 0.0
    return float(np.clip((water.level - tube.bottom) / tube.length, 0.0, 1.0))


def added_mass(tube: Tube, water: Water | None) -> float:
    """Mass of the sea that moves with a wetted metre of the tube, C_a ρ π D²/4 [kg/m]."""
    if water is None:
        return 0.0
    return water.added_mass_coefficient * water.density * np.pi * tube.diameter**2 / 4


def inner_water_mass(tube: Tube, water: Water | None) -> float:
    """Mass of the water inside a metre of a flooded tube, ρ π (D − 2t)²/4 [kg/m]."""
    if water is None or not water.inside:
        return 0.0
    return water.density * np.pi * (tube.diameter - 2 * tube.thickness) ** 2 / 4


def share_below_mean(tube: Tube, water: Water | None) -> float:
    """Share of the tube's length, from below, that lies under the mean water level, in [0, 1]."""
    return float(np.clip((0.0 - tube.bottom) / tube.length, 0.0, 1.0)) if water else 0.0


def growth_mass(tube: Tube, water: Water | None) -> float:
    """Mass of marine growth h thick and of the further water that it takes along [kg/m].

    π (D h + h²) ρ_g + C_a ρ π ((D + 2h)² − D²) / 4, the same in both horizontal directions
    """
    if water is None or water.growth == 0:
        return 0.0
    ring = np.pi * (tube.diameter + water.growth) * water.growth
    return float(ring * (water.growth_density + water.added_mass_coefficient * water.density))


def _compression(turbine: TurbineDescription) -> list[tuple[float, float]]:
    """Axial compression of each tube at its bottom and its top [N]: the weight above."""
    carried = sum(body.mass for body in rigid_bodies(turbine.rotor_nacelle)) + _blade_masses(
        turbine
    )
    forces = []
    for tube in reversed(turbine.tubes):
        carried += sum(each.mass for each in turbine.point_masses if _at_top(each, tube))
        below = carried + tube.mass_per_length * tube.length
        below += sum(each.mass for each in turbine.point_masses if _inside(each, tube))
        forces.append((turbine.gravity * below, turbine.gravity * carried))
        carried = below
    return forces[::-1]


def _at_top(point: PointMass, tube: Tube) -> bool:
    return abs(point.elevation - tube.top) < TOUCHING


def _inside(point: PointMass, tube: Tube) -> bool:
    return tube.bottom + TOUCHING <= point.elevation <= tube.top - TOUCHING


def _blade_masses(turbine: TurbineDescription) -> float:
    """Mass of all blades [kg]."""
    if turbine.blades is None:
        return 0.0
    one = sum(part.mass_per_length * part.length for part in turbine.blades.elements)
    return turbine.blades.number * one


def _top_hanging_stiffness(turbine: TurbineDescription) -> FloatArray:
    """(6, 6) gravity stiffness of everything on the tower's top, the blades as if rigid.

    What gravity does to the bending of a blade is left out: at standstill it moves a blade's own
    frequency by less than 1 %, upwards or downwards with its azimuth.
    """
    moment = sum(body.mass * body.centre[2] for body in rigid_bodies(turbine.rotor_nacelle))
    if turbine.blades is not None:
        for number in range(turbine.blades.number):
            axes = blade_axes(turbine.rotor_nacelle, turbine.blades, number)
            for part in turbine.blades.elements:
                middle = axes.root + (part.inner + part.outer) / 2 * axes.span
                moment += part.mass_per_length * part.length * middle[2]
    return hanging_stiffness(turbine.gravity * moment)


def _add_blades(
    system: _System,
    turbine: TurbineDescription,
    tower_dofs: IndexArray,
    blade_dofs: IndexArray,
    blade_inner_dofs: IndexArray,
) -> None:
    blades = turbine.blades
    if blades is None:
        return
    whole = twisted_blade_bending(blades) if blades.is_twisted else None
    bending = {direction: blade_bending(blades, direction) for direction in BLADE_PLANE}
    for number in range(blades.number):
        axes = blade_axes(turbine.rotor_nacelle, blades, number)
        inner = dict(zip(BLADE_PLANE, np.split(blade_inner_dofs[number], 2), strict=True))
        along_span = axes.span @ rigid_displacement(axes.root)
        axial_mass = _blade_masses(turbine) / blades.number * np.outer(along_span, along_span)
        system.add(tower_dofs[-1], mass=axial_mass)
        if whole is not None:
            halves = [
                _attachment(_root_motion(axes, direction), len(whole.mass) // 2)
                for direction in BLADE_PLANE
            ]
            attach = _side_by_side(*halves)
            own_dofs = [
                np.concatenate([blade_dofs[number, :, columns].ravel(), inner[direction]])
                for direction, columns in BLADE_PLANE.items()
            ]
            system.add(
                np.concatenate([tower_dofs[-1], *own_dofs]),
                mass=attach.T @ whole.mass @ attach,
                stiffness=attach.T @ whole.stiffness @ attach,
            )
            continue
        for direction, columns in BLADE_PLANE.items():
            own = bending[direction]
            attach = _attachment(_root_motion(axes, direction), len(own.mass))
            nodes = blade_dofs[number, :, columns].ravel()
            system.add(
                np.concatenate([tower_dofs[-1], nodes, inner[direction]]),
                mass=attach.T @ own.mass @ attach,
                stiffness=attach.T @ own.stiffness @ attach,
            )


def _root_motion(axes: BladeAxes, direction: BladeDirection) -> FloatArray:
    """(2, 6): (v, v') of a blade's root when the tower's top moves, in one bending direction."""
    normal = axes.flap if direction == "flap" else axes.edge
    displacement = normal @ rigid_displacement(axes.root)
    slope = normal @ np.cross(np.eye(3), axes.span).T @ ROTATION  # n · (θ × span)
    return np.stack([displacement, slope])


def _attachment(root: FloatArray, size: int) -> FloatArray:
    """(size, 6 + size − 2): a blade's own degrees of freedom from (tower's top, nodes, inner)."""
    attach = np.zeros((size, 6 + size - 2))
    attach[:2, :6] = root
    attach[2:, 6:] = np.eye(size - 2)
    return attach


def _side_by_side(flap: FloatArray, edge: FloatArray) -> FloatArray:
    """Two attachments to the same tower top as one, (2 size, 6 + 2 (size − 2))."""
    top = np.concatenate([flap[:, :6], edge[:, :6]])
    none = np.zeros_like(flap[:, 6:])
    own = np.block([[flap[:, 6:], none], [none, edge[:, 6:]]])
    return np.concatenate([top, own], axis=1)
