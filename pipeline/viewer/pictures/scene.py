"""The turbine's outline in space [m]: what a picture of it is drawn from. No rerun here.

Axes as in `sensors.acquisition.layout`:
x downwind (fore-aft), y to the side (side-side), z up from mean water.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.components import Blades, RotorNacelle, Tube
from sensors.structure.description import TurbineDescription

SECTORS = 24  # flat faces round a tube
RIM = 48  # corners of the ground and of the sea [-]
GROUND_RADIUS = 40.0  # of the discs that stand for sea and sea bed [m]
SMALLEST_HEIGHT = 60.0  # of a structure drawn in its own size [m]
DRAWN_HEIGHT = 150.0  # of a smaller one in the picture [m]
NACELLE_SIZE = (16.0, 8.0, 8.0)  # for the picture only [m]


@dataclass(frozen=True, slots=True, eq=False)
class TriangleMesh:
    """A surface of triangles."""

    vertices: FloatArray
    """Vertices, shape (n, 3) [m]."""
    triangles: NDArray[np.uint32]
    """(m, 3) indices of vertices."""
    normals: FloatArray
    """(n, 3) unit vectors, outwards [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """The turbine at rest, in drawn metres."""

    structure: TriangleMesh
    """Monopile and tower."""
    tower_top: float
    """Elevation of the tower top [m]."""
    mudline: float
    """Elevation of the mudline [m]."""
    water_level: float | None
    """Elevation of the mean water level [m]; None on land."""
    blades: tuple[FloatArray, ...]
    """(2, 3) each: root and tip [m]."""
    nacelle_centre: FloatArray | None
    """Centre of the nacelle, shape (3,) [m]; None without a rotor-nacelle assembly."""
    scale: float = 1.0
    """Drawn metres per metre of height [-]; small structures are drawn as tall as a tower."""


def outline(description: TurbineDescription) -> Outline:
    """Return what is drawn of a described turbine."""
    height = description.tower_top - description.mudline
    scale = 1.0 if height >= SMALLEST_HEIGHT else DRAWN_HEIGHT / height
    if scale != 1.0:
        return _small_outline(description, scale)
    top = description.tower_top
    machine = description.rotor_nacelle
    blades = blade_lines(description.blades, machine, top) if description.blades else ()
    centre = np.array([0.3 * machine.overhang, 0.0, top + machine.tower_to_shaft])
    return Outline(
        structure=tube_mesh(description.tubes),
        tower_top=top,
        mudline=description.mudline,
        water_level=description.water.level if description.water else None,
        blades=blades,
        nacelle_centre=centre if blades or machine.bodies else None,
    )


def _small_outline(description: TurbineDescription, scale: float) -> Outline:
    """Return the tubes of a small structure, enlarged; text and camera are sized for towers."""
    tubes = [
        replace(
            tube,
            bottom=tube.bottom * scale,
            top=tube.top * scale,
            diameter=tube.diameter * scale,
            thickness=tube.thickness * scale,
        )
        for tube in description.tubes
    ]
    water = description.water
    return Outline(
        structure=tube_mesh(tubes),
        tower_top=description.tower_top * scale,
        mudline=description.mudline * scale,
        water_level=water.level * scale if water else None,
        blades=(),
        nacelle_centre=None,
        scale=scale,
    )


def tube_mesh(tubes: Sequence[Tube]) -> TriangleMesh:
    """Return the outer faces of upright tubes round the z axis."""
    angles = np.arange(SECTORS) * (2 * np.pi / SECTORS)
    outwards = np.stack([np.cos(angles), np.sin(angles), np.zeros(SECTORS)], axis=1)
    rings = [
        outwards * (tube.diameter / 2) + np.array([0.0, 0.0, elevation])
        for tube in tubes
        for elevation in (tube.bottom, tube.top)
    ]
    faces = [_ring_faces(2 * i * SECTORS) for i in range(len(tubes))]
    return TriangleMesh(
        np.concatenate(rings), np.concatenate(faces), np.tile(outwards, (len(rings), 1))
    )


def _ring_faces(first: int) -> NDArray[np.uint32]:
    here = np.arange(SECTORS)
    there = (here + 1) % SECTORS
    lower = np.stack([here, there, here + SECTORS], axis=1)
    upper = np.stack([there, there + SECTORS, here + SECTORS], axis=1)
    return (first + np.concatenate([lower, upper])).astype(np.uint32)


def disc(elevation: float) -> TriangleMesh:
    """Return the ground or the sea: a horizontal disc round the z axis, facing up."""
    angles = np.arange(RIM) * (2 * np.pi / RIM)
    rim = GROUND_RADIUS * np.stack([np.cos(angles), np.sin(angles), np.zeros(RIM)], axis=1)
    vertices = np.concatenate([np.zeros((1, 3)), rim]) + np.array([0.0, 0.0, elevation])
    here = np.arange(RIM)
    fan = np.stack([np.zeros_like(here), here + 1, (here + 1) % RIM + 1], axis=1)
    up = np.tile([0.0, 0.0, 1.0], (len(vertices), 1))
    return TriangleMesh(vertices, fan.astype(np.uint32), up)


def blade_lines(blades: Blades, machine: RotorNacelle, top: float) -> tuple[FloatArray, ...]:
    """Root and tip of every blade, (2, 3) each [m]: straight lines in the coned, tilted rotor."""
    tilt, cone = np.radians([machine.tilt, blades.cone])
    upwind = np.array([-np.cos(tilt), 0.0, np.sin(tilt)])
    up = np.array([np.sin(tilt), 0.0, np.cos(tilt)])
    side = np.array([0.0, 1.0, 0.0])
    apex = np.array([0.0, 0.0, top + machine.tower_to_shaft]) - machine.overhang * upwind
    span = np.array([blades.hub_radius, blades.hub_radius + blades.elements[-1].outer])
    azimuths = np.radians(blades.azimuth) + np.arange(blades.number) * (2 * np.pi / blades.number)
    radial = [np.cos(azimuth) * up + np.sin(azimuth) * side for azimuth in azimuths]
    return tuple(
        apex + span[:, None] * (np.cos(cone) * direction + np.sin(cone) * upwind)
        for direction in radial
    )


@dataclass(frozen=True, slots=True, eq=False)
class Deflection:
    """A mode shape as horizontal displacements at the sensors, lowest first."""

    elevations: FloatArray
    """Elevations of the sensors, shape (n_levels,) [m]."""
    displacements: FloatArray
    """Displacements along x, y, z, shape (n_levels, 3) [-]."""

    def line(self, amplitude: float) -> FloatArray:
        """(n_levels, 3) the deflected axis of the tower for a largest component of 1 [m]."""
        upright = np.zeros((len(self.elevations), 3))
        upright[:, 2] = self.elevations
        return upright + amplitude * self.displacements

    def scaled(self, scale: float) -> "Deflection":
        """Return the same displacements at elevations times `scale`."""
        return Deflection(self.elevations * scale, self.displacements)

    @property
    def direction(self) -> str:
        """'FA' where more of the motion is along x than along y, else 'SS'."""
        fore_aft, side_side, _ = (self.displacements**2).sum(axis=0)
        return "FA" if fore_aft >= side_side else "SS"


def deflection(layout: SensorLayout, channels: Sequence[str], shape: FloatArray) -> Deflection:
    """Return the displacements at the sensors that a shape stands for.

    Where several sensors are at one elevation, they are the smallest displacement that explains
    all of them best: the mean of two along one axis, the sum of two across each other.

    Parameters
    ----------
    channels : Sequence[str]
        Names of the layout's channels, shape (n_channels,).
    shape : ndarray, shape (n_channels,)
        Mode shape φ [-], in the order of `channels`.
    """
    by_name = {channel.name: channel for channel in layout.channels}
    used = [by_name[name] for name in channels]
    elevations = np.unique([channel.elevation for channel in used])
    heights = np.array([channel.elevation for channel in used])
    directions = np.array([channel.direction for channel in used], dtype=np.float64)
    displacements = np.array(
        [np.linalg.pinv(directions[each]) @ shape[each] for each in heights == elevations[:, None]]
    )
    return Deflection(elevations, displacements)


def scale_onto(shape: FloatArray, target: FloatArray) -> FloatArray:
    """Scale a shape to its least-squares fit of another: s φ with s = φ·τ / φ·φ.

    Two shapes of one mode then lie on each other, whichever component each is normalised to.
    """
    return shape * (shape @ target) / (shape @ shape)


@dataclass(frozen=True, slots=True, eq=False)
class SwingFrames:
    """Frames of a moving shape: its amplitude at each instant, 1 at full amplitude."""

    times_ns: NDArray[np.int64]
    """Sensor clock, shape (n,) [ns since 1970-01-01 UTC]."""
    factors: FloatArray
    """Amplitudes cos(2π (t − t₀) / T), shape (n,) [-]."""


def swing_frames(
    start_ns: int, end_ns: int, *, full_swing_ns: int, period: float, per_swing: int = 18
) -> SwingFrames:
    """Return the frames in start_ns <= t < end_ns, counted from t₀ = full_swing_ns.

    Parameters
    ----------
    period : float
        Period T of the drawn motion, in sensor time [s].
    per_swing : int, optional
        Frames in a period; with 18 no frame has amplitude 0.
    """
    step = period * NANOSECONDS / per_swing  # [ns], not a whole number
    first, last = (int((time_ns - full_swing_ns) // step) for time_ns in (start_ns, end_ns))
    index = np.arange(first, last + 2)
    times = full_swing_ns + np.round(index * step).astype(np.int64)
    inside = (times >= start_ns) & (times < end_ns)
    return SwingFrames(times[inside], np.cos(index[inside] * (2 * np.pi / per_swing)))
