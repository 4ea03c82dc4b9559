"""Local time over the change of the clocks."""

from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pytest

from sensors.files.text.dates import Midnights, SummerTime

STEP = 50_000_000  # [ns]


def stamps(begin: str, count: int) -> np.ndarray:
    return np.datetime64(begin, "ns").astype(np.int64) + STEP * np.arange(count)


@pytest.mark.parametrize(
    ("before", "after", "changes"),
    [
        ("2026-10-25T02:59:59", "2026-10-25T02:00:00", 1),
        ("2026-11-01T01:59:59", "2026-11-01T01:00:00", 1),
        ("2026-03-29T01:59:59", "2026-03-29T03:00:00", 1),
        ("2026-10-25T02:59:59", "2026-10-25T02:00:30", 1),  # half a minute is missing
        ("2026-10-26T02:59:59", "2026-10-26T02:00:00", 0),  # a Monday
        ("2026-10-25T12:59:59", "2026-10-25T12:00:00", 0),  # at noon
        ("2026-03-29T01:59:59", "2026-03-29T03:00:10", 0),  # an hour and ten seconds are missing
    ],
)
@pytest.mark.parametrize("batch", [7, 40])
def test_the_hour_of_a_change_is_taken_off(
    before: str, after: str, changes: int, batch: int
) -> None:
    written = np.concatenate([stamps(before, 20), stamps(after, 20)])
    clock = SummerTime()
    parts = [clock.continuous(written[i : i + batch]) for i in range(0, 40, batch)]
    read = np.concatenate(parts)
    assert len(clock.changes_ns) == changes
    if changes:
        assert clock.changes_ns == [written[20]]
        missing = 30_000_000_000 if after.endswith("30") else 0
        steps = np.full(39, STEP)
        steps[19] += missing
        np.testing.assert_array_equal(np.diff(read), steps)
    else:
        np.testing.assert_array_equal(read, written)


@pytest.mark.parametrize("batch", [7, 40])
def test_times_of_day_go_on_over_midnight(batch: int) -> None:
    day = 86_400 * 10**9
    times = day - 10 * STEP + STEP * np.arange(40)
    clock = Midnights()
    parts = [clock.continuous((times % day)[i : i + batch]) for i in range(0, 40, batch)]
    np.testing.assert_array_equal(np.concatenate(parts), times)


def test_times_of_day_that_go_back_otherwise_are_left() -> None:
    times = np.array([5, 6, 3, 4]) * 3600 * 10**9
    np.testing.assert_array_equal(Midnights().continuous(times), times)


def berlin(begin: str, utc_steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments of UTC from one on, and what Berlin's clock shows then [ns]."""
    utc = np.datetime64(begin, "ns").astype(np.int64) + np.cumsum(utc_steps) - utc_steps[0]
    zone = ZoneInfo("Europe/Berlin")
    ahead = [datetime.fromtimestamp(each // 10**9, zone).utcoffset() for each in utc.tolist()]
    return utc, utc + np.array([round(each.total_seconds()) for each in ahead if each]) * 10**9


@pytest.mark.parametrize("begin", ["2025-10-25T21:00", "2025-10-26T00:20", "2025-03-29T21:00"])
@pytest.mark.parametrize("step", [1, 60, 300, 600, 900, 1800, 3600])
@pytest.mark.parametrize("batch", [11, 100_000])
def test_rows_further_apart_than_a_minute_follow_the_clock_too(
    begin: str, step: int, batch: int
) -> None:
    utc, local = berlin(begin, np.full(8 * 3600 // step, step * 10**9))
    clock = SummerTime()
    read = [clock.continuous(local[i : i + batch]) for i in range(0, len(local), batch)]
    np.testing.assert_array_equal(np.diff(np.concatenate(read)), np.diff(utc))
    assert len(clock.changes_ns) == 1
    assert clock.went_back == ("-10-" in begin)


def test_rows_of_uneven_steps_follow_the_clock_too() -> None:
    uneven = np.random.default_rng(7).uniform(540e9, 660e9, 48).astype(np.int64)
    for begin in ("2025-10-25T21:00", "2025-03-29T21:00"):
        _, local = berlin(begin, uneven)
        np.testing.assert_array_equal(np.diff(SummerTime().continuous(local)), uneven[1:])


@pytest.mark.parametrize("missing", [1, 2])
def test_rows_that_are_missing_as_the_clock_goes_back_hide_no_change(missing: int) -> None:
    utc, local = berlin("2025-10-25T21:00", np.full(48, 600 * 10**9))
    change = int(np.argmax(np.diff(local) < 0)) + 1
    kept = np.delete(np.arange(48), np.arange(change, change + missing))
    np.testing.assert_array_equal(np.diff(SummerTime().continuous(local[kept])), np.diff(utc[kept]))


@pytest.mark.parametrize("step", [60, 600])
def test_rows_out_of_order_or_written_twice_are_no_change(step: int) -> None:
    rows = np.datetime64("2025-10-26T02:00", "ns").astype(np.int64) + step * 10**9 * np.arange(9)
    for places in ([0, 1, 3, 2, 4, 5, 6, 7, 8], [0, 1, 2, 2, 3, 4, 5, 6, 7]):
        clock = SummerTime()
        np.testing.assert_array_equal(clock.continuous(rows[places]), rows[places])
        assert not clock.went_back
