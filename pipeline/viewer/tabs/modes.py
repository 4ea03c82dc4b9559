"""The tab "Modes": poles, natural frequencies, damping ratios, shapes and their MAC."""

import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import mode_path, shape_path
from pipeline.viewer.drawing.tower import SPACING
from pipeline.viewer.pictures.mac_matrix import SIDE
from pipeline.viewer.tabs.narrow import alone, in_tabs, titled
from pipeline.viewer.view_parameters import GROUND, ViewParameters, plane, time_series

NEARBY = 208.0  # of the camera from a row of shapes, along x and along y [m]
SHAPES_IN_ROW = 4  # on a narrow screen, so that their labels do not meet


def modes(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
    return rrb.Horizontal(
        rrb.Vertical(
            stabilisation_view(root),
            frequency_changes_view(root),
            damping_view(root, parameters),
            row_shares=[4, 3, 3],
        ),
        rrb.Vertical(
            _tracks(root, parameters),
            shapes_view(root, parameters, room=16),
            row_shares=[5, 3],
        ),
        column_shares=[2, 3],
        name="Modes",
    )


def _tracks(root: str, parameters: ViewParameters) -> rrb.Tabs | rrb.Grid:
    """Return a grid of the modes' tracks, in tabs with the MAC matrix where there is a model."""
    model = ", model (orange)" * parameters.has_structure
    grid = rrb.Grid(
        *[track_view(root, label) for label in parameters.modes],
        grid_columns=4,
        name=f"Natural frequencies: identified ± 2 std (blue){model}",
    )
    return rrb.Tabs(grid, matrix_view(root)) if parameters.has_structure else grid


def narrow_modes(root: str, parameters: ViewParameters) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    numbers = range(len(parameters.modes))
    shapes = (
        "Model line, identified dots (≈ mean, – none); f [Hz], MAC"
        if parameters.has_structure
        else "Shapes at the sensors, last window (–: none); f [Hz]"
    )
    frequencies = "f [Hz]: blue fore-aft, purple side-side"
    frequencies += ", orange model" * parameters.has_structure
    rows = [
        titled(shapes_view(root, parameters, slots=numbers[first : first + SHAPES_IN_ROW]), shapes)
        for first in numbers[::SHAPES_IN_ROW]
    ]
    tracks = [track_view(root, label) for label in parameters.modes]
    changes = [frequency_changes_view(root), damping_view(root, parameters)]
    matrix = [alone("MAC", matrix_view(root))] if parameters.has_structure else []
    return in_tabs(
        "Modes",
        rrb.Vertical(*rows, name="Shapes"),
        rrb.Grid(*tracks, grid_columns=2, name="Tracks"),
        rrb.Vertical(
            titled(frequencies_view(root, parameters), frequencies), *changes, name="All modes"
        ),
        alone(
            "Poles",
            stabilisation_view(root),
            "Poles ± std, one colour per band; upright lines: modes",
        ),
        *matrix,
    )


def stabilisation_view(root: str) -> rrb.Spatial2DView:
    """Return the stabilisation diagram of the last window."""
    return plane(
        f"{root}/stabilisation",
        "Poles of the last window ± std, one colour per band; lines: identified modes",
        [-0.34, 2.75],
        [-0.15, 1.67],
    )


def track_view(root: str, label: str) -> rrb.TimeSeriesView:
    """Return the natural frequency of one mode, over time."""
    path = mode_path(root, label)
    both = [f"{path}/identified", f"{path}/model"]
    return time_series(path, f"{label}: f ± 2 std [Hz]", contents=both)


def frequencies_view(root: str, parameters: ViewParameters) -> rrb.TimeSeriesView:
    """Return the natural frequencies of all modes in one plot."""
    model = [
        f"{mode_path(root, label)}/model" for label in parameters.modes if parameters.has_structure
    ]
    text = "Natural frequencies [Hz]: blue fore-aft, purple side-side"
    text += ", orange model" * parameters.has_structure
    return time_series(root, text, contents=[f"{root}/frequencies/identified/**", *model])


def frequency_changes_view(root: str) -> rrb.TimeSeriesView:
    """Return how the natural frequencies change."""
    return time_series(
        f"{root}/frequencies/change",
        "Change of natural frequencies since the first window [%]",
        "LeftTop",
    )


def damping_view(root: str, parameters: ViewParameters) -> rrb.TimeSeriesView:
    """Return the damping ratios of all modes."""
    paths = [f"{mode_path(root, label)}/damping" for label in parameters.modes]
    text = "Damping ratios [% of critical], one line per mode"
    return time_series(f"{root}/modes", text, "LeftTop", contents=paths)


def shapes_view(
    root: str,
    parameters: ViewParameters,
    *,
    room: int = 0,
    slots: range | None = None,
) -> rrb.Spatial3DView:
    """Return the row of shapes, or a part of it, from so far away that all of them are seen.

    Parameters
    ----------
    room : int
        Number of shapes that are seen from nearby; more need a camera farther away.
    slots : range, optional
        Shapes of the part, which is seen from NEARBY; None: all.
    """
    shown = range(len(parameters.modes)) if slots is None else slots
    middle = (shown.start + shown.stop - 1) / 2 * SPACING / 2**0.5
    away = NEARBY * max(1.0, len(shown) / room if room else 1.0)
    labels = [parameters.modes[slot] for slot in shown]
    return rrb.Spatial3DView(
        origin=f"{root}/shapes",
        contents=[f"{shape_path(root, label)}/**" for label in labels],
        name="Mode shapes: model line, identified dots (≈: mean of two, –: none); f [Hz], MAC"
        if parameters.has_structure
        else "Mode shapes at the sensors, last window (–: none); direction, f [Hz]",
        line_grid=False,
        background=GROUND,
        eye_controls=rrb.EyeControls3D(
            position=[-middle + away, middle + away, parameters.mid_height],
            look_target=[-middle, middle, parameters.mid_height - 22.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def matrix_view(root: str) -> rrb.Spatial2DView:
    """Return the MAC matrix of the last window."""
    return plane(
        f"{root}/mac",
        "MAC of identified and model modes (dark 0, bright 1)",
        [-60, SIDE + 10],
        [-35, SIDE + 50],
    )
