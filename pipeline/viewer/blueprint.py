"""Tabs, views and axis ranges of a session; one blueprint for one or more turbines."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import (
    FARM,
    TIMELINE,
    median_path,
    mode_path,
    parameter_path,
    signal_path,
    turbine_path,
)
from pipeline.viewer.drawing.tower import SPACING
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.farm_overview import board_bounds
from pipeline.viewer.pictures.mac_matrix import SIDE
from pipeline.viewer.pictures.spectrum import measured_sides
from pipeline.viewer.view_parameters import (
    GROUND,
    ViewParameters,
    events_view,
    plane,
    time_series,
    with_margins,
)
from sensors.acquisition.layout import SensorLayout


def session_blueprint(
    parameters: Sequence[ViewParameters],
    *,
    playback_speed: float,
    span_ns: tuple[int, int] | None = None,
) -> rrb.Blueprint:
    """Return the tabs of one turbine; of several, an overview tab and one tab per turbine.

    Parameters
    ----------
    playback_speed : float
        Sensor seconds per second of playback [-].
    span_ns : tuple of int, optional
        Start and end of a session that is over [ns since 1970]; while it runs, plots grow with it.
    """
    listing = next((each.turbine for each in parameters if each.lists_nodes), None)
    each = [turbine_tabs(each, nodes_of=listing) for each in parameters]
    top = each[0] if len(each) == 1 else rrb.Tabs(farm_tab(parameters), *each, active_tab=0)
    if span_ns is not None and span_ns[0] < span_ns[1]:
        with_margins(top, span_ns)
    return rrb.Blueprint(
        top,
        rrb.TimePanel(
            state="collapsed",
            timeline=TIMELINE,
            play_state="following",  # opens at the end, where everything is; a loop_mode ends that
            playback_speed=playback_speed,
        ),
        rrb.BlueprintPanel(state="collapsed"),
        rrb.SelectionPanel(state="collapsed"),
        auto_views=False,
        auto_layout=False,
    )


def turbine_tabs(parameters: ViewParameters, *, nodes_of: str | None = None) -> rrb.Tabs:
    """Return Overview, Signals, Modes, Foundation and Health of one turbine.

    Parameters
    ----------
    nodes_of : str, optional
        Turbine under whose name the session's nodes report, for one that lists none.
    """
    own = parameters.lists_nodes or nodes_of is None
    root = turbine_path(parameters.turbine)
    foundation = [_foundation(root, parameters)] if parameters.has_structure else []
    return rrb.Tabs(
        _overview(root, parameters),
        _signals(root, parameters),
        _modes(root, parameters),
        *foundation,
        _health(root, nodes=root if own else turbine_path(str(nodes_of))),
        active_tab=0,
        name=parameters.turbine,
    )


def _overview(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    return rrb.Horizontal(
        _tower(root, parameters),
        _overview_plots(root, parameters),
        rrb.Vertical(
            _indicators(root), _status(root), events_view(f"{root}/events"), row_shares=[2, 5, 4]
        ),
        column_shares=[5, 8, 6],
        name="Overview",
    )


def _overview_plots(root: str, parameters: ViewParameters) -> rrb.Vertical:
    shapes = _shapes(root, parameters, room=13 if parameters.has_structure else 8)
    if not parameters.has_structure:
        return rrb.Vertical(_frequencies(root, parameters), shapes, row_shares=[1, 1])
    return rrb.Vertical(*_stiffness_bands(root, parameters), shapes, row_shares=[7, 7, 7, 10])


def _signals(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    views = [
        _accelerations(root, layout, side)
        for layout in parameters.layouts
        for side in measured_sides(layout)
    ]
    return rrb.Horizontal(
        rrb.Vertical(*views), _spectrum(root), column_shares=[1, 1], name="Signals"
    )


def _modes(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    return rrb.Horizontal(
        rrb.Vertical(
            _stabilisation(root),
            _frequency_changes(root),
            _damping(root, parameters),
            row_shares=[4, 3, 3],
        ),
        rrb.Vertical(
            _tracks(root, parameters),
            _shapes(root, parameters, room=16),
            row_shares=[5, 3],
        ),
        column_shares=[2, 3],
        name="Modes",
    )


def _tracks(root: str, parameters: ViewParameters) -> rrb.Tabs | rrb.Grid:
    """Return a grid of the modes' tracks, in tabs with the MAC matrix where there is a model."""
    model = ", model (orange)" * parameters.has_structure
    grid = rrb.Grid(
        *[_track(root, label) for label in parameters.modes],
        grid_columns=4,
        name=f"Natural frequencies: identified ± 2 std (blue){model}",
    )
    return rrb.Tabs(grid, _matrix(root)) if parameters.has_structure else grid


def _foundation(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    return rrb.Horizontal(
        _joint(root, parameters),
        rrb.Vertical(_pile(root, parameters), _posterior_widths(root), row_shares=[5, 2]),
        rrb.Vertical(
            *_stiffness_bands(root, parameters),
            _sigma(root),
            _change_probability(root),
            *_sizes(root, parameters),
        ),
        column_shares=[5, 4, 4],
        name="Foundation",
    )


def _joint(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    return plane(
        f"{root}/foundation/joint",
        f"Joint posterior of stiffness ÷ nominal [-]; prior orange{parameters.truth}",
        [-0.45, 3.8],
        [-0.25, 3.95],
    )


def _pile(root: str, parameters: ViewParameters) -> rrb.Spatial2DView:
    return plane(
        f"{root}/foundation/pile",
        f"Under 1 MN: nominal orange, posterior purple{parameters.truth}",
        [-1.35, 1.35],
        [-2.25, 1.25],
    )


def _posterior_widths(root: str) -> rrb.TimeSeriesView:
    return time_series(
        f"{root}/posterior_width", "Posterior width ÷ prior width [%], 90 % intervals", "LeftTop"
    )


def _sigma(root: str) -> rrb.TimeSeriesView:
    return time_series(
        parameter_path(root, "sigma"), "Model discrepancy σ [-]: 5, 50, 95 % quantiles"
    )


def _change_probability(root: str) -> rrb.TimeSeriesView:
    return time_series(
        f"{root}/change",
        "Probability of a new change [-]; red: detected",
        contents=["$origin/probability", "$origin/noticed"],
        axis_y=rrb.ScalarAxis(range=(-0.1, 1.1)),  # 0 and 1 are most of what is seen
    )


def _sizes(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    """Return the plot that appears with the first change of known size."""
    text = "Change of stiffness [%], 5, 50, 95 %: k11 blue, k22 orange, k12 green"
    return [time_series(f"{root}/change/size", text)] * parameters.sized  # a legend would hide it


def _health(root: str, *, nodes: str) -> rrb.Horizontal:
    shared = "" if nodes == root else ", nodes of the session"
    return rrb.Horizontal(
        rrb.Vertical(
            _node_plot(f"{nodes}/health/lost", f"Blocks lost or late [-]{shared}"),
            _node_plot(f"{nodes}/health/behind", f"Delay behind the newest block [s]{shared}"),
        ),
        rrb.TextDocumentView(origin=f"{root}/health/text", name="Windows, gaps, nodes"),
        name="Health",
    )


def _node_plot(path: str, name: str) -> rrb.TimeSeriesView:
    return time_series(path, name, "LeftTop")


def _spectrum(root: str) -> rrb.Spatial2DView:
    return plane(
        f"{root}/spectrum",
        "Spectra of the last window, colours as on the left; lines: identified frequencies [Hz]",
        [-0.3, 2.75],
        [-0.2, 2.5],
    )


def _stabilisation(root: str) -> rrb.Spatial2DView:
    return plane(
        f"{root}/stabilisation",
        "Poles of the last window ± std, one colour per band; lines: identified modes",
        [-0.25, 2.75],
        [-0.15, 1.55],
    )


def _matrix(root: str) -> rrb.Spatial2DView:
    return plane(
        f"{root}/mac",
        "MAC of identified and model modes (dark 0, bright 1)",
        [-60, SIDE + 10],
        [-35, SIDE + 50],
    )


def _indicators(root: str) -> rrb.Spatial2DView:
    return plane(f"{root}/indicators", "State", [-1.0, 8.0], [-0.6, 2.6])


def _tower(root: str, parameters: ViewParameters) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=f"{root}/tower",
        name="Tower, sensors, sea and mudline [m]"
        if parameters.has_structure
        else "Sensors by height [m]",
        line_grid=False,
        background=GROUND,
        eye_controls=rrb.EyeControls3D(
            position=[360.0, 270.0, parameters.mid_height + 60.0],
            look_target=[0.0, 0.0, parameters.mid_height + 25.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def _shapes(root: str, parameters: ViewParameters, *, room: int) -> rrb.Spatial3DView:
    """Return the row of shapes, from so far away that all are seen; `room` are from nearby."""
    middle = (len(parameters.modes) - 1) / 2 * SPACING / 2**0.5
    away = 208.0 * max(1.0, len(parameters.modes) / room)
    return rrb.Spatial3DView(
        origin=f"{root}/shapes",
        name="Mode shapes: model line, identified dots (≈: mean of two, –: none); f [Hz], MAC"
        if parameters.has_structure
        else "Mode shapes at the sensors, as identified; direction, f [Hz]",
        line_grid=False,
        background=GROUND,
        eye_controls=rrb.EyeControls3D(
            position=[-middle + away, middle + away, parameters.mid_height],
            look_target=[-middle, middle, parameters.mid_height - 10.0],
            eye_up=[0.0, 0.0, 1.0],
        ),
    )


def _stiffness_bands(root: str, parameters: ViewParameters) -> list[rrb.TimeSeriesView]:
    return [
        time_series(
            parameter_path(root, name),
            f"{name} ÷ nominal [-]: 5, 50, 95 % quantiles{parameters.truth}",
        )
        for name in STIFFNESSES
    ]


def _accelerations(root: str, layout: SensorLayout, side: int) -> rrb.TimeSeriesView:
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


def _track(root: str, label: str) -> rrb.TimeSeriesView:
    path = mode_path(root, label)
    both = [f"{path}/identified", f"{path}/model"]
    return time_series(path, f"Mode {label} [Hz]", contents=both)


def _frequencies(root: str, parameters: ViewParameters) -> rrb.TimeSeriesView:
    model = [
        f"{mode_path(root, label)}/model" for label in parameters.modes if parameters.has_structure
    ]
    text = "Natural frequencies [Hz]: blue fore-aft, purple side-side"
    text += ", orange model" * parameters.has_structure
    return time_series(root, text, contents=[f"{root}/frequencies/identified/**", *model])


def _frequency_changes(root: str) -> rrb.TimeSeriesView:
    return time_series(
        f"{root}/frequencies/change",
        "Change of natural frequencies since their first window [%]",
        "LeftTop",
    )


def _damping(root: str, parameters: ViewParameters) -> rrb.TimeSeriesView:
    paths = [f"{mode_path(root, label)}/damping" for label in parameters.modes]
    text = "Damping ratios [% of critical], one line per mode"
    return time_series(f"{root}/modes", text, "LeftTop", contents=paths)


def _status(root: str) -> rrb.TextDocumentView:
    return rrb.TextDocumentView(origin=f"{root}/status", name="Status")


def farm_tab(parameters: Sequence[ViewParameters]) -> rrb.Horizontal:
    """Return the overview of all turbines; each turbine has a tab of its own beside it."""
    turbines = [each.turbine for each in parameters]
    return rrb.Horizontal(
        rrb.Vertical(_board(len(turbines)), *[_medians(turbines, name) for name in STIFFNESSES]),
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{FARM}/table", name="Table"),
            events_view(f"{FARM}/events", "Warnings, gaps, events of all turbines, if any"),
            row_shares=[3, 2],
        ),
        column_shares=[4, 5],
        name="All turbines",
    )


def _board(n_turbines: int) -> rrb.Spatial2DView:
    text = "State: green good, orange warning, red bad, grey unknown"
    return plane(f"{FARM}/indicators", text, *board_bounds(n_turbines))


def _medians(turbines: Sequence[str], name: str) -> rrb.TimeSeriesView:
    """Return a plot of one stiffness of every turbine, its median."""
    in_colour = {
        median_path(name, turbine): _in_colour(number) for number, turbine in enumerate(turbines)
    }
    text = f"{name} ÷ nominal [-], posterior median, one colour per turbine"
    return time_series(f"{FARM}/{name}", text, "LeftTop", overrides=in_colour)


def _in_colour(number: int) -> list[rr.SeriesLines | rr.SeriesPoints]:
    palette = [colours.LEVELS[number % len(colours.LEVELS)]]
    return [rr.SeriesLines(colors=palette), rr.SeriesPoints(colors=palette)]
