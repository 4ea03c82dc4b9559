"""Memory that a node has freed goes back to the system."""

import ctypes
import itertools
from pathlib import Path

import numpy as np
import pytest

from pipeline.runtime.node_thread import TRIM_PERIOD, FreedMemory

STATUS = Path("/proc/self/status")


def resident() -> float:
    """Of this process [MB]."""
    (line,) = [each for each in STATUS.read_text().splitlines() if each.startswith("VmRSS")]
    return int(line.split()[1]) / 1024


def test_at_most_once_a_period() -> None:
    times = iter([0.0, 1.0, TRIM_PERIOD, TRIM_PERIOD, TRIM_PERIOD + 1.0, 2.0 * TRIM_PERIOD])
    freed = FreedMemory(lambda: next(times))
    assert [freed.give_back() for _ in range(3)] == [False, True, False]


@pytest.mark.skipif(
    not hasattr(ctypes.CDLL(None), "malloc_trim") or not STATUS.exists(),
    reason="needs glibc's malloc_trim and /proc",
)
def test_holes_between_what_is_kept_are_returned() -> None:
    arrays = [np.ones(8_000) for _ in range(1_600)]  # 64 kB each: from the heap, not mapped alone
    kept = arrays[::2]
    del arrays
    before = resident()
    clock = itertools.count(0.0, TRIM_PERIOD)
    assert FreedMemory(lambda: next(clock)).give_back()
    assert before - resident() > 25.0  # of 51 MB
    assert len(kept) == 800
