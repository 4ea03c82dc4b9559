"""The tab of all turbines: lamps, stiffnesses over time, the table, what happened."""

from collections.abc import Sequence

import rerun as rr
import rerun.blueprint as rrb

from pipeline.viewer.drawing.entities import FARM, median_path
from pipeline.viewer.panel import TurbinePanel, events_view, whole_session
from pipeline.viewer.pictures import colours
from pipeline.viewer.pictures.farm_overview import board_bounds
from pipeline.viewer.pictures.status_text import STIFFNESSES


def farm_tab(panels: Sequence[TurbinePanel]) -> rrb.Horizontal:
    """An overview of all turbines; a click on a turbine's own tab leads to the rest."""
    turbines = [panel.turbine for panel in panels]
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
    x_range, y_range = board_bounds(n_turbines)
    return rrb.Spatial2DView(
        origin=f"{FARM}/lamps",
        name="How things are: green good, orange doubtful, red bad, grey unknown",
        visual_bounds=rrb.VisualBounds2D(x_range=x_range, y_range=y_range),
    )


def _medians(turbines: Sequence[str], name: str) -> rrb.TimeSeriesView:
    """One stiffness of every turbine, its median."""
    return rrb.TimeSeriesView(
        origin=f"{FARM}/{name}",
        name=f"{name} ÷ nominal [-], median of the posterior, a colour a turbine",
        overrides={
            median_path(name, turbine): _in_colour(number)
            for number, turbine in enumerate(turbines)
        },
        **whole_session(),
        plot_legend=rrb.PlotLegend("LeftTop"),
    )


def _in_colour(number: int) -> list[rr.SeriesLines | rr.SeriesPoints]:
    palette = [colours.LEVELS[number % len(colours.LEVELS)]]
    return [rr.SeriesLines(colors=palette), rr.SeriesPoints(colors=palette)]
