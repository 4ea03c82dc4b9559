"""What the tower carries: rigid bodies on its top and the blades of the locked rotor.

A rigid motion is written as q = (u_x, ψ_x, u_y, ψ_y, u_z, θ_z), the six degrees of freedom of a
tower node: displacement [m] and slope du/dz [rad] in the two vertical planes, heave [m] and twist
[rad]. The rotation vector is θ = (−ψ_y, ψ_x, θ_z), x downwind, y to the side, z up.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from sensors.arrays import FloatArray
from sensors.structure.beam import craig_bampton_element
from sensors.structure.components import Blades, RigidBody, RotorNacelle

BladeDirection = Literal["flap", "edge"]

# rows: rotation vector (θ_x, θ_y, θ_z); columns: (u_x, ψ_x, u_y, ψ_y, u_z, θ_z)
ROTATION = np.array([[0.0, 0, 0, -1, 0, 0], [0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1]])
_TRANSLATION = np.array([[1.0, 0, 0, 0, 0, 0], [0, 0, 1, 0, 0, 0], [0, 0, 0, 0, 1, 0]])


def rigid_displacement(arm: ArrayLike) -> FloatArray:
    """Displacement (x, y, z) of a point that moves rigidly with a node.

    Parameters
    ----------
    arm : ArrayLike, shape (3,)
        r, from the node to the point [m].

    Returns
    -------
    ndarray, shape (3, 6)
        u + θ × r as a matrix on (u_x, ψ_x, u_y, ψ_y, u_z, θ_z).
    """
    x, y, z = np.asarray(arm, dtype=np.float64)
    cross = np.array([[0.0, z, -y], [-z, 0.0, x], [y, -x, 0.0]])  # θ × r = cross @ θ
    return _TRANSLATION + cross @ ROTATION


def rigid_body_mass(mass: float, centre: ArrayLike, inertia: ArrayLike) -> FloatArray:
    """(6, 6) mass of a rigid body on a node.

    Parameters
    ----------
    mass : float
        [kg].
    centre : ArrayLike, shape (3,)
        Of mass, from the node [m].
    inertia : ArrayLike, shape (3,) or (3, 3)
        About the centre: on the diagonal, or the full tensor [kg·m²].
    """
    moments = np.asarray(inertia, dtype=np.float64)
    tensor = np.diag(moments) if moments.ndim == 1 else moments
    motion = rigid_displacement(centre)
    return mass * motion.T @ motion + ROTATION.T @ tensor @ ROTATION


def hanging_stiffness(moment: float) -> FloatArray:
    """(6, 6) stiffness of a dead weight that stands above a node: an inverted pendulum.

    Parameters
    ----------
    moment : float
        Weight × height of its centre of gravity above the node [N·m].

    Returns
    -------
    ndarray, shape (6, 6)
        K = −moment on ψ_x and on ψ_y.

    Notes
    -----
    The centre's horizontal offset would add terms in θ_z ψ that depend on the order in which finite
    rotations are composed; they are left out.
    """
    return -moment * np.diag([0.0, 1, 0, 1, 0, 0])


def apex(nacelle: RotorNacelle) -> FloatArray:
    """Return where the blade axes meet on the shaft, from the tower's top, (3,) [m]."""
    tilt = np.radians(nacelle.tilt)
    offset = nacelle.overhang * np.array([np.cos(tilt), 0.0, -np.sin(tilt)])
    return np.array([0.0, 0.0, nacelle.tower_to_shaft]) + offset


def rigid_bodies(nacelle: RotorNacelle) -> tuple[RigidBody, ...]:
    """Return the bodies on the tower's top, the hub's mass among them."""
    x, y, z = apex(nacelle).tolist()
    hub = RigidBody(name="hub", mass=nacelle.hub_mass, centre=(x, y, z))
    return (*nacelle.bodies, hub) if nacelle.hub_mass > 0 else nacelle.bodies


def nacelle_mass(nacelle: RotorNacelle) -> FloatArray:
    """(6, 6) mass of everything rigid on the tower's top.

    The hub is a disc round the tilted shaft: half its inertia across the shaft.
    """
    shaft = _shaft(nacelle)
    disc = nacelle.hub_inertia / 2 * (np.eye(3) + np.outer(shaft, shaft))
    mass = ROTATION.T @ disc @ ROTATION
    for body in rigid_bodies(nacelle):
        mass += rigid_body_mass(body.mass, body.centre, body.tensor)
    return mass


def _shaft(nacelle: RotorNacelle) -> FloatArray:
    """Unit vector along the shaft, upwind and up, (3,) [-]."""
    tilt = np.radians(nacelle.tilt)
    return np.array([-np.cos(tilt), 0.0, np.sin(tilt)])


@dataclass(frozen=True, slots=True, eq=False)
class BladeAxes:
    """Where one blade is and how it stands, in tower axes."""

    root: FloatArray
    """Root from the tower's top, (3,) [m]."""

    span: FloatArray
    """Unit vector root → tip, (3,)."""

    flap: FloatArray
    """Unit vector of flapwise displacement (across the chord), (3,)."""

    edge: FloatArray
    """Unit vector of edgewise displacement (along the chord), (3,)."""


def blade_axes(nacelle: RotorNacelle, blades: Blades, number: int) -> BladeAxes:
    """Axes of blade `number`; its azimuth turns from up towards +y.

    Parameters
    ----------
    nacelle : RotorNacelle
        With the shaft.
    blades : Blades
        Cone, pitch and the first one's azimuth [deg], and how many there are.
    number : int
        Of the blade, from 0.

    Notes
    -----
    At pitch 0 the chord lies in the rotor's plane and flapwise is along the shaft; at 90° the
    chord lies along the shaft, so that fore-aft motion bends the blade edgewise.
    """
    azimuth = np.radians(blades.azimuth) + 2 * np.pi * number / blades.number
    cone, pitch = np.radians(blades.cone), np.radians(blades.pitch)
    shaft, side = _shaft(nacelle), np.array([0.0, 1.0, 0.0])
    up = np.cross(side, shaft)
    radial = np.cos(azimuth) * up + np.sin(azimuth) * side
    tangential = -np.sin(azimuth) * up + np.cos(azimuth) * side
    span = np.cos(cone) * radial + np.sin(cone) * shaft
    out_of_plane = np.cos(cone) * shaft - np.sin(cone) * radial
    return BladeAxes(
        root=apex(nacelle) + blades.hub_radius * span,
        span=span,
        flap=np.cos(pitch) * out_of_plane + np.sin(pitch) * tangential,
        edge=-np.sin(pitch) * out_of_plane + np.cos(pitch) * tangential,
    )


@dataclass(frozen=True, slots=True, eq=False)
class BladeBending:
    """One blade's bending in one direction, root included.

    Degrees of freedom (v, v') at the root, then (v, v') at every further node from root to tip,
    then the elements' clamped-clamped amplitudes.
    """

    stiffness: FloatArray
    """Stiffness, (n, n)."""

    mass: FloatArray
    """Mass, (n, n)."""


def blade_bending(blades: Blades, direction: BladeDirection) -> BladeBending:
    """Mass and stiffness of a blade in flapwise or edgewise bending, free at both ends."""
    n_nodes, n_modes = len(blades.elements) + 1, blades.modes_per_element
    size = 2 * n_nodes + n_modes * len(blades.elements)
    stiffness, mass = np.zeros((size, size)), np.zeros((size, size))
    for i, part in enumerate(blades.elements):
        rigidity = part.flapwise_rigidity if direction == "flap" else part.edgewise_rigidity
        element = craig_bampton_element(rigidity, part.mass_per_length, part.length, modes=n_modes)
        inner = 2 * n_nodes + n_modes * i
        dofs = np.r_[2 * i : 2 * i + 4, inner : inner + n_modes]
        stiffness[np.ix_(dofs, dofs)] += element.stiffness
        mass[np.ix_(dofs, dofs)] += element.mass
    return BladeBending(stiffness=stiffness, mass=mass)


def twisted_blade_bending(blades: Blades) -> BladeBending:
    """Return one blade's bending in both directions, coupled where an element's axes are turned.

    Degrees of freedom: those of `blade_bending` flapwise, then edgewise. An element bends about
    axes turned by its twist τ, v_p = cos τ v_flap + sin τ v_edge and across it; its own
    clamped-clamped amplitudes are along those.
    """
    n_nodes, n_modes = len(blades.elements) + 1, blades.modes_per_element
    size = 2 * n_nodes + n_modes * len(blades.elements)
    stiffness, mass = np.zeros((2 * size, 2 * size)), np.zeros((2 * size, 2 * size))
    for i, part in enumerate(blades.elements):
        inner = 2 * n_nodes + n_modes * i
        dofs = np.r_[2 * i : 2 * i + 4, inner : inner + n_modes]
        both = np.concatenate([dofs, size + dofs])
        turn = _element_turn(np.radians(part.twist), n_modes)
        for number, rigidity in enumerate((part.flapwise_rigidity, part.edgewise_rigidity)):
            rows = turn[number * len(dofs) : (number + 1) * len(dofs)]
            element = craig_bampton_element(
                rigidity, part.mass_per_length, part.length, modes=n_modes
            )
            stiffness[np.ix_(both, both)] += rows.T @ element.stiffness @ rows
            mass[np.ix_(both, both)] += rows.T @ element.mass @ rows
    return BladeBending(stiffness=stiffness, mass=mass)


def _element_turn(twist: float, n_modes: int) -> FloatArray:
    """(2n, 2n) from flapwise and edgewise coordinates of an element to those of its own axes."""
    nodal = np.r_[np.ones(4), np.zeros(n_modes)]
    own = np.diag(np.r_[np.zeros(4), np.ones(n_modes)])
    along, across = np.cos(twist) * np.diag(nodal), np.sin(twist) * np.diag(nodal)
    return np.block([[along + own, across], [-across, along + own]])
