"""From blocks as they arrive to windows of samples on sensor time.

blocks   0 1 2 4 3 5 6 6 7 9 …       out of order, repeated, missing
  │ BlockOrder
pieces   0 1 2 3 4 5 6 7 ▒ 9 …       in order, each sample once, gaps known
  │ WindowCutter
windows  |—— 0 ——|—— 1 ——|—▒ 2 ——|   from the session's first sample; the third is rejected

A window lasts as long by the stamps as it should. Where they show a converter that is off, it has
more samples or fewer, which are read at the instants at which a true one takes them.
"""

import math
from collections import Counter, deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.preprocessing import MOST_MISSING
from pipeline.oma.windows.unit_clock import (
    CLOCK_ERROR,
    ClockFit,
    ClockStep,
    at_nominal_rate,
    clock_step,
    fit_clock,
    stamp_of,
)
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.arrays import FloatArray

MOST_SINGLE_REJECTIONS = 100  # of windows in one gap; of more, one rejection stands for many
GIVEN_UP_KEPT = 1000  # of a session's gaps, the latest: what they lack is late when it comes


@dataclass(frozen=True, slots=True)
class MissingSamples:
    """Samples of a session that never came."""

    first_sample: int
    """The first missing one, since the session's start."""
    n_samples: int
    first_sequence: int
    """Of the missing blocks."""
    n_blocks: int
    start_ns: int
    """Sensor clock where they begin [ns]."""
    end_ns: int
    """Sensor clock where samples resume [ns]."""


@dataclass(frozen=True, slots=True)
class Beginning:
    """Where a stream of blocks is expected to begin in its unit's counts."""

    first_sample: int = 0
    """Since the unit's start."""
    sequence: int = 0
    """Of its block."""
    refused: int = 0
    """First blocks that have come and are not used: recorded, and not missing."""


class BlockOrder:
    """Puts the blocks of one session in order: waits a little for a late one, drops repeats.

    Parameters
    ----------
    lateness : float
        How long a late block is waited for, in sensor time [s].
    beginning : Beginning, optional
        Where the session begins.
    unused : collections.Counter, optional
        Counts the blocks that came after they had been given up, "late", and those that came twice,
        "duplicate", as after a restart, when they are sent again.

    Notes
    -----
    Decisions depend on the blocks alone, never on when they arrived: a missing block is given up
    when one that begins more than `lateness` after it has come.
    """

    def __init__(
        self,
        lateness: float,
        beginning: Beginning = Beginning(),
        unused: Counter[str] | None = None,
    ):
        self._lateness = lateness  # [s] of sensor time
        self._beginning = beginning
        self._waiting: dict[int, AccelerationBlock] = {}  # by first_sample
        self._last: AccelerationBlock | None = None
        self._next_sample = beginning.first_sample
        self._given_up: deque[MissingSamples] = deque(maxlen=GIVEN_UP_KEPT)
        self.unused: Counter[str] = Counter() if unused is None else unused

    def push(self, block: AccelerationBlock) -> Iterator[AccelerationBlock | MissingSamples]:
        """Take one block as it arrives; give what is now in order."""
        if block.first_sample < self._next_sample:
            self._count_unusable(block)
            return
        if block.first_sample in self._waiting:
            self.unused["duplicate"] += 1
            return
        self._waiting[block.first_sample] = block
        yield from self._released(give_up=False)

    def flush(self) -> Iterator[AccelerationBlock | MissingSamples]:
        """Nothing more will come: give what still waits, with its gaps."""
        yield from self._released(give_up=True)

    def _count_unusable(self, block: AccelerationBlock) -> None:
        late = any(
            gap.first_sample <= block.first_sample < gap.first_sample + gap.n_samples
            for gap in self._given_up
        )
        self.unused["late" if late else "duplicate"] += 1

    def _released(self, *, give_up: bool) -> Iterator[AccelerationBlock | MissingSamples]:
        while self._waiting:
            following = self._waiting[min(self._waiting)]
            if following.first_sample > self._next_sample:
                newest = max(self._waiting)
                waited = (newest - self._next_sample) / following.sampling_rate
                if waited <= self._lateness and not give_up:
                    return
                gap = self._missing_before(following)
                self._given_up.append(gap)
                yield gap
            self._last = self._waiting.pop(following.first_sample)
            self._next_sample = self._last.next_sample
            yield self._last

    def _missing_before(self, block: AccelerationBlock) -> MissingSamples:
        n_samples = block.first_sample - self._next_sample
        begins = self._beginning.sequence + self._beginning.refused
        first_sequence = self._last.sequence + 1 if self._last else begins
        duration_ns = round(n_samples / block.sampling_rate * NANOSECONDS)
        return MissingSamples(
            first_sample=self._next_sample,
            n_samples=n_samples,
            first_sequence=first_sequence,
            n_blocks=max(0, block.sequence - first_sequence),
            start_ns=max(0, block.start_ns - duration_ns),
            end_ns=block.start_ns,
        )


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """One window of a session: all its samples, or why it has none to identify."""

    index: int
    """Windows since the session's start, from 0."""
    start_ns: int
    """Sensor clock at its first sample [ns]."""
    end_ns: int
    """One sample after its last [ns]."""
    sampling_rate: float
    """Sampling rate [Hz]."""
    layout_id: str
    samples: FloatArray
    """(n, n_channels) [m/s²], at the nominal rate: a drift that the stamps show is taken out. NaN
    in a gap; empty where more than 5 % is missing."""
    gaps: tuple[MissingSamples, ...]
    """That fall into it."""
    status: BlockStatus
    """What the unit reported in any of its blocks."""
    complete: bool
    """False: the session ended inside it."""
    first_sample: int
    """Since the unit's start."""
    steps: tuple[ClockStep, ...]
    """Of the unit's stamps inside the window."""
    clock: ClockFit | None
    """Of the stamps inside the window; None: too few."""
    passed_over: int
    """Windows right before it that are not cut: all lie in the same gap."""

    @property
    def duration(self) -> float:
        """[s]"""
        return (self.end_ns - self.start_ns) / NANOSECONDS


@dataclass(slots=True)
class _Piece:
    first_sample: int
    start_ns: int
    samples: NDArray[np.float32]
    status: BlockStatus

    @property
    def end(self) -> int:
        return self.first_sample + len(self.samples)


@dataclass(slots=True, eq=False)
class WindowCutter:
    """Cuts one session's ordered blocks into windows of equal length, a hop apart."""

    window_duration: float
    """Length of a window [s]."""
    hop: float
    """Time from one window's start to the next one's [s]."""
    _pieces: list[_Piece] = field(default_factory=list)
    _gaps: list[MissingSamples] = field(default_factory=list)
    _steps: list[ClockStep] = field(default_factory=list)
    _index: int = 0  # of the next window
    _passed_over: int = 0  # windows before it that are not cut
    _shift: int = 0  # by which a converter's drift has moved its first sample
    _used: int = 0  # one past the last sample of the window before it
    _reached: int = 0  # samples since the session's start that came or are known to be missing
    _newest: AccelerationBlock | None = None

    def push(self, piece: AccelerationBlock | MissingSamples) -> Iterator[Window]:
        """Take the next block or gap in order; give the windows it completes."""
        if isinstance(piece, MissingSamples):
            self._gaps.append(piece)
            return  # the block after the gap follows at once and closes the windows
        self._note_step(piece)
        self._newest = piece
        self._skip_to(piece.first_sample)
        self._pieces.append(_Piece(piece.first_sample, piece.start_ns, piece.samples, piece.status))
        self._reached = self._pieces[-1].end
        while self._reached >= self._bounds(self._index)[1] and self._reached >= self._end():
            yield self._cut(complete=True)

    @property
    def next_index(self) -> int:
        """Number of the next window."""
        return self._index

    @property
    def shift(self) -> int:
        """By how many samples the next window begins later than the nominal rate has it."""
        return self._shift

    def begin_at(self, index: int) -> None:
        """Begin with window `index`, those before having been answered."""
        self._index = index

    def _note_step(self, block: AccelerationBlock) -> None:
        if self._newest is None:
            return
        step = clock_step(stamp_of(self._newest), stamp_of(block), block.sampling_rate)
        if step:
            self._steps.append(ClockStep(block.first_sample, step))

    def _skip_to(self, sample: int) -> None:
        """After a gap of very many windows, go to the last that lies in it: it stands for all."""
        assert self._newest is not None
        hop = self.hop * self._newest.sampling_rate
        overlapping = math.ceil(self.window_duration / self.hop)
        reached = math.floor((sample - self._shift) / hop) - overlapping
        if reached - self._index > MOST_SINGLE_REJECTIONS:
            self._passed_over += reached - self._index
            self._index = reached

    def finish(self) -> Iterator[Window]:
        """The session is over: the window it ended in, if it holds samples that no other had."""
        if self._newest is None:
            return
        used = self._used or (self._bounds(self._index - 1)[1] if self._index else 0)
        if self._reached > used:
            yield self._cut(complete=self._lacks_drift_alone())

    def _lacks_drift_alone(self) -> bool:
        """Whether the last window would be whole if its converter took as many samples as it says,
        and lacks no more than a clock may be off by."""
        _, end = self._bounds(self._index)
        lacking = self._end() - self._reached
        return self._reached >= end - self._shift and lacking <= CLOCK_ERROR * self._size

    @property
    def _size(self) -> int:
        """Samples of a window at the nominal rate."""
        assert self._newest is not None
        return round(self.window_duration * self._newest.sampling_rate)

    def _bounds(self, index: int) -> tuple[int, int]:
        """First sample of a window and one past its last, where the rate is the nominal one."""
        assert self._newest is not None
        first = round(index * self.hop * self._newest.sampling_rate) + self._shift
        return first, first + self._size

    def _clock(self) -> ClockFit | None:
        """Of the next window's stamps; None where they are few or step."""
        assert self._newest is not None
        first, end = self._bounds(self._index)
        if any(first < step.first_sample < end for step in self._steps):
            return None
        inside = [p for p in self._pieces if p.end > first and p.first_sample < end]
        stamps = [(piece.first_sample, piece.start_ns) for piece in inside]
        return fit_clock(stamps, self._newest.sampling_rate)

    def _end(self) -> int:
        """One past the last sample that the next window is read from."""
        first, end = self._bounds(self._index)
        ratio = _rate_ratio(self._clock())
        return end if ratio == 1.0 else first + math.ceil((self._size - 1) * ratio) + 1

    def _cut(self, *, complete: bool) -> Window:
        assert self._newest is not None
        clock = self._clock()
        first, end = self._bounds(self._index)[0], min(self._end(), self._reached)
        inside = [p for p in self._pieces if p.end > first and p.first_sample < end]
        gaps = [
            g for g in self._gaps if g.first_sample + g.n_samples > first and g.first_sample < end
        ]
        status = BlockStatus.OK
        for piece in inside:
            status |= piece.status
        steps = tuple(s for s in self._steps if first < s.first_sample < end)
        start_ns = self._time_of(first)
        rate = self._newest.sampling_rate
        end_ns = start_ns + round((end - first) / rate * NANOSECONDS)
        samples = _joined(inside, first, end, self._newest.samples.shape[1])
        window = Window(
            index=self._index,
            start_ns=start_ns,
            # a step inside has no say in how long the window is
            end_ns=end_ns if steps else self._time_of(end, of=end - 1),
            sampling_rate=rate,
            layout_id=self._newest.layout_id,
            samples=at_nominal_rate(samples, _rate_ratio(clock))[: self._size],
            gaps=tuple(gaps),
            status=status,
            complete=complete,
            first_sample=first,
            steps=steps,
            clock=clock,
            passed_over=self._passed_over,
        )
        self._index, self._passed_over, self._used = self._index + 1, 0, end
        self._shift += round((_rate_ratio(clock) - 1.0) * self.hop * rate)
        self._forget_before(self._bounds(self._index)[0])
        return window

    def _time_of(self, sample: int, *, of: int | None = None) -> int:
        """Sensor time of a sample, from the nearest piece at or before it, or before `of` [ns]."""
        assert self._newest is not None
        last = sample if of is None else of
        before = [p for p in self._pieces if p.first_sample <= last] or self._pieces[:1]
        offset = (sample - before[-1].first_sample) / self._newest.sampling_rate
        return max(0, before[-1].start_ns + round(offset * NANOSECONDS))

    def _forget_before(self, sample: int) -> None:
        """One piece before the next window stays, for its time."""
        while len(self._pieces) > 1 and self._pieces[1].first_sample <= sample:
            del self._pieces[0]
        self._gaps = [g for g in self._gaps if g.first_sample + g.n_samples > sample]
        self._steps = [s for s in self._steps if s.first_sample > sample]


def _rate_ratio(clock: ClockFit | None) -> float:
    """True sampling rate over the nominal one [-]; 1 where a clock is too wrong to go by."""
    return 1.0 if clock is None or clock.exceeds(CLOCK_ERROR) else clock.true_rate


def _joined(pieces: list[_Piece], first: int, end: int, n_channels: int) -> FloatArray:
    """Samples of a window, NaN where they are missing; empty where too many are."""
    samples = np.full((end - first, n_channels), np.nan)
    for piece in pieces:
        part = piece.samples[max(0, first - piece.first_sample) : end - piece.first_sample]
        begin = max(0, piece.first_sample - first)
        samples[begin : begin + len(part)] = part
    n_came = sum(min(piece.end, end) - max(piece.first_sample, first) for piece in pieces)
    too_many = n_came < (1 - MOST_MISSING) * len(samples)
    return np.empty((0, 0)) if too_many else samples
