"""Views of one turbine and of all: what each draws, its title, its axes or its camera."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import (
    FARM,
    median_path,
    mode_path,
    parameter_path,
    shape_path,
    signal_path,
)
from pipeline.viewer.drawing.tower import SPACING
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.farm_overview import board_bounds
from pipeline.viewer.pictures.mac_matrix import SIDE
from pipeline.viewer.view_parameters import GROUND, ViewParameters, plane, time_series
from sensors.acquisition.layout import SensorLayout

NEARBY = 208.0  # of the camera from a row of shapes, along x and along y [m]


def joint_view(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    """Return the corner plot of the stiffnesses."""
    return plane(
        f"{root}/foundation/joint",
        f"Joint posterior of stiffness ÷ nominal [-]; prior orange{parameters.truth}",
        [-0.4, 4.15],
        [-0.5, 4.25],
    )


def pile_view(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    """Return the tower on its springs."""
    return plane(
        f"{root}/foundation/pile",
        f"Under 1 MN: nominal orange, posterior purple{parameters.truth}",
        [-1.35, 1.35],
        [-2.25, 1.25],
    )


def widths_view(root: str) -> rrb.TimeSeriesView:
    """Return what is left of each parameter's prior width."""
    return time_series(
        f"{root}/posterior_width", "Posterior width ÷ prior width [%], 90 % intervals", "LeftTop"
    )


def sigma_view(root: str) -> rrb.TimeSeriesView:
    """Return the band of the model's discrepancy."""
    return time_series(
        parameter_path(root, "sigma"), "Model discrepancy σ [-]: 5, 50, 95 % quantiles"
    )


def change_probability_view(root: str) -> rrb.TimeSeriesView:
    """Return the probability of a change, over time."""
    return time_series(
        f"{root}/change",
        "Probability of a new change [-]; red: detected",
        contents=["$origin/probability", "$origin/noticed"],
        axis_y=rrb.ScalarAxis(range=(-0.1, 1.1)),  # 0 and 1 are most of what is seen
    )


def size_views(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return the plot that appears with the first change of known size."""
    text = "Change of stiffness [%], 5, 50, 95 %: k11 blue, k22 orange, k12 green"
    return [time_series(f"{root}/change/size", text)] * parameters.sized  # a legend would hide it


def node_view(path: str, name: str) -> rrb.TimeSeriesView:
    """Return a plot with one line per node."""
    return time_series(path, name, "LeftTop")


def spectrum_view(root: str) -> rrb.Spatial2DView:
    """Return the spectra of the last window."""
    return plane(
        f"{root}/spectrum",
        "Spectra of the last window, colours as on the left; lines: identified frequencies [Hz]",
        [-0.3, 2.75],
        [-0.2, 2.7],
    )


def stabilisation_view(root: str) -> rrb.Spatial2DView:
    """Return the stabilisation diagram of the last window."""
    return plane(
        f"{root}/stabilisation",
        "Poles of the last window ± std, one colour per band; lines: identified modes",
        [-0.34, 2.75],
        [-0.15, 1.67],
    )


def matrix_view(root: str) -> rrb.Spatial2DView:
    """Return the MAC matrix of the last window."""
    return plane(
        f"{root}/mac",
        "MAC of identified and model modes (dark 0, bright 1)",
        [-60, SIDE + 10],
        [-35, SIDE + 50],
    )


def indicators_view(root: str) -> rrb.Spatial2DView:
    """Return the turbine's state as coloured points."""
    return plane(f"{root}/indicators", "State", [-1.0, 8.0], [-0.6, 2.6])


def tower_view(root: str, parameters: ViewParameters, *, away: float = 1.0) -> rrb.Spatial3DView:
    """Return the tower with its sensors, seen from `away` times the usual distance."""
    return rrb.Spatial3DView(
        origin=f"{root}/tower",
        name="Tower, sensors, sea and mudline [m]"
        if parameters.has_structure
        else "Sensors by height [m]",
        line_grid=False,
        background=GROUND,
        eye_controls=rrb.EyeControls3D(
            position=[360.0 * away, 270.0 * away, parameters.mid_height + 25.0 + 35.0 * away],
            look_target=[0.0, 0.0, parameters.mid_height + 25.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


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


def stiffness_views(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return a plot of each stiffness."""
    return [
        time_series(
            parameter_path(root, name),
            f"{name} ÷ nominal [-]: 5, 50, 95 % quantiles{parameters.truth}",
        )
        for name in STIFFNESSES
    ]


def accelerations_view(root: str, layout: SensorLayout, side: int) -> rrb.TimeSeriesView:
    """Return the accelerations of one unit along one axis."""
    path = signal_path(root, layout.unit)
    name = ("fore-aft (x)", "side-side (y)")[side]
    along = [abs(channel.direction[side]) > 0.7 for channel in layout.channels]
    quantity, unit = _quantity(layout)
    title = f"{quantity} {name} of unit {layout.unit} [{unit}]"
    shown = {path: rr.SeriesLines(visible_series=along)}
    return time_series(path, title, "LeftTop", overrides=shown)


def _quantity(layout: SensorLayout) -> tuple[str, str]:
    """Return the quantity and unit of a layout's channels."""
    units = {channel.unit for channel in layout.channels}
    if units == {"m/s²"}:
        return "Acceleration", "m/s²"
    return "Signal", ", ".join(sorted(units - {""})) or "unscaled"


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


def status_view(root: str) -> rrb.TextDocumentView:
    """Return the turbine's state as text."""
    return rrb.TextDocumentView(origin=f"{root}/status", name="Status")


def board_view(n_turbines: int) -> rrb.Spatial2DView:
    """Return the state of all turbines as coloured points."""
    text = "State: green good, orange warning, red bad, grey unknown"
    return plane(f"{FARM}/indicators", text, *board_bounds(n_turbines))


def medians_view(turbines: Sequence[str], name: str) -> rrb.TimeSeriesView:
    """Return a plot of one stiffness of every turbine, its median."""
    in_colour = {
        median_path(name, turbine): _in_colour(number) for number, turbine in enumerate(turbines)
    }
    text = f"{name} ÷ nominal [-], median, one colour per turbine"
    return time_series(f"{FARM}/{name}", text, "LeftTop", overrides=in_colour)


def _in_colour(number: int) -> list[rr.SeriesLines | rr.SeriesPoints]:
    palette = [colours.LEVELS[number % len(colours.LEVELS)]]
    return [rr.SeriesLines(colors=palette), rr.SeriesPoints(colors=palette)]
