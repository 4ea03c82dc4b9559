"""Tabs of a session on a narrow screen: what stands side by side on a wide one is in tabs.

Laid out for a window as wide as `outputs/web/page.js` makes it, NARROW_AS.
"""

from collections.abc import Sequence
from typing import Any, TypeVar

import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import FARM, turbine_path
from pipeline.viewer.pictures.spectrum import measured_sides
from pipeline.viewer.view_parameters import ViewParameters, events_view
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

_View = TypeVar("_View", bound=rrb.View)
NARROW_NAME = "narrow screen"  # of the layout, by which the page knows it
LONGEST_TITLE = 57  # beside a view's buttons [characters]
SHAPES_IN_ROW = 4  # whose labels do not meet


def narrow_tabs(parameters: Sequence[ViewParameters], nodes_of: str | None) -> rrb.Tabs:
    """Return the tabs of one turbine; of several, a tab of all and one per turbine.

    Parameters
    ----------
    nodes_of : str, optional
        Turbine under whose name the session's nodes report.
    """
    each = [_turbine_tabs(one, nodes_of or one.turbine) for one in parameters]
    if len(each) == 1:
        return _tabs(NARROW_NAME, *each[0])
    named = [_tabs(one.turbine, *tabs) for one, tabs in zip(parameters, each, strict=True)]
    return _tabs(NARROW_NAME, _farm(parameters), *named)


def _turbine_tabs(parameters: ViewParameters, nodes_of: str) -> list[rrb.Container]:
    root = turbine_path(parameters.turbine)
    nodes = root if parameters.lists_nodes else turbine_path(nodes_of)
    foundation = [_foundation(root, parameters)] if parameters.has_structure else []
    return [
        _overview(root, parameters),
        _signals(root, parameters),
        _modes(root, parameters),
        *foundation,
        _health(root, nodes),
    ]


def _tabs(name: str, *parts: Any) -> rrb.Tabs:
    return rrb.Tabs(*parts, active_tab=0, name=name)


def _alone(name: str, view: rrb.View, title: str = "") -> rrb.Vertical:
    """Return a view in a tab with a short name, its own title below it."""
    return rrb.Vertical(_titled(view, title) if title else view, name=name)


def _titled(view: _View, title: str) -> _View:
    """Give a view a title of at most LONGEST_TITLE characters; more are cut."""
    view.name = title
    return view


def _overview(root: str, parameters: ViewParameters) -> rrb.Tabs:
    return _tabs(
        "Overview",
        rrb.Vertical(indicators_view(root), status_view(root), row_shares=[1, 4], name="State"),
        _alone("Tower", tower_view(root, parameters, away=1.1)),
        _alone("Events", events_view(f"{root}/events")),
    )


def _signals(root: str, parameters: ViewParameters) -> rrb.Tabs:
    series = [
        accelerations_view(root, layout, side)
        for layout in parameters.layouts
        for side in measured_sides(layout)
    ]
    return _tabs(
        "Signals",
        rrb.Vertical(*series, name="Series"),
        _alone(
            "Spectra",
            spectrum_view(root),
            "Last window, colours as in Series; upright lines: modes",
        ),
    )


def _modes(root: str, parameters: ViewParameters) -> rrb.Tabs:
    numbers = range(len(parameters.modes))
    shapes = (
        "Model line, identified dots (≈ mean, – none); f [Hz], MAC"
        if parameters.has_structure
        else "Shapes at the sensors, last window (–: none); f [Hz]"
    )
    frequencies = "f [Hz]: blue fore-aft, purple side-side"
    frequencies += ", orange model" * parameters.has_structure
    rows = [
        _titled(shapes_view(root, parameters, slots=numbers[first : first + SHAPES_IN_ROW]), shapes)
        for first in numbers[::SHAPES_IN_ROW]
    ]
    tracks = [track_view(root, label) for label in parameters.modes]
    changes = [frequency_changes_view(root), damping_view(root, parameters)]
    matrix = [_alone("MAC", matrix_view(root))] if parameters.has_structure else []
    return _tabs(
        "Modes",
        rrb.Vertical(*rows, name="Shapes"),
        rrb.Grid(*tracks, grid_columns=2, name="Tracks"),
        rrb.Vertical(
            _titled(frequencies_view(root, parameters), frequencies), *changes, name="All modes"
        ),
        _alone(
            "Poles",
            stabilisation_view(root),
            "Poles ± std, one colour per band; upright lines: modes",
        ),
        *matrix,
    )


def _foundation(root: str, parameters: ViewParameters) -> rrb.Tabs:
    sizes = "Change [%]: k11 blue, k22 orange, k12 green"
    return _tabs(
        "Foundation",
        rrb.Vertical(*stiffness_views(root, parameters), widths_view(root), name="Stiffness"),
        _alone(
            "Joint",
            joint_view(root, parameters),
            f"Stiffness ÷ nominal [-]; prior orange{parameters.truth}",
        ),
        _alone("Springs", pile_view(root, parameters)),
        rrb.Vertical(
            sigma_view(root),
            change_probability_view(root),
            *[_titled(size, sizes) for size in size_views(root, parameters)],
            name="Changes",
        ),
    )


def _health(root: str, nodes: str) -> rrb.Tabs:
    shared = "" if nodes == root else ", nodes of the session"
    return _tabs(
        "Health",
        _alone(
            "State",
            rrb.TextDocumentView(origin=f"{root}/health/text", name="Windows, gaps, nodes"),
        ),
        rrb.Vertical(
            node_view(f"{nodes}/health/lost", f"Blocks lost or late [-]{shared}"),
            node_view(f"{nodes}/health/behind", f"Delay behind the newest block [s]{shared}"),
            name="Loss and delay",
        ),
    )


def _farm(parameters: Sequence[ViewParameters]) -> rrb.Tabs:
    turbines = [each.turbine for each in parameters]
    return _tabs(
        "All turbines",
        _alone("State", board_view(len(turbines))),
        _alone("Table", rrb.TextDocumentView(origin=f"{FARM}/table", name="Table")),
        rrb.Vertical(*[medians_view(turbines, name) for name in STIFFNESSES], name="Medians"),
        _alone("Events", events_view(f"{FARM}/events", "Warnings, gaps, events, if any")),
    )
