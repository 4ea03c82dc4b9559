"""Local time over the change of the clocks."""

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
