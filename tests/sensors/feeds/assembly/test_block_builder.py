"""Rows become blocks; what is missing leaves a hole in their numbers."""

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.feeds.assembly.block_builder import RowCutter, SessionNames

RATE = 40.0  # [Hz]
LAYOUT = SensorLayout("l", "t", "tower", (Accelerometer("ax", 100.0, FORE_AFT),))


def time_of(index: int) -> int:
    return 1_700_000_000 * NANOSECONDS + round(index / RATE * NANOSECONDS)


@pytest.mark.parametrize(("missing", "skipped"), [(5, 1), (40, 1), (100, 2)])
def test_a_gap_however_short_leaves_a_hole_in_the_blocks_numbers(
    missing: int, skipped: int
) -> None:
    """Whoever counts blocks sees that something is missing, as whoever counts samples does."""
    cutter = RowCutter(LAYOUT, RATE, 40, SessionNames())
    rows = np.ones((80, 1))
    blocks = [
        *cutter.push(0, rows, time_of),
        *cutter.push(80 + missing, rows, time_of),
    ]
    assert [block.sequence for block in blocks] == [0, 1, 2 + skipped, 3 + skipped]
    assert [block.first_sample for block in blocks] == [0, 40, 80 + missing, 120 + missing]
    assert cutter.missing_blocks == skipped


def test_a_session_that_begins_late_counts_its_samples_from_its_own_first() -> None:
    cutter = RowCutter(LAYOUT, RATE, 40, SessionNames())
    blocks = [*cutter.push(1000, np.ones((100, 1)), time_of)]
    assert [block.first_sample for block in blocks] == [0, 40]
    assert [block.sequence for block in blocks] == [0, 1]
    assert [block.start_ns for block in blocks] == [time_of(1000), time_of(1040)]
