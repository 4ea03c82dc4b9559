"""Rows wait until every channel has its samples."""

import numpy as np
import pytest

from sensors.acquisition.blocks import BlockStatus
from sensors.feeds.assembly.block_builder import RowCutter, SessionNames
from sensors.feeds.assembly.timestamp_alignment import WaitingRows
from tests.sensors.feeds.assembly.test_block_builder import LAYOUT, RATE


@pytest.mark.parametrize(("first", "brings"), [(0, False), (5, True), (10, True), (-100, False)])
def test_samples_of_which_some_are_new_have_brought_something(first: int, brings: bool) -> None:
    """Ten samples are there; those that come now begin at `first`."""
    cutter: object = None  # nothing is complete here
    rows = WaitingRows(cutter, 2, wait=40)  # type: ignore[arg-type]
    samples = np.ones((10, 2))
    assert rows.put(0, [0, 1], samples, BlockStatus.OK)
    assert rows.put(first, [0, 1], samples, BlockStatus.OK) == brings


def test_no_more_rows_are_held_than_samples_have_come() -> None:
    rows = WaitingRows(RowCutter(LAYOUT, RATE, 40, SessionNames()), 1, wait=40)
    for begin in range(0, 100, 10):
        assert rows.put(begin, [0], np.ones((10, 1)), BlockStatus.OK)
        assert len(rows._rows) == begin + 10 - rows.base
