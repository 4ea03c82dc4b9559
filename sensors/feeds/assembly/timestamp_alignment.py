"""Where on a unit's clock each message belongs, and which stamps are believed.

A stamp that leaps is believed when the two behind it agree: one wild stamp costs its own message
and nothing else. A leap ahead is a gap; a clock that is set (back, by more than ten minutes, or
while the numbers go on) begins another session.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from sensors.acquisition.blocks import (
    CLOCK_STEP,
    NANOSECONDS,
    RESTART_SILENCE,
    AccelerationBlock,
    BlockStatus,
)
from sensors.arrays import FloatArray
from sensors.bounded_dict import BoundedDict
from sensors.feeds.assembly.block_builder import RowCutter, SessionNames
from sensors.feeds.assembly.channel_map import LayoutColumns
from sensors.feeds.assembly.channel_source import ChannelSources
from sensors.feeds.assembly.clock_estimate import UnitClock
from sensors.feeds.protocol import ChannelSamples, FeedCounts

AGREEING_LEAPS = 3  # messages in a row whose stamps leap to the same place
JITTER = 0.5  # of a stamp [samples]
FEW_SAMPLES = 64  # samples, before which the first stamp's own jitter is still in the clock


class WaitingRows:
    """The newest rows of one session, by index on its clock: they wait for all channels' samples.

    Parameters
    ----------
    cutter : RowCutter
        Takes the rows that are done.
    n_columns : int
        Of a row.
    wait : int
        For a channel that is late [samples].
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
        """Yield what the rows complete that every channel has."""
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
        """Return what the instrument reported of rows."""
        reported = BlockStatus.OK
        for begin, behind, status in self._statuses:
            if begin < end and behind > first:
                reported |= status
        return reported


@dataclass(slots=True)
class _Stream:
    """One succession of stamps."""

    next: int | None = None  # index behind its last sample; None before the first of a session
    last_ns: int = 0  # its last stamp [ns]
    held: list[ChannelSamples] = field(default_factory=list)  # whose stamps leap
    interrupted: bool = False  # what came after its last sample was dropped

    def continues(self, piece: ChannelSamples) -> bool:
        """Whether a piece lies directly behind the last sample that has a place, by its number.

        A number follows that of the last message that came, which may wait or have been dropped.
        """
        placed = self.next is not None and not self.held and not self.interrupted
        return placed and bool(piece.follows)


class TimestampAligner:
    """Puts the messages of one unit where they belong.

    Parameters
    ----------
    first : ChannelSamples
        The first message: index 0 is its first sample.
    columns : LayoutColumns
        Of the channels.
    counts : FeedCounts
        Takes what is late, duplicate or wild.
    rate : float
        [Hz].
    size : int
        Of a block [samples].
    wait : float
        For a channel that is late [s of sensor time].
    sessions : SessionNames
        Names the sessions.
    """

    def __init__(
        self,
        first: ChannelSamples,
        columns: LayoutColumns,
        counts: FeedCounts,
        *,
        rate: float,
        size: int,
        wait: float,
        sessions: SessionNames,
    ) -> None:
        self._columns, self._counts = columns, counts
        self._rate, self._wait = rate, round(wait * rate)
        self._cutter = RowCutter(columns.layout, rate, size, sessions)
        self._streams: BoundedDict[str, _Stream] = BoundedDict()
        self._owners = ChannelSources()
        self._begin(first)

    @property
    def missing_blocks(self) -> int:
        """Blocks that the gaps so far cost."""
        return self._cutter.missing_blocks

    def knows(self, stream: str) -> bool:
        """Whether samples of a topic or a sender were taken."""
        return stream in self._streams

    def push(self, piece: ChannelSamples) -> Iterator[AccelerationBlock]:
        """Take what a message brought; give the blocks that it completes."""
        refusal = self._owners.refusal(piece)
        if refusal:
            self._counts.refuse(refusal)
            self.interrupt(piece.stream)
            return
        stream = self._stream(piece.stream)
        if self._fits(piece, stream):
            self._drop_held(stream)
            yield from self._place(piece, stream)
            return
        if stream.held and not self._agree(stream.held[-1], piece):
            self._drop_held(stream)
        stream.held.append(piece)
        if len(stream.held) >= AGREEING_LEAPS:
            yield from self._believe(stream)

    def _stream(self, name: str) -> _Stream:
        stream = self._streams.renewed(name)
        if stream is None:
            stream = _Stream()
            forgotten = self._streams.put(name, stream)
            if forgotten is not None:
                self._drop_held(forgotten)
        return stream

    def interrupt(self, name: str) -> None:
        """A message of a stream was dropped: the next one's number says no place."""
        stream = self._streams.get(name)
        if stream is not None:
            stream.interrupted = True

    def finish(self) -> Iterator[AccelerationBlock]:
        """Nothing more will come: give what is left."""
        for stream in self._streams.values():
            self._drop_held(stream)
        yield from self._rows.part(self._clock)

    def _begin(self, first: ChannelSamples) -> None:
        """The clock of a session."""
        self._clock = UnitClock(first.start_ns, self._rate)
        wait = max(self._wait, 2 * len(first.samples))
        self._rows = WaitingRows(self._cutter, len(self._columns), wait)
        for stream in self._streams.values():
            stream.next = None

    def _fits(self, piece: ChannelSamples, stream: _Stream) -> bool:
        """Whether a piece can belong where its stamp puts it."""
        if piece.follows and stream.held and self._agree(stream.held[-1], piece):
            return False  # it goes on where that one leapt to
        position = self._clock.position(piece.start_ns)
        if stream.next is not None and stream.continues(piece):
            return abs(position - stream.next) <= CLOCK_STEP * self._rate
        rows = self._rows
        return position <= rows.newest + rows.wait and position + len(piece.samples) > rows.base

    def _agree(self, last: ChannelSamples, piece: ChannelSamples) -> bool:
        """Whether the stamps of two pieces can be of one clock."""
        apart = (piece.start_ns - last.start_ns) * self._rate / NANOSECONDS - len(last.samples)
        if piece.follows:
            return abs(apart) <= CLOCK_STEP * self._rate
        return -2 * JITTER <= apart <= self._rows.wait

    def _place(self, piece: ChannelSamples, stream: _Stream) -> Iterator[AccelerationBlock]:
        index = self._index_of(piece, stream)
        columns, samples = self._columns.of(piece)
        end = index + len(samples)
        self._rows.wait = max(self._rows.wait, 2 * len(samples))
        yield from self._rows.wait_until(end, self._clock)
        stream.next = end if stream.next is None else max(end, stream.next)
        stream.interrupted = False
        if not self._rows.put(index, columns, samples, piece.status):
            self._counts.duplicate += 1
            return
        stream.last_ns = piece.start_ns
        self._clock.follow(index, piece.start_ns, len(samples))
        yield from self._rows.complete(self._clock)

    def _index_of(self, piece: ChannelSamples, stream: _Stream) -> int:
        """Index of a piece's first sample: behind the stream's last one unless its stamp is too
        far from there, else where the stamp puts it."""
        position = self._clock.position(piece.start_ns)
        if stream.next is None or piece.start_ns == stream.last_ns:
            return round(position)
        near = JITTER if stream.next > FEW_SAMPLES else 2 * JITTER - 0.05
        behind = stream.continues(piece) or abs(position - stream.next) <= near
        return stream.next if behind else round(position)

    def _believe(self, stream: _Stream) -> Iterator[AccelerationBlock]:
        """What the stamps of a stream have leapt to is so."""
        first = stream.held[0]
        ahead = self._clock.position(first.start_ns) - self._rows.newest
        if first.follows or not 0 < ahead <= RESTART_SILENCE * self._rate:
            yield from self._rows.part(self._clock)
            self._begin(first)
        else:
            yield from self._rows.wait_until(self._rows.newest + int(ahead), self._clock)
        held = [piece for each in self._streams.values() for piece in each.held]
        for each in self._streams.values():
            each.held = []
        for piece in sorted(held, key=lambda piece: piece.start_ns):  # all that leapt there fit now
            yield from self.push(piece)

    def _drop_held(self, stream: _Stream) -> None:
        """What did not fit came late, or its stamp was wild."""
        for piece in stream.held:
            if self._clock.position(piece.start_ns) < self._rows.newest:
                self._counts.late += 1
            else:
                self._counts.refuse(f"{piece.stream}: a stamp far ahead of those around it")
            stream.interrupted = True
        stream.held = []
