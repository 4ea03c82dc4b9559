"""What the tabs share: parameters of a turbine's views, time axes, lists of events."""

from dataclasses import dataclass
from typing import Any

import rerun as rr
import rerun.blueprint as rrb
from rerun.blueprint.encodings import TextLogColumn, TimelineColumn

from pipeline.viewer.drawing.entities import TIMELINE
from sensors.acquisition.layout import SensorLayout


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


def whole_session() -> dict[str, Any]:
    """Return the time range of a plot: first to last sample, wherever the cursor is."""
    start, end = rrb.TimeRangeBoundary.infinite(), rrb.TimeRangeBoundary.infinite()
    return {
        "time_ranges": rrb.VisibleTimeRange(TIMELINE, start=start, end=end),
        "axis_x": rrb.TimeAxis(view_range=rr.TimeRange(start=start, end=end)),
    }


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
