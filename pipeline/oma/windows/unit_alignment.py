"""Several acquisition units of one turbine, joined on one clock.

unit A   |0   |1   |2   |3   |      its own samples, its own stamps, its own rate
unit B    |0   |1   |▒▒▒▒|3   |
             │ sensor time by the stamps, drift taken out
joined   |0   |1   |2   |3   |      all channels on one grid; B's are NaN in block 2

Decisions depend on the blocks alone, never on when they arrived: a grid block is given when every
unit covers it, or when one is `lateness` beyond it and the others are given up.
"""

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.windows.unit_clock import CLOCK_ERROR
from pipeline.oma.windows.windowing import MissingSamples
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import SensorLayout, joined_layout
from sensors.acquisition.resampling import HALF_LENGTH, interpolated
from sensors.arrays import FloatArray

FITTED_STAMPS = 120  # blocks whose stamps a unit's clock is fitted to: the newest
FEWEST_FOR_RATE = 10  # below them the nominal rate is taken
GRID_BLOCK = 1.0  # of the joined stream [s]
LONGEST_HELD = 10_000  # missing samples that are laid out; after more of them a unit starts again
RATES_APART = 100.0  # between units that are joined, at most: what reading one on the other costs
BELOW_GRID = 2.0  # times that the rate of a unit that comes later may be below the grid's
MOST_SESSIONS = 8  # boots of a unit whose samples are held
REMEMBERED_BEGINNINGS = 10_000  # grid blocks whose beginnings are known in the units' own counts


@dataclass(frozen=True, slots=True)
class ClockLine:
    """A unit's sample numbers as a line over sensor time."""

    stamps: list[tuple[int, int]]
    """First sample and start [ns] of the blocks that it is fitted to."""
    rate: float
    """[Hz]"""
    origin: float
    """Sample number at the last of the stamps."""

    def positions(self, times_ns: NDArray[np.int64]) -> FloatArray:
        """Sample numbers at sensor times."""
        return np.asarray(self.origin + self.rate * ((times_ns - self.stamps[-1][1]) / NANOSECONDS))


class UnitStream:
    """The samples of one session of one unit, and its clock by the stamps."""

    def __init__(self, first: AccelerationBlock, n_channels: int) -> None:
        self.session = first.session
        self.sampling_rate = first.sampling_rate  # nominal [Hz]
        self.start_ns = first.start_ns
        self.newest_ns = first.end_ns  # end of the newest block, by its stamp [ns]
        self.first_sample = first.first_sample
        self.block_length = len(first.samples)
        self._samples = np.empty((0, n_channels))
        self._held_from = first.first_sample  # index of the first sample held
        self._stamps: list[tuple[int, int]] = []  # first sample, start [ns] of each block held
        self._status: list[tuple[int, int, BlockStatus]] = []  # start, end [ns]
        self._line: ClockLine | None = None  # the last one that was asked for

    def push(self, piece: AccelerationBlock | MissingSamples) -> None:
        """The next piece in order; missing samples are held as NaN."""
        if isinstance(piece, MissingSamples):
            missing = np.full((piece.n_samples, self._samples.shape[1]), np.nan)
            self._samples = np.concatenate([self._samples, missing])
            return
        self._samples = np.concatenate([self._samples, piece.samples.astype(np.float64)])
        self._stamps.append((piece.first_sample, piece.start_ns))
        self._status.append((piece.start_ns, piece.end_ns, piece.status))
        self.newest_ns = max(self.newest_ns, piece.end_ns)

    def covers(self, time_ns: int) -> bool:
        """Whether everything that a sample at that time is read from is here."""
        (position,) = self._positions(np.array([time_ns]), until_ns=time_ns)
        return bool(position + HALF_LENGTH <= self._held_from + len(self._samples) - 1)

    def read(self, times_ns: NDArray[np.int64], sampling_rate: float) -> FloatArray:
        """(m, n_channels) at those times on a clock of that rate [Hz]; NaN where there is none."""
        positions = self._positions(times_ns, until_ns=int(times_ns[-1])) - self._held_from
        inside = (positions >= -0.5) & (positions <= len(self._samples) - 0.5)
        readings = np.full((len(times_ns), self._samples.shape[1]), np.nan)
        if inside.any():
            within = np.clip(positions[inside], 0, len(self._samples) - 1)
            band = sampling_rate / self.sampling_rate
            readings[inside] = interpolated(self._samples, within, band=band)
        return readings

    def status(self, start_ns: int, end_ns: int) -> BlockStatus:
        """What the unit reported of its blocks in a span of time."""
        said = BlockStatus.OK
        for start, end, status in self._status:
            if start < end_ns and end > start_ns:
                said |= status
        return said

    def forget_before(self, time_ns: int) -> None:
        """Let go of samples and stamps that nothing later is read from."""
        (position,) = self._positions(np.array([time_ns]), until_ns=time_ns)
        unneeded = min(int(position) - self._held_from - 4 * HALF_LENGTH, len(self._samples))
        if unneeded > 0:
            self._samples = self._samples[unneeded:]
            self._held_from += unneeded
        behind = sum(start <= time_ns for _, start in self._stamps) - FITTED_STAMPS
        del self._stamps[: max(0, behind)]
        self._status = [each for each in self._status if each[1] > time_ns]

    def position_at(self, time_ns: int) -> float:
        """Sample number at a sensor time."""
        (position,) = self._positions(np.array([time_ns]), until_ns=time_ns)
        return float(position)

    def samples_from(self, time_ns: int) -> int | None:
        """Time of its earliest samples from a time on, by the stamps [ns]; None: it has none."""
        return min(
            (max(start, time_ns) for start, end, _ in self._status if end > time_ns), default=None
        )

    def _positions(self, times_ns: NDArray[np.int64], *, until_ns: int) -> FloatArray:
        """Sample numbers at sensor times, by a line through the stamps of the blocks up to a time.

        Why a line: single stamps scatter; the line's slope is the converter's true rate, so that
        its drift is taken out.
        """
        known = [stamp for stamp in self._stamps if stamp[1] <= until_ns][-FITTED_STAMPS:]
        known = known or self._stamps[:1]
        if self._line is None or self._line.stamps != known:
            self._line = self._fitted(known)
        return self._line.positions(times_ns)

    def _fitted(self, known: list[tuple[int, int]]) -> "ClockLine":
        numbers, stamps = np.array(known).T
        seconds = (stamps - stamps[-1]) / NANOSECONDS
        counted = (numbers - numbers[-1]).astype(float)
        rate = self._true_rate(seconds, counted)
        origin = float(np.mean(counted - rate * seconds))
        return ClockLine(known, rate, numbers[-1] + origin)

    def _true_rate(self, seconds: FloatArray, counted: FloatArray) -> float:
        """The converter's rate by least squares [Hz]; the nominal one where no stamps show it."""
        steps = seconds - seconds.mean()
        if len(seconds) < FEWEST_FOR_RATE or not steps.any():
            return self.sampling_rate
        rate = float(steps @ counted / (steps @ steps))
        plausible = abs(rate / self.sampling_rate - 1.0) <= CLOCK_ERROR
        return rate if plausible else self.sampling_rate


class UnitJoiner:
    """Puts the channels of a turbine's units side by side on one clock.

    Parameters
    ----------
    layouts : sequence of SensorLayout
        Of the units, in the order of their channels.
    lateness : float
        How long a unit that has nothing to say is waited for, in sensor time [s].

    Notes
    -----
    The grid has the lowest of the units' sampling rates. It begins with the unit that starts last,
    or with the first where another is more than `lateness` later. What no unit was there for is
    passed over in one step: the work is bounded by the samples that came, not by the time between.
    """

    def __init__(self, layouts: Sequence[SensorLayout], lateness: float) -> None:
        self.layout = joined_layout(layouts)
        self._units = tuple(layout.unit for layout in layouts)
        self._n_channels = {layout.unit: len(layout.channels) for layout in layouts}
        self._lateness_ns = round(lateness * NANOSECONDS)
        self._streams: dict[str, list[UnitStream]] = {unit: [] for unit in self._units}
        self._away: set[str] = set()  # units whose next block is a beginning
        self._origin_ns: int | None = None  # of the grid; None before it is settled
        self._rate = 0.0  # of the grid [Hz]
        self._session = ""
        self._next = 0  # grid samples given or known to be missing
        self._sequence = 0
        self._refilling = False  # after a restart: samples before the grid fit the units' clocks
        # first grid sample of a block given, and where that is in each unit's count
        self._beginnings: deque[tuple[int, dict[str, float]]] = deque(maxlen=REMEMBERED_BEGINNINGS)

    def restart(self, unit: str) -> None:
        """The unit's next block begins a boot, or follows a time in which it was left out."""
        self._away.add(unit)

    def resume(self, origin_ns: int, sampling_rate: float, session: str, next_sample: int) -> None:
        """Go on with the grid of a joiner that has ended, from one of its samples on."""
        self._origin_ns, self._rate, self._session = origin_ns, sampling_rate, session
        self._next = next_sample
        self._refilling = True
        self._sequence = next_sample // max(1, round(GRID_BLOCK * sampling_rate))

    @property
    def grid(self) -> tuple[int, float, str] | None:
        """Origin [ns], sampling rate [Hz] and session of the grid; None before it is settled."""
        if self._origin_ns is None:
            return None
        return self._origin_ns, self._rate, self._session

    @property
    def now_ns(self) -> int | None:
        """Time of the next grid sample [ns]; None before the grid is settled."""
        return None if self._origin_ns is None else int(self._grid(1)[0])

    def is_past(self, block: AccelerationBlock) -> bool:
        """Whether nothing will be read from a block: the grid is beyond it."""
        return self._is_past(block)

    def beginnings(self, sample: int) -> dict[str, int]:
        """First samples of the units, each in its own count, at a grid sample."""
        before = [each for each in self._beginnings if each[0] <= sample]
        if not before:
            return {}
        given, positions = before[-1]
        rates = {unit: s[-1].sampling_rate / self._rate for unit, s in self._streams.items() if s}
        return {
            unit: max(0, round(position + (sample - given) * rates.get(unit, 1.0)))
            for unit, position in positions.items()
        }

    def origins(self, sample: int) -> dict[str, int]:
        """First samples of the units that are there at a grid sample; none where it was passed
        over, whatever was there before: a restart does not know."""
        size = max(1, round(GRID_BLOCK * self._rate))
        given = any(first <= sample < first + size for first, _ in self._beginnings)
        return self.beginnings(sample) if given else {}

    def has(self, unit: str, since: float) -> bool:
        """Whether a unit has samples on the grid where a time since its beginning lies [s]."""
        return bool(self._rate) and unit in self.beginnings(round(since * self._rate))

    def needed(self, unit: str, since: float) -> int | None:
        """First sample of a unit that the grid from `since` [s] on is read from, with the stamps
        that its clock's line is fitted to; None of a unit that has no samples here."""
        streams = self._streams[unit]
        if not streams:
            return None
        begins = self.beginnings(round(since * self._rate)) if self._rate else {}
        if unit not in begins:
            return streams[-1].first_sample
        margin = FITTED_STAMPS * streams[-1].block_length + 4 * HALF_LENGTH
        return max(streams[-1].first_sample, begins[unit] - margin)

    def columns(self, unit: str) -> list[int]:
        """Which of the joined channels are a unit's."""
        before = self._units.index(unit)
        first = sum(self._n_channels[each] for each in self._units[:before])
        return list(range(first, first + self._n_channels[unit]))

    @property
    def units(self) -> tuple[str, ...]:
        """Names of the units, in the order of their channels."""
        return self._units

    def refusal(self, block: AccelerationBlock) -> str:
        """Why a block of one of the units cannot be joined with the others'; "" where it can."""
        lowest, highest = self._joinable_rates()
        if lowest <= block.sampling_rate <= highest:
            return ""
        return (
            f"{block.sampling_rate:g} Hz, which cannot be joined with the other units' samples: "
            f"that takes {lowest:.3g} to {highest:.3g} Hz"
        )

    def _joinable_rates(self) -> tuple[float, float]:
        """[Hz]"""
        if self._origin_ns is not None:
            return self._rate / BELOW_GRID, self._rate * RATES_APART
        rates = [s[-1].sampling_rate for s in self._streams.values() if s]
        return max(rates, default=0.0) / RATES_APART, min(rates, default=np.inf) * RATES_APART

    def push(
        self, block: AccelerationBlock, pieces: Sequence[AccelerationBlock | MissingSamples]
    ) -> Iterator[AccelerationBlock | MissingSamples]:
        """What one unit's block has put in order; gives the grid blocks that are now complete."""
        streams = self._streams[block.unit]
        for piece in pieces:
            if isinstance(piece, MissingSamples):
                if piece.n_samples > LONGEST_HELD:
                    self._away.add(block.unit)
                elif streams:  # what is missing before the first block never was
                    streams[-1].push(piece)
                continue
            if self._is_past(piece):
                self._away.add(block.unit)
                continue
            if not streams or block.unit in self._away or streams[-1].session != piece.session:
                streams.append(UnitStream(piece, self._n_channels[block.unit]))
                self._away.discard(block.unit)
                del streams[:-MOST_SESSIONS]
            streams[-1].push(piece)
        yield from self._ready(give_up=False)

    def finish(self) -> Iterator[AccelerationBlock | MissingSamples]:
        """Nothing more will come: give what there is."""
        yield from self._ready(give_up=True)

    def _is_past(self, piece: AccelerationBlock) -> bool:
        """Whether nothing will ever be read from a piece: the grid is well beyond it."""
        if self._origin_ns is None or self._refilling:
            return False
        reach = 4 * HALF_LENGTH / min(piece.sampling_rate, self._rate)
        return piece.end_ns + round(reach * NANOSECONDS) < int(self._grid(1)[0])

    def _ready(self, *, give_up: bool) -> Iterator[AccelerationBlock | MissingSamples]:
        newest = max((s[-1].newest_ns for s in self._streams.values() if s), default=None)
        if newest is None:
            return
        if self._origin_ns is None and not self._settled(newest, give_up=give_up):
            return
        while True:
            size = max(1, round(GRID_BLOCK * self._rate))
            empty = self._empty_blocks(size, newest)
            if empty > 1:
                yield self._passed_over(empty, size)
            times = self._grid(size)
            if give_up:
                times = times[times < newest]
            if not len(times) or not (give_up or self._complete(int(times[-1]), newest)):
                return
            yield self._given(times)

    def _settled(self, newest: int, *, give_up: bool) -> bool:
        """Whether the grid's origin and rate are known by now; sets them."""
        begun = [streams[0] for streams in self._streams.values() if streams]
        first = min(stream.start_ns for stream in begun)
        waited = newest - first > self._lateness_ns
        if len(begun) < len(self._units) and not (waited or give_up):
            return False
        starts = [s.start_ns for s in begun if s.start_ns - first <= self._lateness_ns]
        self._origin_ns = max(starts)
        self._rate = min(stream.sampling_rate for stream in begun)
        self._session = min(begun, key=lambda stream: stream.start_ns).session
        return True

    def _grid(self, n_samples: int) -> NDArray[np.int64]:
        assert self._origin_ns is not None
        numbers = self._next + np.arange(n_samples)
        return self._origin_ns + np.round(numbers * (NANOSECONDS / self._rate)).astype(np.int64)

    def _complete(self, last_ns: int, newest: int) -> bool:
        """Whether a grid block up to that time can be given, or its units be given up."""
        if all(streams and streams[-1].covers(last_ns) for streams in self._streams.values()):
            return True
        return newest - last_ns > self._lateness_ns + round(HALF_LENGTH / self._rate * NANOSECONDS)

    def _empty_blocks(self, size: int, newest: int) -> int:
        """Grid blocks from the next one on that no unit has samples for, nor will be waited for."""
        now_ns = int(self._grid(1)[0])
        waited_ns = self._lateness_ns + round(HALF_LENGTH / self._rate * NANOSECONDS)
        ahead = [s.samples_from(now_ns) for streams in self._streams.values() for s in streams]
        until_ns = min([newest - waited_ns, *(each for each in ahead if each is not None)])
        return int((until_ns - now_ns) / NANOSECONDS * self._rate) // size - 1  # stamps scatter

    def _positions_of(self, time_ns: int) -> dict[str, float]:
        """Of units that have samples then, each in its own count."""
        return {
            unit: streams[-1].position_at(time_ns)
            for unit, streams in self._streams.items()
            if streams and streams[-1].start_ns <= time_ns < streams[-1].newest_ns
        }

    def _passed_over(self, n_blocks: int, size: int) -> MissingSamples:
        first, start_ns = self._next, int(self._grid(1)[0])
        sequence, self._sequence = self._sequence, self._sequence + n_blocks
        self._next += n_blocks * size
        end_ns = int(self._grid(1)[0])
        for streams in self._streams.values():
            for stream in streams:
                stream.forget_before(end_ns)
        return MissingSamples(first, n_blocks * size, sequence, n_blocks, start_ns, end_ns)

    def _given(self, times: NDArray[np.int64]) -> AccelerationBlock | MissingSamples:
        samples = np.hstack([self._read(unit, times) for unit in self._units])
        self._beginnings.append((self._next, self._positions_of(int(times[0]))))
        self._refilling = False
        first, start_ns = self._next, int(times[0])
        end_ns = int(self._grid(len(times) + 1)[-1])
        self._next += len(times)
        sequence, self._sequence = self._sequence, self._sequence + 1
        status = BlockStatus.OK
        for streams in self._streams.values():
            for stream in streams:
                status |= stream.status(start_ns, end_ns)
                stream.forget_before(start_ns)
        if np.isnan(samples).all():
            return MissingSamples(first, len(times), sequence, 1, start_ns, end_ns)
        return AccelerationBlock(
            turbine=self.layout.turbine,
            unit=self.layout.unit,
            session=self._session,
            layout_id=self.layout.layout_id,
            sequence=sequence,
            first_sample=first,
            start_ns=start_ns,
            sampling_rate=self._rate,
            samples=samples.astype(np.float32),
            status=status,
        )

    def _read(self, unit: str, times: NDArray[np.int64]) -> FloatArray:
        """A unit's channels on the grid, from whichever of its sessions was running then."""
        readings = np.full((len(times), self._n_channels[unit]), np.nan)
        streams = self._streams[unit]
        for stream in streams:
            found = stream.read(times, self._rate)
            readings = np.where(np.isnan(readings), found, readings)
        while len(streams) > 1 and streams[1].start_ns < times[0]:
            del streams[0]  # a session that ended before
        return readings
