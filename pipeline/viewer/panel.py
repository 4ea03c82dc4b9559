"""What the tabs share: what they must know of a turbine, time axes, lists of events."""

from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from pipeline.viewer.drawing.entities import TIMELINE
from sensors.acquisition.layout import SensorLayout


@dataclass(frozen=True, slots=True)
class TurbinePanel:
    """What the layout must know of one turbine."""

    turbine: str
    layouts: tuple[SensorLayout, ...]  # of its acquisition units
    modes: tuple[str, ...]  # model labels that get a plot of their own, in order
    mid_height: float  # where the camera looks [m]
    sized: bool = False  # a change was noticed and by how much is known: that gets a plot


def whole_session() -> dict[str, Any]:
    """Data and axis of a plot from the first to the last sample, wherever the cursor is."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.infinite()
    return {
        "time_ranges": rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
        "axis_x": rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
    }


def events_view(path: str, name: str = "Events") -> rrb.TextLogView:
    """A list of events, line by line; each line says its own time."""
    return rrb.TextLogView(
        origin=path,
        name=name,
        columns=rrb.TextLogColumns(
            timeline_columns=[TimelineColumn(TIMELINE, visible=False)],
            text_log_columns=[TextLogColumn("LogLevel"), TextLogColumn("Body")],
        ),
    )
