"""Tabs, views and axis ranges of a session; one blueprint for one or more turbines."""

from collections.abc import Sequence

import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import FARM, TIMELINE, turbine_path
from pipeline.viewer.narrow_blueprint import narrow_tabs
from pipeline.viewer.pictures.spectrum import measured_sides
from pipeline.viewer.view_parameters import (
    NARROW_MARGINS,
    ViewParameters,
    events_view,
    with_margins,
)
from pipeline.viewer.views import (
    accelerations_view,
    board_view,
    change_probability_view,
    damping_view,
    frequencies_view,
    frequency_changes_view,
    indicators_view,
    joint_view,
    matrix_view,
    medians_view,
    node_view,
    pile_view,
    shapes_view,
    sigma_view,
    size_views,
    spectrum_view,
    stabilisation_view,
    status_view,
    stiffness_views,
    tower_view,
    track_view,
    widths_view,
)


def session_blueprint(
    parameters: Sequence[ViewParameters],
    *,
    playback_speed: float,
    span_ns: tuple[int, int] | None = None,
    narrow: bool = False,
) -> rrb.Blueprint:
    """Return the tabs of one turbine; of several, an overview tab and one tab per turbine.

    Parameters
    ----------
    playback_speed : float
        Sensor seconds per second of playback [-].
    span_ns : tuple of int, optional
        Start and end of a session that is over [ns since 1970]; while it runs, plots grow with it.
    narrow : bool, optional
        For a narrow screen: views in tabs, not side by side.
    """
    listing = next((each.turbine for each in parameters if each.lists_nodes), None)
    top = narrow_tabs(parameters, listing) if narrow else _wide_tabs(parameters, listing)
    if span_ns is not None and span_ns[0] < span_ns[1]:
        with_margins(top, span_ns, *(NARROW_MARGINS if narrow else ()))
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


def _wide_tabs(parameters: Sequence[ViewParameters], listing: str | None) -> rrb.Tabs:
    each = [turbine_tabs(each, nodes_of=listing) for each in parameters]
    return each[0] if len(each) == 1 else rrb.Tabs(farm_tab(parameters), *each, active_tab=0)


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
        tower_view(root, parameters),
        _overview_plots(root, parameters),
        rrb.Vertical(
            indicators_view(root),
            status_view(root),
            events_view(f"{root}/events"),
            row_shares=[2, 6, 4],  # the status with a warning of three lines, in a farm, too
        ),
        column_shares=[5, 8, 6],
        name="Overview",
    )


def _overview_plots(root: str, parameters: ViewParameters) -> rrb.Vertical:
    shapes = shapes_view(root, parameters, room=13 if parameters.has_structure else 8)
    if not parameters.has_structure:
        return rrb.Vertical(frequencies_view(root, parameters), shapes, row_shares=[1, 1])
    return rrb.Vertical(*stiffness_views(root, parameters), shapes, row_shares=[6, 6, 6, 10])


def _signals(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    views = [
        accelerations_view(root, layout, side)
        for layout in parameters.layouts
        for side in measured_sides(layout)
    ]
    return rrb.Horizontal(
        rrb.Vertical(*views), spectrum_view(root), column_shares=[1, 1], name="Signals"
    )


def _modes(root: str, parameters: ViewParameters) -> rrb.Horizontal:
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


def _foundation(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    return rrb.Horizontal(
        joint_view(root, parameters),
        rrb.Vertical(pile_view(root, parameters), widths_view(root), row_shares=[5, 2]),
        rrb.Vertical(
            *stiffness_views(root, parameters),
            sigma_view(root),
            change_probability_view(root),
            *size_views(root, parameters),
        ),
        column_shares=[5, 4, 4],
        name="Foundation",
    )


def _health(root: str, *, nodes: str) -> rrb.Horizontal:
    shared = "" if nodes == root else ", nodes of the session"
    return rrb.Horizontal(
        rrb.Vertical(
            node_view(f"{nodes}/health/lost", f"Blocks lost or late [-]{shared}"),
            node_view(f"{nodes}/health/behind", f"Delay behind the newest block [s]{shared}"),
        ),
        rrb.TextDocumentView(origin=f"{root}/health/text", name="Windows, gaps, nodes"),
        name="Health",
    )


def farm_tab(parameters: Sequence[ViewParameters]) -> rrb.Horizontal:
    """Return the overview of all turbines; each turbine has a tab of its own beside it."""
    turbines = [each.turbine for each in parameters]
    return rrb.Horizontal(
        rrb.Vertical(
            board_view(len(turbines)), *[medians_view(turbines, name) for name in STIFFNESSES]
        ),
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{FARM}/table", name="Table"),
            events_view(f"{FARM}/events", "Warnings, gaps, events of all turbines, if any"),
            row_shares=[3, 2],
        ),
        column_shares=[4, 5],
        name="All turbines",
    )
