"""The tab of all turbines: status indicators, stiffnesses over time, table, events."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import FARM, median_path
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.farm_overview import board_bounds
from pipeline.viewer.pictures.status_text import STIFFNESSES
from pipeline.viewer.view_parameters import ViewParameters, events_view, plane, time_series


def farm_tab(parameters: Sequence[ViewParameters]) -> rrb.Horizontal:
    """Return the overview of all turbines; each turbine has a tab of its own beside it."""
    turbines = [each.turbine for each in parameters]
    return rrb.Horizontal(
        rrb.Vertical(_board(len(turbines)), *[_medians(turbines, name) for name in STIFFNESSES]),
        rrb.Vertical(
            rrb.TextDocumentView(origin=f"{FARM}/table", name="Table"),
            events_view(f"{FARM}/events", "Warnings"),
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
