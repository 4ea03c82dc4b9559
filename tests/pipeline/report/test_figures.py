"""Pictures of a report: axes that suit any length, nothing too short to be seen."""

import re
import warnings

import pytest

from pipeline.messages import StreamGap
from pipeline.report.figures import windows_over_time
from pipeline.report.recorded_session import TurbineRecord
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.report.example_session import session

HOUR = 3600 * NANOSECONDS


def record(hours: float) -> TurbineRecord:
    """The example session, of that duration, with one gap of two seconds."""
    made = TurbineRecord("t1")
    for message in session():
        if not isinstance(message, StreamGap):
            made.run.fold(message)
    start = min(each.start_ns for each in made.state.estimates)
    made.state.first_ns, made.state.last_ns = start, start + round(hours * HOUR)
    middle = start + round(hours * HOUR / 2)
    made.run.fold(StreamGap("t1", "tower", "s1", middle, middle + 2 * NANOSECONDS, 0, 2))
    return made


@pytest.mark.parametrize("hours", [0.6, 2.1, 5, 11, 30, 50, 71, 200, 2000])
def test_a_session_of_any_length_has_a_few_times_on_its_axis(hours: float) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        svg = windows_over_time(record(hours))
    ticks = re.findall(r'id="xtick_\d+"', svg)
    assert 2 <= len(ticks) <= 9


def test_a_gap_of_seconds_is_seen_in_a_session_of_days() -> None:
    svg = windows_over_time(record(72))
    (gap,) = re.findall(r'id="LineCollection_3".*?<path d="M ([\d.]+) \S+ \nL ([\d.]+)', svg, re.S)
    assert float(gap[1]) - float(gap[0]) > 0.5  # [points]
