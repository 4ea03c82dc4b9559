"""A parked IEA 15 MW monopile by finite elements of its own: the truth that tests are made of.

Axes: x downwind (fore-aft), y to the side, z up from the mean sea level. Every node of monopile
and tower has (u_x, u_y, u_z, θ_x, θ_y, θ_z), displacements [m] and right-handed rotations [rad].
Every node of a blade has displacement and slope along the blade's two axes; axially and in twist a
blade follows its root. Weight is geometric stiffness of the tower. Tubes bend (Euler-Bernoulli) or
shear too (Timoshenko): then θ is the section's rotation, v' = θ + γ the slope of the axis, and the
shear strain γ a parabola of its own in each element, free to jump where the section does.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import eigh
from scipy.sparse import csr_array
from scipy.spatial.transform import Rotation

from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.arrays import FloatArray, IntArray
from tests.outside import sections as iea
from tests.outside.beams import integration_points, quadratic, quintic, weighted
from tests.outside.figures import Figures
from tests.outside.sections import BladeSection, Can

SpringSign = Literal["published", "embedded-pile"]

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
"""k11 [N/m], k22 [N·m/rad], k12 [N/rad]: [foundation-updating] Eq. 12."""

N_BLADES = 3
HIGHEST_FREQUENCY = 16.0  # of the modes that are computed [Hz]
# (dof, sign) of v and v' = dv/dz in the two vertical planes: du_x/dz = θ_y, du_y/dz = −θ_x
PLANES = (((0, 1.0), (4, 1.0)), ((1, 1.0), (3, -1.0)))
HEAVE, TWIST = 2, 5
SHEAR_COEFFICIENT = 2 * (1 + iea.POISSON_RATIO) / (4 + 3 * iea.POISSON_RATIO)
"""κ of a thin round tube [-]: Cowper, "The shear coefficient in Timoshenko's beam theory", Journal
of Applied Mechanics 33 (1966) 335-340."""


@dataclass(frozen=True, slots=True)
class Description:
    """What is modelled, apart from its figures."""

    cans: tuple[Can, ...]
    """Monopile and tower from the mudline up; one element each."""
    blade: tuple[BladeSection, ...]
    """From root to tip; one element each. Empty: no blades."""
    blade_bubbles: Literal[1, 2] = 2
    """Inner shapes of a blade element in each direction: (1 − ξ²)², or ξ (1 − ξ²)² too."""
    lumped_top: tuple[float, float, float] | None = None
    """Instead of nacelle and hub: mass [kg], height of its centre above the tower's top [m],
    moment of inertia about its centre, equal about all axes [kg·m²]."""
    shear: bool = False
    """Whether tubes deform by shear and their sections' rotation has inertia."""
    gravity: float = iea.GRAVITY
    """[m/s²]"""


def averaged() -> Description:
    """Uniform tubes and blade lengths as [foundation-updating] has them, and its reduced blade.

    Of each of the six lengths of a blade it keeps two Craig-Bampton modes, one in each direction;
    here one polynomial in each direction does. That leaves modes above 5 Hz up to .3 % too high.
    """
    return Description(iea.averaged_cans(), iea.averaged_blade(cut=1), blade_bubbles=1)


def converged() -> Description:
    """The same tubes and blade lengths with elements enough: frequencies are exact to 1e-5."""
    return Description(iea.averaged_cans(), iea.averaged_blade(cut=2))


def detailed() -> Description:
    """Tapered cans and a distributed, twisted blade."""
    return Description(iea.tapered_cans(), iea.distributed_blade())


@dataclass(frozen=True, eq=False)
class Modes:
    """Undamped modes of one structure, lowest first."""

    structure: "Structure"
    frequencies: FloatArray
    """(n_modes,) [Hz]"""
    vectors: FloatArray
    """(n_dofs, n_modes), mass-normalised [kg^-½]."""

    def readings(self, layout: SensorLayout) -> FloatArray:
        """Read what DC accelerometers see of each mode: φ + g ψ / ω².

        Returns
        -------
        ndarray, shape (n_modes, n_channels)
            Times −ω² it is the acceleration reading u'' − g ψ per unit modal amplitude.
        """
        squares = (2 * np.pi * self.frequencies) ** 2
        columns = []
        for axis in layout.channels:
            displacement, slope = self.structure.axis_rows(axis)
            tilt = self.structure.description.gravity * (slope @ self.vectors) / squares
            columns.append(displacement @ self.vectors + tilt)
        return np.stack(columns, axis=1)

    @property
    def directions(self) -> tuple[str, ...]:
        """ "FA" or "SS": the plane in which the tower moves more."""
        fore_aft, side = (
            sum((self.vectors[node + plane] ** 2) for node in self.structure.node_starts)
            for plane in (0, 1)
        )
        return tuple("FA" if x > y else "SS" for x, y in zip(fore_aft, side, strict=True))


@dataclass(frozen=True, eq=False)
class Structure:
    """Mass and stiffness of one turbine, without the springs at its mudline."""

    description: Description
    figures: Figures
    mass: FloatArray
    """(n_dofs, n_dofs) [kg, kg·m, kg·m²]"""
    stiffness: FloatArray
    """(n_dofs, n_dofs), elastic and of weight [N/m, N, N·m]"""

    @cached_property
    def node_starts(self) -> IntArray:
        """First degree of freedom of each node of monopile and tower, mudline first."""
        return 6 * np.arange(2 * len(self.description.cans) + 1)

    @cached_property
    def basis(self) -> csr_array:
        """(n_dofs, n): all motions that are free; heave and twist are held at the mudline."""
        size, parts = len(self.mass), self.description.blade
        basis, held = np.eye(size), [HEAVE, TWIST]
        for blade in range(N_BLADES if self.description.blade_bubbles == 1 else 0):
            for index, part in enumerate(parts):
                local = _blade_transform(self.description, blade, index, size)
                for start, slope, _, middle_slope, end, end_slope in (local[:6], local[6:]):
                    # without ξ (1 − ξ²)² the middle's slope is that of the cubic through the ends
                    middle = int(np.argmax(middle_slope))
                    rise = (end - start) / (part.outer - part.inner)
                    basis[middle] = 1.5 * rise - (slope + end_slope) / 4
                    held.append(middle)
        return csr_array(basis[:, np.setdiff1d(np.arange(size), held)])

    def modes(
        self,
        theta: ArrayLike = NOMINAL,
        sign: SpringSign = "published",
        highest_frequency: float = HIGHEST_FREQUENCY,
    ) -> Modes:
        """Solve for the modes on springs θ = (k11, k22, k12), (3,) [N/m, N·m/rad, N/rad].

        Raises
        ------
        ValueError
            If the structure falls over on these springs.
        """
        stiffness = self.stiffness.copy()
        springs = spring_matrix(theta, sign)
        for (v, positive), (slope, turn) in PLANES:
            turned = np.outer([positive, turn], [positive, turn])
            stiffness[np.ix_([v, slope], [v, slope])] += turned * springs
        basis = self.basis
        # M φ = (1/ω²) K φ: its largest values are the lowest modes, and the most exact ones
        least = (2 * np.pi * highest_frequency) ** -2
        try:
            flexibilities, found = eigh(
                basis.T @ (basis.T @ self.mass).T,
                basis.T @ (basis.T @ stiffness).T,
                subset_by_value=(least, np.inf),
                driver="gvx",
            )
        except np.linalg.LinAlgError as error:
            raise ValueError(
                f"unstable under its own weight on the springs {np.asarray(theta)}"
            ) from error
        omega = flexibilities[::-1] ** -0.5
        return Modes(self, omega / (2 * np.pi), basis @ (found[:, ::-1] * omega))

    def displacement_row(self, elevation: float, direction: ArrayLike) -> FloatArray:
        """(n_dofs,): displacement of the tower along a direction; the same row places a force."""
        return self._row(elevation, direction, derivative=0)

    def rotation_row(self, elevation: float, direction: ArrayLike) -> FloatArray:
        """(n_dofs,): rotation of the tower's section towards a direction, which without shear is
        its slope d_x du_x/dz + d_y du_y/dz [rad]."""
        return self._row(elevation, direction, derivative=1)

    def axis_rows(self, axis: Accelerometer) -> tuple[FloatArray, FloatArray]:
        """Displacement and rotation rows of a DC accelerometer's axis."""
        if axis.coupling != "dc":
            raise ValueError(f"channel {axis.name}: coupling is {axis.coupling}, not dc")
        place = (axis.elevation, axis.direction)
        return self.displacement_row(*place), self.rotation_row(*place)

    def blade_row(self, blade: int, distance: float, direction: ArrayLike) -> FloatArray:
        """(n_dofs,): displacement of a blade at a distance from its root along (x, y, z)."""
        parts = self.description.blade
        index = next(i for i, part in enumerate(parts) if distance <= part.outer + 1e-9)
        part, axes = parts[index], _blade_axes(blade)
        shapes = quintic(np.array([distance]), part.inner, part.outer)[0]
        local = _blade_transform(self.description, blade, index, len(self.mass))
        d = np.asarray(direction, dtype=np.float64)
        row = (axes[:, 0] @ d) * (shapes @ local[:6]) + (axes[:, 1] @ d) * (shapes @ local[6:])
        top = self.node_starts[-1]
        row[top : top + 6] += (axes[:, 2] @ d) * (axes[:, 2] @ rigid_motion(_blade_root(blade)))
        return row

    def blade_axes(self, blade: int) -> FloatArray:
        """(3, 3), columns: flapwise, edgewise and span of a blade in x, y, z [-]."""
        return _blade_axes(blade)

    def _row(self, elevation: float, direction: ArrayLike, derivative: int) -> FloatArray:
        cans = self.description.cans
        if not cans[0].bottom <= elevation <= cans[-1].top:
            raise ValueError(f"elevation {elevation:g} m is not on the tower")
        index = next(i for i, can in enumerate(cans) if elevation <= can.top)
        at = (np.array([elevation]), cans[index].bottom, cans[index].top)
        row = np.zeros(len(self.mass))
        for share, plane in zip(np.asarray(direction)[:2], range(len(PLANES)), strict=True):
            dofs, axis, strain = _bending(self, index, plane)
            shapes = quintic(*at, derivative=derivative)[0] @ axis
            row[dofs] += share * (shapes - derivative * quadratic(*at)[0] @ strain)
        return row


def modes(
    theta: ArrayLike = NOMINAL,
    figures: Figures | None = None,
    sign: SpringSign = "published",
    *,
    description: Description | None = None,
) -> Modes:
    """Assemble a turbine with these figures and solve for its modes on these springs."""
    return assemble(figures, description).modes(theta, sign)


def spring_matrix(theta: ArrayLike, sign: SpringSign) -> FloatArray:
    """(2, 2) on (v, dv/dz) of the mudline: +k12 as published, −k12 of an embedded pile."""
    k11, k22, k12 = np.asarray(theta, dtype=np.float64)
    coupling = k12 if sign == "published" else -k12
    return np.array([[k11, coupling], [coupling, k22]])


def assemble(figures: Figures | None = None, description: Description | None = None) -> Structure:
    """Assemble mass and stiffness of a turbine with these figures."""
    figures, described = figures or Figures(), description or averaged()
    n_blade = N_BLADES * 8 * len(described.blade)
    size = 6 * (2 * len(described.cans) + 1) + n_blade + 6 * len(described.cans) * described.shear
    structure = Structure(described, figures, np.zeros((size, size)), np.zeros((size, size)))
    carried = _add_top(structure)
    for index in reversed(range(len(described.cans))):
        carried = _add_can(structure, index, carried)
    return structure


def rigid_motion(arm: ArrayLike) -> FloatArray:
    """(3, 6): u + θ × r on (u, θ) of a node, for a point at r from it [m]."""
    x, y, z = np.asarray(arm, dtype=np.float64)
    cross = np.array([[0, z, -y], [-z, 0, x], [y, -x, 0]])
    return np.hstack([np.eye(3), cross])


def _bending(
    structure: Structure, index: int, plane: int
) -> tuple[IntArray, FloatArray, FloatArray]:
    """Degrees of freedom (n,) of an element's bending in one plane; of these, the axis' (v, v'),
    (6, n), and the shear strain γ, (3, n), at its start, middle and end."""
    (v, positive), (slope, turn) = PLANES[plane]
    starts = 6 * (2 * index + np.arange(3, dtype=np.intp))
    dofs = (starts[:, None] + np.array([v, slope], dtype=np.intp)).ravel()
    axis, strain = np.diag([positive, turn] * 3), np.zeros((3, 6))
    if structure.description.shear:  # after all others, three to an element and plane
        first = len(structure.mass) - 6 * (len(structure.description.cans) - index) + 3 * plane
        dofs = np.concatenate([dofs, first + np.arange(3, dtype=np.intp)])
        strain = np.eye(3, 9, 6)
        axis = np.hstack([axis, np.kron(np.eye(3), [[0.0], [1.0]])])
    return dofs, axis, strain


def _add_can(structure: Structure, index: int, carried: float) -> float:
    """Add an element of monopile or tower that carries so much mass; return it with its own."""
    can, figures = structure.description.cans[index], structure.figures
    if np.isclose(can.top, iea.TRANSITION):
        carried += figures.transition_piece
        node = 6 * (2 * index + 2)
        for dof in range(3):
            structure.mass[node + dof, node + dof] += figures.transition_piece
    cuts = (0.0, figures.water_level)
    z, weights = integration_points(can.bottom, can.top, cuts)
    wall = can.thickness * figures.wall_thickness
    diameter = can.diameter(z)
    inner = diameter - 2 * wall
    area = np.pi * (diameter**2 - inner**2) / 4
    second = np.pi * (diameter**4 - inner**4) / 64
    steel = can.density * figures.density * area
    modulus = iea.YOUNGS_MODULUS * figures.youngs_modulus
    above = carried + _mass_above(can, figures, z)
    shapes, slopes, bends = (quintic(z, can.bottom, can.top, order) for order in range(3))
    lengths, strains = (quadratic(z, can.bottom, can.top, order) for order in range(2))
    shear_modulus = modulus / (2 * (1 + iea.POISSON_RATIO))
    moving = steel + _moving_water(figures, diameter, wall, z)
    weight = structure.description.gravity * above
    for plane in range(len(PLANES)):
        dofs, axis, strain = _bending(structure, index, plane)
        where, sheared = np.ix_(dofs, dofs), lengths @ strain
        structure.mass[where] += weighted(shapes @ axis, weights * moving)
        structure.stiffness[where] += weighted(
            bends @ axis - strains @ strain, weights * modulus * second
        ) - weighted(slopes @ axis, weights * weight)
        if structure.description.shear:
            rotary = weights * steel / area * second
            structure.mass[where] += weighted(slopes @ axis - sheared, rotary)
            resisting = weights * SHEAR_COEFFICIENT * shear_modulus * area
            structure.stiffness[where] += weighted(sheared, resisting)
    for dof, inertia, rigidity in (
        (HEAVE, steel, modulus * area),
        (TWIST, steel / area * 2 * second, shear_modulus * 2 * second),
    ):
        where = np.ix_(*[6 * (2 * index + np.arange(3)) + dof] * 2)
        structure.mass[where] += weighted(lengths, weights * inertia)
        structure.stiffness[where] += weighted(strains, weights * rigidity)
    return carried + float(weights @ steel)


def _mass_above(can: Can, figures: Figures, z: FloatArray) -> FloatArray:
    """Steel of a can above elevations [kg]; its mass per length is linear in z."""
    wall = can.thickness * figures.wall_thickness
    ends = np.pi * can.density * figures.density * wall * (np.array(can.diameters) - wall)
    here = np.interp(z, (can.bottom, can.top), ends)
    return (can.top - z) * (here + ends[1]) / 2


def _moving_water(figures: Figures, diameter: FloatArray, wall: float, z: FloatArray) -> FloatArray:
    """Mass per length of water outside and inside and of marine growth at elevations [kg/m]."""
    growth = np.where(z < 0, figures.marine_growth, 0.0)
    outside = np.pi / 4 * (diameter + 2 * growth) ** 2
    moving = np.where(z < figures.water_level, figures.added_mass * iea.WATER_DENSITY * outside, 0)
    moving += iea.GROWTH_DENSITY * (outside - np.pi / 4 * diameter**2)
    if figures.flooded:
        inside = np.pi / 4 * (diameter - 2 * wall) ** 2
        moving += np.where(z < 0, iea.WATER_DENSITY * inside, 0.0)
    return moving


def _add_top(structure: Structure) -> float:
    """Add nacelle, hub and blades to the uppermost node; return their mass [kg]."""
    described = structure.description
    top = structure.node_starts[-1]
    carried = moment = 0.0
    for mass, centre, inertia in _bodies(described, structure.figures):
        motion = rigid_motion(centre)
        body = mass * motion.T @ motion
        body[3:, 3:] += inertia
        structure.mass[top : top + 6, top : top + 6] += body
        carried, moment = carried + mass, moment + mass * centre[2]
    for blade in range(N_BLADES if described.blade else 0):
        mass, first = _add_blade(structure, blade)
        centre_height = _blade_root(blade)[2] * mass + _blade_axes(blade)[2, 2] * first
        carried, moment = carried + mass, moment + centre_height
    for dof in (top + 3, top + 4):
        structure.stiffness[dof, dof] -= described.gravity * moment
    return carried


def _bodies(described: Description, figures: Figures) -> list[tuple[float, FloatArray, FloatArray]]:
    """Mass [kg], centre from the tower's top [m], inertia about the centre (3, 3) [kg·m²]."""
    if described.lumped_top is not None:
        mass, height, inertia = described.lumped_top
        return [(mass, np.array([0.0, 0.0, height]), inertia * np.eye(3))]
    factor = figures.rna_mass
    shaft = _hub_frame()[:, 0]
    own_inertia = iea.NACELLE_INERTIA * np.array(
        [figures.nacelle_roll_inertia, figures.nacelle_pitch_inertia, figures.nacelle_yaw_inertia]
    )
    disc = iea.HUB_INERTIA / 2 * (np.eye(3) + np.outer(shaft, shaft))
    return [
        (factor * iea.NACELLE_MASS, np.array(iea.NACELLE_CENTRE), np.diag(own_inertia)),
        (factor * iea.HUB_MASS, _apex(), disc),
        (factor * iea.YAW_BEARING_MASS, np.zeros(3), np.zeros((3, 3))),
    ]


def _add_blade(structure: Structure, blade: int) -> tuple[float, float]:
    """Add a blade; return its mass [kg] and first moment about its root [kg·m]."""
    described, figures = structure.description, structure.figures
    top, axes, size = structure.node_starts[-1], _blade_axes(blade), len(structure.mass)
    total = first = 0.0
    for index, part in enumerate(described.blade):
        s, weights = integration_points(part.inner, part.outer, part.stations[:, 0].tolist())
        mass, flap, edge = part.at(s) * np.array(
            [[figures.blade_mass], [figures.flap_stiffness], [figures.edge_stiffness]]
        )
        shapes, bends = (quintic(s, part.inner, part.outer, order) for order in (0, 2))
        local_mass = np.kron(np.eye(2), weighted(shapes, weights * mass))
        c, d = np.cos(np.radians(part.twist)), np.sin(np.radians(part.twist))
        own, across = weighted(bends, weights * flap), weighted(bends, weights * edge)
        local_stiffness = np.kron(np.outer([c, d], [c, d]), own)
        local_stiffness += np.kron(np.outer([-d, c], [-d, c]), across)
        transform = _blade_transform(described, blade, index, size)
        used = np.flatnonzero(np.any(transform != 0, axis=0))
        small, where = transform[:, used], np.ix_(used, used)
        structure.mass[where] += small.T @ local_mass @ small
        structure.stiffness[where] += small.T @ local_stiffness @ small
        total += float(weights @ mass)
        first += float(weights @ (mass * s))
    along = axes[:, 2] @ rigid_motion(_blade_root(blade))
    structure.mass[top : top + 6, top : top + 6] += total * np.outer(along, along)
    return total, first


def _blade_transform(described: Description, blade: int, index: int, size: int) -> FloatArray:
    """(12, size): (v, v') of a blade element's three nodes, flapwise then edgewise, of all dofs."""
    top = 12 * len(described.cans)
    first = top + 6 + 8 * len(described.blade) * blade  # of the blade's first node off the root
    axes = _blade_axes(blade)
    transform = np.zeros((12, size))
    for direction in range(2):
        for local in range(3):
            row, node = 6 * direction + 2 * local, 2 * index + local
            if node == 0:
                normal = axes[:, direction]
                transform[row, top : top + 6] = normal @ rigid_motion(_blade_root(blade))
                transform[row + 1, top + 3 : top + 6] = np.cross(axes[:, 2], normal)
            else:
                dof = first + 4 * (node - 1) + 2 * direction
                transform[row, dof] = transform[row + 1, dof + 1] = 1.0
    return transform


def _hub_frame() -> FloatArray:
    """Columns: shaft (downwind), side, up in the rotor's plane; nose tilted up."""
    return Rotation.from_euler("y", iea.TILT, degrees=True).as_matrix()


def _apex() -> FloatArray:
    """Where the blades' axes meet, from the tower's top (3,) [m]."""
    return np.array([0.0, 0.0, iea.TOWER_TO_SHAFT]) + iea.OVERHANG * _hub_frame()[:, 0]


def _blade_axes(blade: int) -> FloatArray:
    """Columns: flapwise, edgewise, span of a parked blade; the first one stands up."""
    turns = Rotation.from_euler(
        "XYZ", [-360 / N_BLADES * blade, -iea.CONE, iea.PITCH], degrees=True
    )
    return _hub_frame() @ turns.as_matrix()


def _blade_root(blade: int) -> FloatArray:
    """From the tower's top (3,) [m]."""
    return _apex() + iea.HUB_RADIUS * _blade_axes(blade)[:, 2]
