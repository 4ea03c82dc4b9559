"""The newest rows of a unit, which wait until every channel has its samples."""

from collections.abc import Iterator

import numpy as np

from sensors.acquisition.blocks import AccelerationBlock, BlockStatus
from sensors.arrays import FloatArray
from sensors.feeds.assembly.block_builder import RowCutter
from sensors.feeds.assembly.clock_estimate import UnitClock


class WaitingRows:
    """Rows of one session, by index on its clock.

    cutter      takes the rows that are done
    n_columns   of a row
    wait        for a channel that is late [samples]
    """

    def __init__(self, cutter: RowCutter, n_columns: int, wait: int) -> None:
        self.wait = wait
        self.base = -wait  # index of the first row that waits: another channel may begin earlier
        self.newest = 0  # index behind the newest sample
        self._cutter = cutter
        self._rows = np.empty((0, n_columns))
        self._present = np.empty((0, n_columns), dtype=bool)
        self._statuses: list[tuple[int, int, BlockStatus]] = []  # first index, end, status reported

    def wait_until(self, end: int, clock: UnitClock) -> Iterator[AccelerationBlock]:
        """Samples have come up to an index: what lies too far behind it is waited for no longer."""
        self.newest = max(self.newest, end)
        yield from self._release(self.newest - self.wait, clock)

    def put(self, index: int, columns: list[int], samples: FloatArray, status: BlockStatus) -> bool:
        """Fill in samples; False where all of them were there already, or come too late."""
        skipped = max(0, self.base - index)
        samples = samples[skipped:]
        begin = index + skipped - self.base
        end = begin + len(samples)
        self._extend(end)
        window = np.ix_(range(begin, end), columns)
        absent = ~self._present[window]
        self._rows[window] = np.where(absent, samples, self._rows[window])
        self._present[window] = True
        if status:
            self._statuses.append((index, index + skipped + len(samples), status))
        return bool(absent.any())

    def complete(self, clock: UnitClock) -> Iterator[AccelerationBlock]:
        """What the rows complete that every channel has."""
        whole = np.asarray(self._present.all(axis=1))
        count = len(whole) if whole.all() else int(np.argmin(whole))
        yield from self._release(self.base + count, clock)

    def part(self, clock: UnitClock) -> Iterator[AccelerationBlock]:
        """The session is over: give everything."""
        yield from self._release(self.newest, clock)
        yield from self._cutter.part(clock.time_of, self._status)

    def _extend(self, end: int) -> None:
        missing = end - len(self._rows)
        if missing > 0:
            shape = (missing, self._rows.shape[1])
            self._rows = np.concatenate([self._rows, np.full(shape, np.nan)])
            self._present = np.concatenate([self._present, np.zeros(shape, dtype=bool)])

    def _release(self, until: int, clock: UnitClock) -> Iterator[AccelerationBlock]:
        count = min(until - self.base, len(self._rows))
        if count > 0:
            rows, self._rows = self._rows[:count], self._rows[count:]
            self._present = self._present[count:]
            yield from self._cutter.push(self.base, rows, clock.time_of, self._status)
        self.base = max(self.base, until)
        oldest = self.base - self._cutter.size  # the cutter holds less than a block
        self._statuses = [each for each in self._statuses if each[1] > oldest]

    def _status(self, first: int, end: int) -> BlockStatus:
        """What the instrument reported of rows."""
        said = BlockStatus.OK
        for begin, behind, status in self._statuses:
            if begin < end and behind > first:
                said |= status
        return said
