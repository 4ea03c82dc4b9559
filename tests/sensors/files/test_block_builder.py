"""Samples of files become blocks and sessions."""

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.files.block_builder import RESTART_SILENCE, BlockCutter, StampedSamples, moment

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
