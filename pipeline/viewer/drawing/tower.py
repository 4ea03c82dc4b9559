"""Draw the turbine in space: at rest, its sensors, its moving mode shapes in a row."""

from collections.abc import Sequence

import numpy as np
import rerun as rr

from pipeline.viewer.drawing.entities import entity_part, shape_path, time_column
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.scene import (
    NACELLE_SIZE,
    Deflection,
    Outline,
    SwingFrames,
    TriangleMesh,
    disc,
)
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

AMPLITUDE = 20.0  # swing of a shape's largest component in the picture [m]
BESIDE = 75.0  # of the names of elevations from the axis: beside sea and mudline [m]
SENSOR_LABELS = (34.0, 50.0, 70.0, 90.0)  # distances of the heights' labels from the axis [m]
CLEARANCE = 12.0  # of a label's middle from a blade [m]
SPACING = 58.0  # between two shapes [m]: room for their labels
LINE = 26.0  # from one line of text below a shape to the next [m]
NAME_HEIGHT = (
    32.0  # of a mode's name above the tower's top: clear of its swing, seen from above [m]
)
ROW_DIRECTION = np.array([-1.0, 1.0, 0.0]) / np.sqrt(2.0)  # seen from (1, 1): FA and SS both show


def log_tower(recording: rr.RecordingStream, root: str, turbine: Outline) -> None:
    """Tubes, rotor-nacelle assembly, sea and mudline; static."""
    recording.log(f"{root}/tower", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    recording.log(
        f"{root}/tower/structure", _mesh(turbine.structure, (205, 205, 200, 255)), static=True
    )
    if turbine.nacelle_centre is not None:
        box = rr.Boxes3D(
            centers=[turbine.nacelle_centre],
            sizes=[NACELLE_SIZE],
            colors=[(205, 205, 200)],
            fill_mode="solid",
        )
        recording.log(f"{root}/tower/nacelle", box, static=True)
    if turbine.blades:
        recording.log(
            f"{root}/tower/blades",
            rr.LineStrips3D(turbine.blades, radii=1.6, colors=[(225, 225, 220)]),
            static=True,
        )
    seabed = disc(turbine.mudline)
    recording.log(f"{root}/tower/mudline", _mesh(seabed, (150, 115, 75, 255)), static=True)
    if turbine.water_level is not None:
        sea = disc(turbine.water_level)
        recording.log(f"{root}/tower/sea", _mesh(sea, (*colours.SKY_BLUE, 90)), static=True)
    _log_elevation_marks(recording, root, turbine)


def _mesh(mesh: TriangleMesh, colour: tuple[int, int, int, int]) -> rr.Mesh3D:
    return rr.Mesh3D(
        vertex_positions=mesh.vertices.astype(np.float32),
        triangle_indices=mesh.triangles,
        vertex_normals=mesh.normals.astype(np.float32),
        albedo_factor=colour,
    )


def _log_elevation_marks(recording: rr.RecordingStream, root: str, turbine: Outline) -> None:
    known = turbine.nacelle_centre is not None  # a turbine, not a bare mast
    names = ("mudline", "tower top") if known else ("foot", "top")
    marks = [(turbine.mudline, names[0]), (turbine.tower_top, names[1])]
    if turbine.water_level is not None:
        marks.append((turbine.water_level, "sea"))
    recording.log(
        f"{root}/tower/elevations",
        rr.Points3D(
            [(0.0, BESIDE, elevation) for elevation, _ in marks],
            radii=0.5,
            colors=colours.LABEL,
            labels=[f"{name} {elevation / turbine.scale:.4g} m" for elevation, name in marks],
            show_labels=True,
        ),
        static=True,
    )


def sensor_path(root: str, unit: str) -> str:
    """Entity of the accelerometers of one unit."""
    return f"{root}/tower/sensors/{entity_part(unit)}"


def sensor_levels(layout: SensorLayout) -> list[float]:
    """Elevations that have a sensor, lowest first [m]."""
    return sorted({channel.elevation for channel in layout.channels})


def log_sensors(
    recording: rr.RecordingStream, root: str, layout: SensorLayout, turbine: Outline
) -> None:
    """Draw the accelerometers of one unit, one dot per level; static."""
    levels, scale = sensor_levels(layout), turbine.scale
    heights = [scale * level + 6.0 for level in levels]
    aside = label_distance(heights, turbine.blades)
    recording.log(
        sensor_path(root, layout.unit),
        rr.Points3D.from_fields(
            positions=[(6.0, 3.0, scale * level) for level in levels], radii=2.8
        ),
        static=True,
    )
    recording.log(
        f"{sensor_path(root, layout.unit)}/labels",
        rr.Points3D(
            [(0.0, -aside, height) for height in heights],
            radii=0.1,
            colors=colours.LABEL,
            labels=[f"{level:g} m" for level in levels],
            show_labels=True,
        ),
        static=True,
    )


def label_distance(heights: Sequence[float], blades: Sequence[FloatArray]) -> float:
    """Return the first of SENSOR_LABELS at which no label stands before a blade [m]."""

    def is_clear(aside: float) -> bool:
        places = np.column_stack([np.full(len(heights), -aside), heights])
        return all(_distance(places, blade).min() > CLEARANCE for blade in blades)

    return next((each for each in SENSOR_LABELS if is_clear(each)), SENSOR_LABELS[0])


def _distance(places: FloatArray, line: FloatArray) -> FloatArray:
    """Return the distance of places (y, z) from a line of points (x, y, z), seen along x [m]."""
    corners = np.asarray(line)[:, 1:]
    starts, along = corners[:-1], np.diff(corners, axis=0)
    from_start = places[:, None] - starts
    share = (from_start * along).sum(axis=2) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = starts + np.clip(share, 0.0, 1.0)[:, :, None] * along
    return np.linalg.norm(places[:, None] - nearest, axis=2).min(axis=1)


def log_sensor_health(
    recording: rr.RecordingStream, root: str, layout: SensorLayout, *, faulty: frozenset[str]
) -> None:
    """Colour the levels with a faulty channel from this time on."""
    faulty_levels = {channel.elevation for channel in layout.channels if channel.name in faulty}
    shades = [
        colours.FAULT if level in faulty_levels else colours.MEASURED
        for level in sensor_levels(layout)
    ]
    recording.log(sensor_path(root, layout.unit), rr.Points3D.from_fields(colors=shades))


def log_shape_place(
    recording: rr.RecordingStream,
    root: str,
    label: str,
    slot: int,
    turbine: Outline,
    *,
    colour: colours.Colour = colours.MODEL,
) -> None:
    """Place a mode's shape in the row, with the tower at rest; static."""
    path = shape_path(root, label)
    offset = ROW_DIRECTION * SPACING * slot
    axis = [(0.0, 0.0, turbine.mudline), (0.0, 0.0, turbine.tower_top)]
    recording.log(path, rr.Transform3D(translation=offset), static=True)
    recording.log(f"{path}/name", _caption([turbine.tower_top + NAME_HEIGHT], [label]), static=True)
    recording.log(
        f"{path}/rest", rr.LineStrips3D([axis], radii=0.4, colors=colours.NEUTRAL), static=True
    )
    # Static parts are written once: they cost as much as moving ones.
    line = rr.LineStrips3D.from_fields(radii=1.0, colors=colour)
    recording.log(f"{path}/motion/model", line, static=True)
    dots = rr.Points3D.from_fields(radii=3.2, colors=colours.MEASURED)
    recording.log(f"{path}/motion/identified", dots, static=True)
    caption = rr.Points3D.from_fields(radii=0.1, colors=colours.LABEL, show_labels=True)
    recording.log(f"{path}/caption", caption, static=True)


def log_model_shape(
    recording: rr.RecordingStream, root: str, label: str, shape: Deflection | None
) -> None:
    """The updated model's shape of one mode as a line, at full swing; None: no line."""
    strips = np.empty((0, 2, 3)) if shape is None else shape.line(AMPLITUDE)[None]
    line = rr.LineStrips3D.from_fields(strips=strips.astype(np.float32))
    recording.log(f"{shape_path(root, label)}/motion/model", line)


def log_identified_shape(
    recording: rr.RecordingStream, root: str, label: str, shape: Deflection | None
) -> None:
    """The identified shape as dots at the sensors, at full swing; none where it was not found."""
    line = np.empty((0, 3)) if shape is None else shape.line(AMPLITUDE)
    dots = rr.Points3D.from_fields(positions=line)
    recording.log(f"{shape_path(root, label)}/motion/identified", dots)


def log_shape_caption(
    recording: rr.RecordingStream, root: str, label: str, lines: Sequence[str], *, foot: float
) -> None:
    """Write lines of text below a shape, downwards from elevation `foot` [m]."""
    heights = [foot - LINE * line for line in range(len(lines))]
    below = rr.Points3D.from_fields(positions=_on_axis(heights), labels=lines)
    recording.log(f"{shape_path(root, label)}/caption", below)


def _caption(heights: Sequence[float], lines: Sequence[str]) -> rr.Points3D:
    """Return texts above each other on the axis of a shape; a label has one line only."""
    return rr.Points3D(
        _on_axis(heights),
        radii=0.1,
        colors=colours.LABEL,
        labels=lines,
        show_labels=True,
    )


def _on_axis(heights: Sequence[float]) -> list[tuple[float, float, float]]:
    return [(0.0, 0.0, height) for height in heights]


def log_swing(recording: rr.RecordingStream, root: str, label: str, frames: SwingFrames) -> None:
    """Draw the motion of one shape: one scale factor per frame, across the tower.

    The shape itself is written once; scaling x and y by cos(2π t / T) moves it.
    """
    scales = np.ones((len(frames.times_ns), 3))
    scales[:, :2] = frames.factors[:, None]
    if len(frames.times_ns):
        recording.send_columns(
            f"{shape_path(root, label)}/motion",
            [time_column(frames.times_ns)],
            rr.Transform3D.columns(scale=scales),
        )
