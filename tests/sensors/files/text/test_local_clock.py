"""Local time over the change of the clocks."""

from datetime import datetime
from zoneinfo import ZoneInfo

import numpy as np
import pyarrow as pa
import pytest

from sensors.files.text.local_clock import Midnights, SummerTime, ZoneClock, clock_changes
from sensors.files.text.time_column import TextClock, midnights_of_numbers

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
    parts = [clock.in_utc(written[i : i + batch]) for i in range(0, 40, batch)]
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


@pytest.mark.parametrize("batch", [7, 40])
def test_seconds_since_midnight_go_on_over_midnight(batch: int) -> None:
    seconds = 86_399.0 + 0.05 * np.arange(60)
    counted = seconds % 86_400
    clock = midnights_of_numbers()
    added = [clock.seconds_added(counted[i : i + batch]) for i in range(0, 60, batch)]
    np.testing.assert_allclose(counted + np.concatenate(added), seconds, atol=1e-9)


@pytest.mark.parametrize(
    "counted",
    [
        [83_000.0, 83_000.1, 0.0, 0.1],  # another start, not midnight
        [90_000.0, 90_000.1, 3_600.0, 3_600.1],  # no count since midnight is so large
        [86_399.9, 86_400.0, -0.1, 0.0],
        [1e300, 0.0],
    ],
)
def test_a_count_that_begins_again_at_another_time_is_left(counted: list[float]) -> None:
    added = midnights_of_numbers().seconds_added(np.array(counted))
    np.testing.assert_array_equal(added, 0.0)


def berlin(begin: str, utc_steps: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Moments of UTC from one on, and what Berlin's clock shows then [ns]."""
    utc = np.datetime64(begin, "ns").astype(np.int64) + np.cumsum(utc_steps) - utc_steps[0]
    zone = ZoneInfo("Europe/Berlin")
    ahead = [datetime.fromtimestamp(each // 10**9, zone).utcoffset() for each in utc.tolist()]
    return utc, utc + np.array([round(each.total_seconds()) for each in ahead if each]) * 10**9


@pytest.mark.parametrize("begin", ["2025-10-25T21:00", "2025-10-26T00:20", "2025-03-29T21:00"])
@pytest.mark.parametrize("step", [20, 60, 300, 600, 900, 1800, 3600])
@pytest.mark.parametrize("batch", [11, 100_000])
def test_rows_further_apart_than_a_minute_follow_the_clock_too(
    begin: str, step: int, batch: int
) -> None:
    utc, local = berlin(begin, np.full(8 * 3600 // step, step * 10**9))
    clock = SummerTime()
    read = [clock.in_utc(local[i : i + batch]) for i in range(0, len(local), batch)]
    np.testing.assert_array_equal(np.diff(np.concatenate(read)), np.diff(utc))
    assert len(clock.changes_ns) == 1
    assert clock.went_back == ("-10-" in begin)


def test_rows_of_uneven_steps_follow_the_clock_too() -> None:
    uneven = np.random.default_rng(7).uniform(540e9, 660e9, 48).astype(np.int64)
    for begin in ("2025-10-25T21:00", "2025-03-29T21:00"):
        _, local = berlin(begin, uneven)
        np.testing.assert_array_equal(np.diff(SummerTime().in_utc(local)), uneven[1:])


@pytest.mark.parametrize("missing", [1, 2])
def test_rows_that_are_missing_as_the_clock_goes_back_hide_no_change(missing: int) -> None:
    utc, local = berlin("2025-10-25T21:00", np.full(48, 600 * 10**9))
    change = int(np.argmax(np.diff(local) < 0)) + 1
    kept = np.delete(np.arange(48), np.arange(change, change + missing))
    np.testing.assert_array_equal(np.diff(SummerTime().in_utc(local[kept])), np.diff(utc[kept]))


@pytest.mark.parametrize("step", [60, 600])
def test_rows_out_of_order_or_written_twice_are_no_change(step: int) -> None:
    rows = np.datetime64("2025-10-26T02:00", "ns").astype(np.int64) + step * 10**9 * np.arange(9)
    for places in ([0, 1, 3, 2, 4, 5, 6, 7, 8], [0, 1, 2, 2, 3, 4, 5, 6, 7]):
        clock = SummerTime()
        np.testing.assert_array_equal(clock.in_utc(rows[places]), rows[places])
        assert not clock.went_back


def batches(clock: SummerTime | ZoneClock, local: np.ndarray, size: int = 100_000) -> np.ndarray:
    return np.concatenate([clock.in_utc(local[i : i + size]) for i in range(0, len(local), size)])


def test_a_zones_clocks_are_set_when_they_are() -> None:
    year = [int(np.datetime64(f"{each}-01-01", "ns").astype(np.int64)) for each in (2025, 2026)]
    found = {
        zone: [str(np.datetime64(each.moment_ns, "ns"))[:16] for each in clock_changes(zone, *year)]
        for zone in ("Europe/Berlin", "Australia/Lord_Howe", "Asia/Taipei", "UTC", "UTC+02:00")
    }
    assert found == {
        "Europe/Berlin": ["2025-03-30T01:00", "2025-10-26T01:00"],
        "Australia/Lord_Howe": ["2025-04-05T15:00", "2025-10-04T15:30"],
        "Asia/Taipei": [],
        "UTC": [],
        "UTC+02:00": [],
    }


@pytest.mark.parametrize("begin", ["2025-10-25T21:00", "2025-10-26T00:20", "2025-03-29T21:00"])
@pytest.mark.parametrize("step", [20, 60, 300, 600, 900, 1800, 3600])
@pytest.mark.parametrize("batch", [5, 11, 100_000])
def test_stamps_of_a_zone_that_is_stated_are_read_in_utc(begin: str, step: int, batch: int) -> None:
    utc, local = berlin(begin, np.full(8 * 3600 // step, step * 10**9))
    clock = ZoneClock("Europe/Berlin")
    np.testing.assert_array_equal(batches(clock, local, batch), utc)
    assert not clock.remarks
    assert clock.went_back == ("-10-" in begin)


@pytest.mark.parametrize("zone", ["UTC", "UTC+00:00", "UTC+01:00", "Asia/Taipei", "Etc/GMT-1"])
def test_a_clock_that_is_never_set_has_an_hour_without_rows(zone: str) -> None:
    ahead = {"UTC": 0, "UTC+00:00": 0, "Asia/Taipei": 8}.get(zone, 1) * 3600 * 10**9
    for night in ("2025-03-30", "2025-03-09", "2025-10-05"):
        for hour in (1, 2):
            rows = np.datetime64(f"{night}T00:00", "ns").astype(np.int64) + 600 * 10**9 * np.arange(
                36
            )
            rows = np.delete(rows, np.arange(6 * hour, 6 * hour + 6))
            np.testing.assert_array_equal(ZoneClock(zone).in_utc(rows), rows - ahead)


def test_an_hour_without_rows_on_another_night_or_at_another_time_is_missing() -> None:
    for begin, zone in (
        ("2025-03-02T01:00", "Europe/Berlin"),  # four weeks before
        ("2025-03-02T02:00", ""),
        ("2025-03-16T02:00", ""),
        ("2025-11-09T02:00", ""),
        ("2025-03-30T01:30", ""),  # not on the full hour
    ):
        first = np.datetime64(begin, "ns").astype(np.int64)
        rows = first + 600 * 10**9 * np.append(np.arange(-12, 0), np.arange(6, 40))
        clock = ZoneClock(zone) if zone else SummerTime()
        np.testing.assert_array_equal(np.diff(clock.in_utc(rows)), np.diff(rows))


@pytest.mark.parametrize("night", ["2025-03-30", "2025-10-26"])
def test_rows_that_are_missing_over_the_change_do_not_hide_it(night: str) -> None:
    begin = str(np.datetime64(night) - 1) + "T12:00"
    utc, local = berlin(begin, np.full(200, 600 * 10**9))
    for first, last in ((60, 90), (70, 82), (75, 79), (5, 190)):
        kept = np.delete(np.arange(200), np.arange(first, last))
        clock = ZoneClock("Europe/Berlin")
        read = batches(clock, local[kept], 16)
        np.testing.assert_array_equal(read[utc[kept] > utc[85]], utc[kept][utc[kept] > utc[85]])
        np.testing.assert_array_equal(read[:first], utc[:first])


@pytest.mark.parametrize("step", [0.05, 2.0, 600.0])
@pytest.mark.parametrize("batch", [3, 100_000])
def test_a_clock_that_is_set_a_moment_late_loses_nothing(step: float, batch: int) -> None:
    """The row on the full hour is still of the time before: 03:00 CEST, 02:00 CET."""
    ns = round(step * 1e9)
    for change in ("2025-10-26T01:00", "2025-03-30T01:00"):
        utc = np.datetime64(change, "ns").astype(np.int64) + ns * np.arange(-20, 60)
        _, local = berlin(str(np.datetime64(int(utc[0]) - ns, "ns")), np.full(80, ns))
        np.testing.assert_array_equal(batches(ZoneClock("Europe/Berlin"), local + ns, batch), utc)


def test_a_clock_that_is_not_set_with_its_zone_is_named() -> None:
    spring = np.datetime64("2025-03-29T22:00", "ns").astype(np.int64) + 600 * 10**9 * np.arange(60)
    clock = ZoneClock("Europe/Berlin")
    np.testing.assert_array_equal(batches(clock, spring, 7), spring - 3600 * 10**9)
    (remark,) = clock.remarks
    assert "the hour from 2025-03-30T02:00:00, which Europe/Berlin leaves out" in remark
    assert "--zone UTC+01:00 states" in remark
    autumn = np.datetime64("2025-10-25T22:00", "ns").astype(np.int64) + 600 * 10**9 * np.arange(60)
    clock = ZoneClock("Europe/Berlin")
    hours = (autumn - batches(clock, autumn, 7)) // (3600 * 10**9)
    assert set(hours[:24]) == {2}
    assert set(hours[31:]) == {1}
    (remark,) = clock.remarks
    assert "the hour from 2025-10-26T02:00:00 comes once, and twice in Europe/Berlin" in remark


@pytest.mark.parametrize("zone", ["UTC", "UTC+02:00"])
@pytest.mark.parametrize("batch", [7, 48])
def test_a_fixed_clock_that_goes_back_is_named_and_followed(zone: str, batch: int) -> None:
    """As under a title "Zeit (MESZ)", which was true of the first rows."""
    _, local = berlin("2025-10-25T21:00", np.full(48, 600 * 10**9))
    clock = ZoneClock(zone)
    read = batches(clock, local, batch)
    assert set(np.diff(read)) == {600 * 10**9}
    assert local[0] - read[0] == (0 if zone == "UTC" else 7200 * 10**9)
    (remark,) = clock.remarks
    assert "goes back by an hour at 2025-10-26T02:00:00" in remark
    assert f"{zone} is stated" in remark


def test_rows_in_falling_order_have_the_offset_of_their_day() -> None:
    utc, local = berlin("2025-10-25T12:00", np.full(200, 600 * 10**9))
    read = batches(ZoneClock("Europe/Berlin"), local[::-1], 50)[::-1]
    outside = np.abs(utc - np.datetime64("2025-10-26T01:00", "ns").astype(np.int64)) > 3600 * 10**9
    np.testing.assert_array_equal(read[outside], utc[outside])


@pytest.mark.parametrize(("bits", "signed"), [(16, False), (32, False), (32, True)])
@pytest.mark.parametrize("rows", [700, 1_000_000])
def test_a_counter_that_begins_again_goes_on(bits: int, signed: bool, rows: int) -> None:
    counts = 2 ** (bits - int(signed)) - 7_000 + 20 * np.arange(1000, dtype=np.int64)
    written = (counts + (2 ** (bits - 1) if signed else 0)) % 2**bits - (
        2 ** (bits - 1) if signed else 0
    )
    assert (np.diff(written) < 0).sum() == 1
    written = np.delete(written, np.arange(345, 350))  # with some missing where it begins again
    counts = np.delete(counts, np.arange(345, 350))
    for kind in (pa.int64(), pa.float64(), pa.decimal128(32, 12)):
        clock = TextClock("t", "ms")
        batches = (written[i : i + rows] for i in range(0, len(written), rows))
        seconds = [clock.seconds(pa.array(batch).cast(kind)) for batch in batches]
        np.testing.assert_allclose(np.concatenate(seconds), (counts - counts[0]) / 1e3, atol=1e-9)


@pytest.mark.parametrize("values", [[0, 20, 40, 0, 20, 40], [65_400, 65_420, 3_000, 3_020]])
def test_a_count_that_is_set_back_is_no_counter_at_its_end(values: list[int]) -> None:
    seconds = TextClock("t", "ms").seconds(pa.array(values))
    np.testing.assert_allclose(seconds, (np.array(values) - values[0]) / 1e3)
