"""The tab "Overview": tower, what is known of the foundation, shapes, state and events."""

import rerun.blueprint as rrb

from pipeline.viewer.tabs.foundation import stiffness_views
from pipeline.viewer.tabs.modes import frequencies_view, shapes_view
from pipeline.viewer.tabs.narrow import alone, in_tabs
from pipeline.viewer.view_parameters import GROUND, ViewParameters, events_view, plane


def overview(root: str, parameters: ViewParameters) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
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


def narrow_overview(root: str, parameters: ViewParameters) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    return in_tabs(
        "Overview",
        rrb.Vertical(indicators_view(root), status_view(root), row_shares=[1, 4], name="State"),
        alone("Tower", tower_view(root, parameters, away=1.1)),
        alone("Events", events_view(f"{root}/events")),
    )


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


def indicators_view(root: str) -> rrb.Spatial2DView:
    """Return the turbine's state as coloured points."""
    return plane(f"{root}/indicators", "State", [-1.0, 8.0], [-0.6, 2.6])


def status_view(root: str) -> rrb.TextDocumentView:
    """Return the turbine's state as text."""
    return rrb.TextDocumentView(origin=f"{root}/status", name="Status")
