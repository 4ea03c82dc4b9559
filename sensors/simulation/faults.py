"""What goes wrong with instruments and links: a filter over blocks.

    blocks ──► channels: dead, stuck, clipped, swapped, … ──► clock ──► link: dropped, late, … ──►

A fault holds for a span of time and touches nothing outside it. The same seed gives the same
faults whatever the block size, but for those of the link, which happen to whole blocks.
"""

import heapq
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockStatus
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError
from sensors.simulation.acquisition_units import UnitSettings

FaultKind = Literal[
    "dead",  # the channel reads 0
    "stuck",  # the channel keeps the value that it had
    "clipped",  # the channel stops at ± size [m/s²]
    "swapped",  # the channel and `other` change places
    "duplicate",  # the channel carries what `other` measures
    "nan",  # one sample of the channel a second is no number
    "spikes",  # `size` [m/s²] on one sample of the channel a minute
    "drift",  # the channel drifts by `size` [m/s²] an hour
    "faulty",  # the unit itself reports a faulty channel
    "dropped",  # blocks are not sent
    "late",  # blocks arrive `size` [s] too late
    "repeated",  # blocks arrive twice
    "out-of-order",  # every other block arrives after its successor
    "clock-drift",  # time stamps run `size` [ppm] fast
    "clock-jitter",  # time stamps scatter by `size` [s] (std)
    "unsynchronised",  # the unit reports that it has lost its time reference
]
ON_CHANNEL = ("dead", "stuck", "clipped", "swapped", "duplicate", "nan", "spikes", "drift")
SIZED = ("clipped", "spikes", "drift", "late", "clock-drift", "clock-jitter")
_STATUS = {
    "clipped": BlockStatus.CLIPPED,
    "faulty": BlockStatus.SENSOR_FAULT,
    "unsynchronised": BlockStatus.CLOCK_UNSYNCHRONISED,
}
Samples = NDArray[np.float32]


class FaultError(InputError):
    """A fault that cannot be; the message names its kind and what is wrong."""


@dataclass(frozen=True, slots=True)
class Fault:
    """One thing that goes wrong for a while."""

    kind: FaultKind
    """What goes wrong, e.g. "dead", "clipped", "swapped", "dropped", "clock-drift"."""
    start: float
    """Start since the session's first sample, of every unit alike [s]."""

    duration: float
    """Duration [s]."""

    channel: str = ""
    """Name in the layout, where the fault is a channel's."""

    other: str = ""
    """The other channel, of the same unit, where two are concerned."""

    size: float = 0.0
    """Unit by kind, see `FaultKind`."""

    unit: str = ""
    """Acquisition unit of a fault that is no channel's; empty: every unit."""

    def __post_init__(self) -> None:
        where = f"fault {self.kind!r} at {self.start:g} s"
        if not (self.start >= 0 and self.duration > 0):
            raise FaultError(f"{where} lasts {self.duration:g} s; start is 0 or more, and it lasts")
        if (self.kind in ON_CHANNEL) != bool(self.channel):
            needs = "needs the name of a channel" if self.kind in ON_CHANNEL else "has no channel"
            raise FaultError(f"{where}: channel is {self.channel!r}; this kind {needs}")
        if (self.kind in ("swapped", "duplicate")) != bool(self.other):
            raise FaultError(f"{where}: other is {self.other!r}; swapped and duplicate need one")
        if self.kind in SIZED and not self.size > 0:
            raise FaultError(f"{where}: size is {self.size:g}; this kind needs a positive one")

    @property
    def end(self) -> float:
        """End of the fault [s]."""
        return self.start + self.duration


def with_faults(
    blocks: Iterable[AccelerationBlock],
    faults: tuple[Fault, ...],
    layouts: Sequence[SensorLayout],
    units: Sequence[UnitSettings] = (),
    *,
    rng: np.random.Generator,
) -> Iterator[AccelerationBlock]:
    """Yield the blocks of a tower's units as they arrive with faults, each unit in its turn.

    Parameters
    ----------
    blocks : iterable of AccelerationBlock
        Without faults.
    faults : tuple of Fault
        Of channels and units that the layouts have, see `require_known`.
    layouts : sequence of SensorLayout
        Of the units, one each.
    units : sequence of UnitSettings, optional
        When each unit takes its samples; those of a single one are the session's.
    rng : numpy.random.Generator
        Each unit draws from its own child where there are several.

    Yields
    ------
    AccelerationBlock
    """
    own_rngs = rng.spawn(len(layouts)) if len(layouts) > 1 else [rng]
    settings = {unit.name: unit for unit in units}
    faulty = {
        layout.unit: FaultyUnit(
            tuple(fault for fault in faults if _concerns(fault, layout)),
            layout.channel_names,
            settings.get(layout.unit),
            rng=own_rng,
        )
        for layout, own_rng in zip(layouts, own_rngs, strict=True)
    }
    for block in blocks:
        yield from faulty[block.unit].push(block)
    for unit in faulty.values():
        yield from unit.finish()


def require_known(faults: tuple[Fault, ...], layouts: Sequence[SensorLayout]) -> None:
    """Raise FaultError for a channel or a unit that no layout has, or channels of two units."""
    unit_of = {name: layout.unit for layout in layouts for name in layout.channel_names}
    units = [layout.unit for layout in layouts]
    for fault in faults:
        where = f"fault {fault.kind!r} at {fault.start:g} s"
        for name in (fault.channel, fault.other):
            if name and name not in unit_of:
                raise FaultError(f"{where}: no channel {name!r}; there are {', '.join(unit_of)}")
        if fault.unit and fault.unit not in units:
            raise FaultError(f"{where}: no unit {fault.unit!r}; there are {', '.join(units)}")
        if fault.other and unit_of[fault.channel] != unit_of[fault.other]:
            raise FaultError(
                f"{where}: channel {fault.channel!r} is of unit {unit_of[fault.channel]!r}, other "
                f"{fault.other!r} of {unit_of[fault.other]!r}; both are of one unit"
            )


def _concerns(fault: Fault, layout: SensorLayout) -> bool:
    if fault.channel:
        return fault.channel in layout.channel_names
    return fault.unit in ("", layout.unit)


class FaultyUnit:
    """One acquisition unit and its link, when things go wrong.

    Parameters
    ----------
    faults : tuple[Fault, ...]
        Faults of this unit.
    channel_names : tuple[str, ...]
        Channel names of its layout.
    unit : UnitSettings, optional
        When it takes its samples; None: as the session does.
    rng : numpy.random.Generator
        Rng of what is random in a fault.
    """

    def __init__(
        self,
        faults: tuple[Fault, ...],
        channel_names: tuple[str, ...],
        unit: UnitSettings | None = None,
        *,
        rng: np.random.Generator,
    ) -> None:
        self._faults = faults
        self._unit = unit
        self._index = {name: number for number, name in enumerate(channel_names)}
        self._rng = rng
        self._held: dict[Fault, np.float32] = {}  # value of a stuck channel
        self._link = FaultyLink(faults)

    def push(self, block: AccelerationBlock) -> Iterator[AccelerationBlock]:
        """Return what arrives by the time the next block of the session (in order) is measured."""
        instants = _instants(block, self._unit)
        return self._link.push(self._measured(block, instants), begin=float(instants[1]))

    def finish(self) -> Iterator[AccelerationBlock]:
        """Return what is still on its way."""
        return self._link.finish()

    def _measured(
        self, block: AccelerationBlock, instants: NDArray[np.float64]
    ) -> AccelerationBlock:
        """Return the block with what goes wrong inside the unit; instants as from `_instants`."""
        times = instants[1:]
        end = times[0] + block.duration
        present = [fault for fault in self._faults if fault.start < end and times[0] < fault.end]
        if not present:
            return block
        samples = block.samples.copy()
        status, stamp = block.status, 0.0
        for fault in present:
            inside = (times >= fault.start) & (times < fault.end)
            status |= _STATUS.get(fault.kind, BlockStatus.OK)
            if fault.kind in ON_CHANNEL and inside.any():
                self._spoil(samples, fault, inside, instants)
            elif fault.kind == "clock-drift":
                stamp += fault.size * 1e-6 * (times[0] - fault.start)
            elif fault.kind == "clock-jitter":
                stamp += fault.size * float(self._rng.standard_normal())
        start_ns = block.start_ns + round(stamp * NANOSECONDS)
        return replace(block, samples=samples, status=status, start_ns=start_ns)

    def _spoil(
        self,
        samples: Samples,
        fault: Fault,
        inside: NDArray[np.bool_],
        instants: NDArray[np.float64],
    ) -> None:
        """Write the fault into the samples of its channel; instants as from `_instants`."""
        own = samples[:, self._index[fault.channel]]
        match fault.kind:
            case "dead":
                own[inside] = 0.0
            case "stuck":
                own[inside] = self._held.setdefault(fault, own[inside][0])
            case "clipped":
                own[inside] = np.clip(own[inside], -fault.size, fault.size)
            case "swapped":
                other = samples[:, self._index[fault.other]]
                own[inside], other[inside] = other[inside], own[inside].copy()
            case "duplicate":
                own[inside] = samples[inside, self._index[fault.other]]
            case "nan":
                own[inside & _once_every(1.0, instants, fault)] = np.nan
            case "spikes":
                own[inside & _once_every(60.0, instants, fault)] += np.float32(fault.size)
            case "drift":
                drift = fault.size * (instants[1:][inside] - fault.start) / 3600.0
                own[inside] += drift.astype(np.float32)


def _instants(block: AccelerationBlock, unit: UnitSettings | None) -> NDArray[np.float64]:
    """Return times of the sample before the block and of its own, since the session's first [s]."""
    numbers = block.first_sample + np.arange(-1, len(block.samples))
    if unit is None:
        return numbers / block.sampling_rate
    return unit.times(numbers, block.sampling_rate)


def _once_every(period: float, times: NDArray[np.float64], fault: Fault) -> NDArray[np.bool_]:
    """Return which of evenly spaced instants begin a second or minute of the fault, (n,).

    Parameters
    ----------
    times : ndarray, shape (n + 1,)
        Times with one more in front [s].
    """
    number = np.floor((times - fault.start) / period + 1e-9)
    return np.diff(number) > 0


class FaultyLink:
    """Brings blocks in an order of its own, and leaves some out."""

    def __init__(self, faults: tuple[Fault, ...]) -> None:
        self._faults = faults
        self._count = 0
        # arrival [s], order, copy
        self._waiting: list[tuple[float, int, int, AccelerationBlock]] = []

    def push(self, block: AccelerationBlock, *, begin: float) -> Iterator[AccelerationBlock]:
        """Yield the blocks that arrive by the end of this one, which begins at `begin` [s]."""
        for copy, arrival in enumerate(_arrivals(block, begin, self._faults)):
            heapq.heappush(self._waiting, (arrival, self._count, copy, block))
        self._count += 1
        while self._waiting and self._waiting[0][0] <= begin + block.duration:
            yield heapq.heappop(self._waiting)[-1]

    def finish(self) -> Iterator[AccelerationBlock]:
        """Yield those that arrive after the last one's end."""
        while self._waiting:
            yield heapq.heappop(self._waiting)[-1]


def _arrivals(block: AccelerationBlock, begin: float, faults: tuple[Fault, ...]) -> list[float]:
    """When the block arrives, none to two times [s since the first sample]."""
    arrivals = [begin + block.duration]
    for fault in faults:
        if not fault.start <= begin < fault.end:
            continue
        match fault.kind:
            case "dropped":
                return []
            case "late":
                arrivals = [arrival + fault.size for arrival in arrivals]
            case "repeated":
                arrivals = [*arrivals, arrivals[0]]
            case "out-of-order" if block.sequence % 2 == 0:
                arrivals = [arrival + 1.5 * block.duration for arrival in arrivals]
    return arrivals
