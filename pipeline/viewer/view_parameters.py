"""What the tabs share: parameters of a turbine's views, time axes, lists of events."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.components import Corner2DBatch
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from pipeline.viewer.drawing.entities import TIMELINE
from pipeline.viewer.pictures import colours
from sensors.acquisition.layout import SensorLayout

Corner = Literal["", "LeftTop"]  # of a plot, where its legend is; "": there is none
AT_LEFT = Corner2DBatch("LeftTop")
TIME_MARGIN = 0.05  # of a finished session's time axis on both sides: room for dates [-]
# Of every drawing, in both themes.
GROUND = rrb.Background(color=colours.BACKGROUND, kind="SolidColor")
GRID_MARGIN = 0.15  # the same of the small plots in a grid [-]
LEGEND_MARGIN = 0.2  # the same on the left where a legend stands there, beside the lines [-]
NARROW_MARGINS = (0.08, 0.45)  # of a narrow screen: TIME_MARGIN and LEGEND_MARGIN [-]


@dataclass(frozen=True, slots=True)
class ViewParameters:
    """What the blueprint of one turbine depends on."""

    turbine: str
    layouts: tuple[SensorLayout, ...]
    """Layouts of its acquisition units."""
    modes: tuple[str, ...]
    """Labels of the modes with a plot of their own, in order."""
    mid_height: float
    """Elevation at which the camera looks [m]."""
    sized: bool = False
    """Whether a change of known size was detected; it gets a plot."""
    has_structure: bool = True
    """Whether there is a structural model; without one the tabs have modes only."""
    has_truth: bool = False
    """Whether the true stiffness is known, as of a simulated turbine."""

    lists_nodes: bool = True
    """Whether nodes report under its name; those of a session report under one turbine's."""

    @property
    def truth(self) -> str:
        """Words of a title about the colour of the truth; "" where there is none."""
        return ", truth green" if self.has_truth else ""


def time_series(origin: str, name: str, legend: Corner = "", **more: Any) -> rrb.TimeSeriesView:
    """Return a plot over the whole session, first to last sample, wherever the cursor is.

    Parameters
    ----------
    legend : Corner, optional
        Where it is.
    """
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.infinite()
    return rrb.TimeSeriesView(
        origin=origin,
        name=name,
        time_ranges=rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
        axis_x=rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
        plot_legend=rrb.PlotLegend(legend) if legend else rrb.PlotLegend(visible=False),
        **more,
    )


def with_margins(
    part: Any,
    span_ns: tuple[int, int],
    margin: float = TIME_MARGIN,
    legend_margin: float = LEGEND_MARGIN,
) -> None:
    """Give every plot below a container its room beside the first and the last sample.

    Parameters
    ----------
    part : Container or View
        Changed in place.
    span_ns : tuple of int
        Start and end of the session [ns since 1970].
    margin : float, optional
        Room on both sides, as a share of the session [-].
    legend_margin : float, optional
        Room on the left where a legend stands there [-].
    """
    if isinstance(part, rrb.Container):
        inside = GRID_MARGIN if isinstance(part, rrb.Grid) else margin
        for each in part.contents:
            with_margins(each, span_ns, inside, legend_margin)
    elif isinstance(part, rrb.TimeSeriesView):
        (start, end), legend = span_ns, part.properties["PlotLegend"]
        at_left = isinstance(legend, rrb.PlotLegend) and legend.corner == AT_LEFT
        left = legend_margin if at_left else margin
        first = rrb.TimeRangeBoundary.absolute(nanos=round(start - left * (end - start)))
        last = rrb.TimeRangeBoundary.absolute(nanos=round(end + margin * (end - start)))
        part.properties["TimeAxis"] = rrb.TimeAxis(view_range=rr.TimeRange(start=first, end=last))


def plane(
    origin: str, name: str, x_range: Sequence[float], y_range: Sequence[float]
) -> rrb.Spatial2DView:
    """Return a view of a picture in its own units, y down."""
    bounds = rrb.VisualBounds2D(x_range=list(x_range), y_range=list(y_range))
    return rrb.Spatial2DView(origin=origin, name=name, visual_bounds=bounds, background=GROUND)


def events_view(path: str, name: str = "Events") -> rrb.TextLogView:
    """Return a list of events, line by line; each line starts with its time."""
    return rrb.TextLogView(
        origin=path,
        name=name,
        columns=rrb.TextLogColumns(
            timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
            text_log_columns=[TextLogColumn("LogLevel"), TextLogColumn("Body")],
        ),
    )
