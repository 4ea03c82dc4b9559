"""Samples of files become blocks and sessions."""

from pathlib import Path

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.files.block_builder import (
    RESTART_SILENCE,
    BlockCutter,
    MeasurementFile,
    StampedSamples,
    moment,
    stamp_samples,
)
from sensors.files.table import ChannelTable, FileError

RATE = 40.0  # [Hz]
START = 1_700_000_000 * NANOSECONDS
LAYOUT = SensorLayout("l", "t", "tower", (Accelerometer("ax", 100.0, FORE_AFT),))


def chunk(start_ns: int, seconds: int) -> StampedSamples:
    n = round(seconds * RATE)
    times_ns = start_ns + np.round(np.arange(n) / RATE * NANOSECONDS).astype(np.int64)
    return StampedSamples(times_ns, np.ones((n, 1)))


@pytest.mark.parametrize(("silence", "n_sessions"), [(0.5, 1), (2.0, 2)])
def test_a_long_silence_ends_a_session_and_a_short_one_is_a_gap_in_it(
    silence: float, n_sessions: int
) -> None:
    """`silence` of the longest that a session bridges."""
    gap = round(silence * RESTART_SILENCE)  # whole seconds
    cutter = BlockCutter(LAYOUT, RATE)
    later = START + (10 + gap) * NANOSECONDS
    blocks = [*cutter.push(chunk(START, 10)), *cutter.push(chunk(later, 10)), *cutter.finish()]
    assert len({block.session for block in blocks}) == n_sessions
    after = next(block for block in blocks if block.start_ns >= later)
    assert after.start_ns == later
    assert after.first_sample == (0 if n_sessions == 2 else round((10 + gap) * RATE))
    assert (after.sequence == 0) is (n_sessions == 2)


def test_the_end_of_a_file_loses_no_sample() -> None:
    cutter, whole = BlockCutter(LAYOUT, RATE), chunk(START, 10)
    last = StampedSamples(whole.times_ns[:-15], whole.samples[:-15])
    blocks = [*cutter.push(last), *cutter.finish()]
    assert [len(block.samples) for block in blocks] == [40] * 9 + [25]
    assert [*cutter.finish()] == []


@pytest.mark.parametrize(
    ("time_ns", "text"),
    [
        (1_709_294_400_250_999_999, "2024-03-01 12:00:00.250"),
        (1_709_294_400_007_000_000, "2024-03-01 12:00:00.007"),
        (1_000_050_000_000, "1000.050 s"),
    ],
)
def test_a_time_in_a_message_has_milliseconds(time_ns: int, text: str) -> None:
    assert moment(time_ns) == text


FILES = [
    MeasurementFile(Path(name), None, ("ax",), ("",), None, START) for name in ("a.csv", "b.csv")
]


def table(
    start_ns: int, times: list[float] | None, samples: list[float] | None = None
) -> ChannelTable:
    values = np.array(samples or [1.0] * len(times or ()))[:, None]
    stamps = None if times is None else np.array(times)
    return ChannelTable(("ax",), ("",), values, stamps, start_ns)


def test_samples_without_stamps_are_counted_through_a_file_and_anew_in_the_next() -> None:
    chunks = [(0, table(START, None, [1.0] * 3)), (0, table(START, None, [1.0] * 2))]
    later = START + NANOSECONDS
    stamped = list(stamp_samples(FILES, [*chunks, (1, table(later, None, [1.0]))], RATE))
    since = [list((each.times_ns - START) / NANOSECONDS * RATE) for each in stamped]
    assert since == [[0, 1, 2], [3, 4], [RATE]]


def test_a_row_without_any_number_is_missing_and_nothing_else_is() -> None:
    chunk = table(START, [0.0, 0.1, 0.2], [1.0, np.nan, 3.0])
    (stamped,) = stamp_samples(FILES, [(0, chunk)], RATE)
    assert list(stamped.samples[:, 0]) == [1.0, 3.0]
    assert list(stamped.times_ns - START) == [0, 200_000_000]
    assert list(stamp_samples(FILES, [(0, table(START, [0.0], [np.nan]))], RATE)) == []


@pytest.mark.parametrize(
    ("chunks", "reason"),
    [
        (
            [(0, table(START, [0.0, 0.1, 0.1]))],
            "a.csv: time stands still or goes back at .*13:20.1",
        ),
        ([(0, table(START, [0.0, 0.2, 0.1]))], "goes back at 2023-11-14 22:13:20.100"),
        ([(0, table(START, [0.0])), (0, table(START, [0.0]))], "a.csv: time stands still"),
        (
            [(0, table(START, [0.0])), (1, table(START, [0.0], [2.0]))],
            "b.csv begins at .*before a.csv .*, with other samples",
        ),
        (
            [(0, table(START, [0.0, 0.1])), (1, table(START - 10**8, [0.0, 0.1, 0.2]))],
            "b.csv begins at .*before a.csv .*, with other samples",
        ),
        ([(0, table(0, [-1.0]))], "a.csv begins at -1.000 s, before 1970"),
    ],
)
def test_time_that_does_not_rise_is_refused_with_the_moment(
    chunks: list[tuple[int, ChannelTable]], reason: str
) -> None:
    with pytest.raises(FileError, match=reason):
        list(stamp_samples(FILES, chunks, RATE))


def test_time_may_rise_by_a_nanosecond_and_begin_with_1970() -> None:
    step = [(0, table(0, [0.0])), (1, table(1, [0.0]))]
    assert [int(each.times_ns[0]) for each in stamp_samples(FILES, step, RATE)] == [0, 1]
