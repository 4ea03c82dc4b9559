"""The tab of all turbines: state, medians, table and events; each has tabs of its own beside it."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from pipeline.state.posterior_json import STIFFNESSES
from pipeline.viewer.drawing.entities import FARM, median_path
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.farm_overview import board_bounds
from pipeline.viewer.tabs.narrow import alone, in_tabs
from pipeline.viewer.view_parameters import ViewParameters, events_view, plane, time_series


def farm(parameters: Sequence[ViewParameters]) -> rrb.Horizontal:
    """Return the tab for a wide screen."""
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


def narrow_farm(parameters: Sequence[ViewParameters]) -> rrb.Tabs:
    """Return the tab for a narrow screen."""
    turbines = [each.turbine for each in parameters]
    return in_tabs(
        "All turbines",
        alone("State", board_view(len(turbines))),
        alone("Table", rrb.TextDocumentView(origin=f"{FARM}/table", name="Table")),
        rrb.Vertical(*[medians_view(turbines, name) for name in STIFFNESSES], name="Medians"),
        alone("Events", events_view(f"{FARM}/events", "Warnings, gaps, events, if any")),
    )


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
