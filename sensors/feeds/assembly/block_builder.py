"""Rows of samples in order → AccelerationBlocks.

rows     ▮▮▮▮▮▮▮▮▮▯▯▯▯▮▮▮▮▮▮▮▮     ▯ no channel has a sample
blocks   |0   |1   |    |3   |4   |   of a second; a gap ends one, numbers go on behind it
"""

from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from itertools import pairwise

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray


class SessionNames:
    """Names of a unit's sessions by when they begin, each given once, however clocks are set."""

    def __init__(self) -> None:
        self._latest = ""
        self._count = 0

    def next(self, start_ns: int) -> str:
        """Return the name of the session that begins at a moment [ns]."""
        self._count += 1
        name = f"{datetime.fromtimestamp(start_ns // NANOSECONDS, UTC):%Y%m%dT%H%M%SZ}"
        if name <= self._latest:  # the clock was set back
            return f"{name}-{self._count}"
        self._latest = name
        return name


class RowCutter:
    """Cuts the rows of one unit into blocks.

    Parameters
    ----------
    layout : SensorLayout
        Of the columns.
    sampling_rate : float
        [Hz].
    size : int
        Of a block [samples].
    sessions : SessionNames
        Names the sessions.

    Notes
    -----
    `part` ends the session: the next row begins another one.
    """

    def __init__(
        self, layout: SensorLayout, sampling_rate: float, size: int, sessions: SessionNames
    ) -> None:
        self._layout = layout
        self._rate = sampling_rate
        self.size = size
        self._held = np.empty((0, len(layout.channels)))  # not yet in a block
        self._begin = 0  # index of the first row held
        self._session = ""
        self._sessions = sessions
        self._origin = 0  # index of the session's first row
        self._sequence = 0  # of the next block
        self.missing_blocks = 0  # that the gaps of all sessions cost, in lengths of a block

    def push(
        self,
        first: int,
        rows: FloatArray,
        time_of: Callable[[int], int],
        status_of: Callable[[int, int], BlockStatus] = lambda *_: BlockStatus.OK,
    ) -> Iterator[AccelerationBlock]:
        """Take more rows; give the blocks that are complete.

        Parameters
        ----------
        first : int
            Index of the first row, never below one given before.
        rows : ndarray, shape (n, n_channels)
            NaN where a channel has no sample; in the channels' units.
        time_of : callable
            Index → time of the row [ns].
        status_of : callable, optional
            First and end index → what the instrument reported of the rows; OK by default.
        """
        present = np.asarray(~np.isnan(rows).all(axis=1))
        edges = [0, *np.flatnonzero(np.diff(present)) + 1, len(rows)]
        for begin, end in pairwise(edges):
            if end > begin and present[begin]:
                yield from self._run(first + begin, rows[begin:end], time_of, status_of)

    def part(
        self,
        time_of: Callable[[int], int],
        status_of: Callable[[int, int], BlockStatus] = lambda *_: BlockStatus.OK,
    ) -> Iterator[AccelerationBlock]:
        """Give what is left; the session is over."""
        if len(self._held):
            yield self._block(len(self._held), time_of, status_of)
        self._session = ""

    def _run(
        self,
        begin: int,
        rows: FloatArray,
        time_of: Callable[[int], int],
        status_of: Callable[[int, int], BlockStatus],
    ) -> Iterator[AccelerationBlock]:
        """Rows without a gap."""
        lost = begin - (self._begin + len(self._held))
        if self._session and lost:
            if len(self._held):
                yield self._block(len(self._held), time_of, status_of)
            missing = max(1, round(lost / self.size))
            self._sequence += missing
            self.missing_blocks += missing
        if not self._session:
            self._start_session(begin, time_of(begin))
        if not len(self._held):
            self._begin = begin
        self._held = np.concatenate([self._held, rows])
        while len(self._held) >= self.size:
            yield self._block(self.size, time_of, status_of)

    def _start_session(self, begin: int, start_ns: int) -> None:
        self._session = self._sessions.next(start_ns)
        self._origin, self._sequence = begin, 0

    def _block(
        self,
        size: int,
        time_of: Callable[[int], int],
        status_of: Callable[[int, int], BlockStatus],
    ) -> AccelerationBlock:
        begin = self._begin
        block = AccelerationBlock(
            turbine=self._layout.turbine,
            unit=self._layout.unit,
            session=self._session,
            layout_id=self._layout.layout_id,
            sequence=self._sequence,
            first_sample=begin - self._origin,
            start_ns=max(0, time_of(begin)),
            sampling_rate=self._rate,
            samples=self._held[:size].astype(np.float32),
            status=status_of(begin, begin + size),
        )
        self._held = self._held[size:]
        self._begin += size
        self._sequence += 1
        return block
