"""A turbine's history falls into days; each says by its fingerprint what it adds."""

from datetime import UTC, datetime
from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from pipeline.archive.history.turbine_history import date_of, days_of
from pipeline.archive.identification import IdentificationCall
from pipeline.archive.plan import IdentificationTask
from pipeline.messages import StreamGap
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import NANOSECONDS

HOUR = 3600 * NANOSECONDS
START_NS = round(datetime(2026, 1, 4, tzinfo=UTC).timestamp()) * NANOSECONDS
HOURS = st.lists(st.integers(0, 100), max_size=6, unique=True).map(sorted)


def call(hour: int) -> IdentificationCall:
    begin = START_NS + hour * HOUR
    task = IdentificationTask(
        Path("f"), (f"bytes of {hour}",), "t1", ("l",), (), begin, begin + HOUR, 6
    )
    return IdentificationCall(task, OmaSettings())


def gap(hour: int) -> StreamGap:
    begin = START_NS + hour * HOUR
    return StreamGap("t1", "tower", "s", begin, begin + HOUR, hour, 10)


@given(HOURS, HOURS)
def test_every_task_and_every_gap_is_of_the_day_that_it_begins_on(
    task_hours: list[int], gap_hours: list[int]
) -> None:
    calls, gaps = [call(hour) for hour in task_hours], [gap(hour) for hour in gap_hours]
    days = days_of(calls, gaps)
    assert [each for day in days for each in day.calls] == calls
    assert [each for day in days for each in day.gaps] == gaps
    assert [day.date for day in days] == sorted({day.date for day in days})
    for day in days:
        begins = [e.task.start_ns for e in day.calls] + [e.start_ns for e in day.gaps]
        assert {date_of(each) for each in begins} == {day.date}
        number = int(day.date[-2:]) - 4  # January
        assert all(24 * number <= (each - START_NS) // HOUR < 24 * (number + 1) for each in begins)
        assert day.month == "2026-01"


def test_a_day_changes_with_each_task_and_each_gap_and_not_with_other_days() -> None:
    (plain, later) = days_of([call(1), call(2), call(30)], [gap(3)])
    without_gap, same = days_of([call(1), call(2), call(30)], [])
    (other_gap, _) = days_of([call(1), call(2), call(30)], [gap(4)])
    (fewer, _) = days_of([call(1), call(30)], [gap(3)])
    assert len({each.content for each in (plain, without_gap, other_gap, fewer)}) == 4
    assert same.content == later.content


def test_a_fingerprint_is_of_the_day_before_and_of_what_was_done() -> None:
    (day,) = days_of([call(1), call(2)], [])
    keys = [day.key(before, done) for before in "ab" for done in ([True, True], [True, False])]
    assert len(set(keys)) == 4
    assert keys[0] == day.key("a", [True, True])


def test_the_last_nanosecond_of_a_day_is_still_its_own() -> None:
    midnight = START_NS + 24 * HOUR
    assert [date_of(each) for each in (START_NS, midnight - 1, midnight)] == [
        *("2026-01-04", "2026-01-04", "2026-01-05"),
    ]
