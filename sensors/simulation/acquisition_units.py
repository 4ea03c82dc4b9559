"""Several acquisition units on one tower: each its own channels, clock and blocks."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.key_parts import named_key_part_error
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.resampling import HALF_LENGTH, interpolated
from sensors.arrays import FloatArray
from sensors.errors import InputError


class UnitError(InputError):
    """Acquisition units that cannot be; the message names the unit."""


@dataclass(frozen=True, slots=True)
class UnitSettings:
    """One acquisition unit of several."""

    name: str
    """Becomes part of its key."""

    elevations: tuple[float, ...]
    """Heights of the accelerometers that it reads [m]."""

    start: float = 0.0
    """Start of its first sample after the others' [s]."""

    clock_offset: float = 0.0
    """Its time stamps are that much late [s]."""

    clock_drift: float = 0.0
    """Its converter is that much fast; its time stamps are right [ppm]."""

    def __post_init__(self) -> None:
        wrong = named_key_part_error(self.name)
        if not wrong and "+" in self.name:
            wrong = "a name without + is needed, which joins the names of units"
        if wrong:
            raise UnitError(f"unit name is {self.name!r}: {wrong}")
        if not self.elevations:
            raise UnitError(f"unit {self.name}: elevations is []; it reads at least one height")
        if not self.start >= 0:
            raise UnitError(f"unit {self.name}: start is {self.start:g} s; it must be 0 or more")

    def times(self, numbers: NDArray[np.integer], rate: float) -> FloatArray:
        """Return when its samples are taken, since the session's first [s].

        Parameters
        ----------
        numbers : ndarray of int, shape (n,)
            Of the samples, from 0 at the unit's first.
        rate : float
            Nominal sampling rate [Hz].
        """
        return self.start + numbers / (rate * (1 + 1e-6 * self.clock_drift))


def unit_layouts(layout: SensorLayout, units: tuple[UnitSettings, ...]) -> tuple[SensorLayout, ...]:
    """Return the part of a layout that each unit reads; the whole where there are no units.

    Raises
    ------
    UnitError
        If a height is read by no unit, or by more than one, or has no sensor.
    """
    if not units:
        return (layout,)
    heights = sorted({channel.elevation for channel in layout.channels})
    for unit in units:
        for elevation in unit.elevations:
            if elevation not in heights:
                raise UnitError(
                    f"unit {unit.name}: elevations has {elevation:g} m, where no sensor is; there "
                    f"are sensors at {', '.join(f'{height:g}' for height in heights)} m"
                )
    for elevation in heights:
        readers = [unit.name for unit in units if elevation in unit.elevations]
        if len(readers) != 1:
            raise UnitError(
                f"the sensors at {elevation:g} m are read by {' and '.join(readers) or 'no unit'}; "
                "each height belongs to one unit"
            )
    return tuple(
        replace(
            layout,
            layout_id=f"{layout.layout_id}-{unit.name}",
            unit=unit.name,
            channels=tuple(c for c in layout.channels if c.elevation in unit.elevations),
        )
        for unit in units
    )


def read_by_units(
    blocks: Iterable[AccelerationBlock], layout: SensorLayout, units: tuple[UnitSettings, ...]
) -> Iterator[AccelerationBlock]:
    """Yield the blocks of a whole tower as its units give them, each as soon as it is complete."""
    readers = [
        _Reader(unit, part, layout)
        for unit, part in zip(units, unit_layouts(layout, units), strict=True)
    ]
    for block in blocks:
        for reader in readers:
            yield from reader.push(block)
    for reader in readers:
        yield from reader.finish()


class _Reader:
    """One unit's converter: sample m is taken at start + m / (rate (1 + drift))."""

    def __init__(self, unit: UnitSettings, part: SensorLayout, whole: SensorLayout) -> None:
        self._unit, self._layout = unit, part
        self._columns = [whole.channel_names.index(name) for name in part.channel_names]
        self._held: NDArray[np.float32] | None = None  # samples of the tower still needed
        self._held_from = 0  # index of the first of them since the session's start
        self._sequence = 0
        self._size = 0  # samples in a block
        self._latest: AccelerationBlock | None = None
        self._origin_ns = 0  # true time of the session's first sample

    def push(self, block: AccelerationBlock) -> Iterator[AccelerationBlock]:
        own = block.samples[:, self._columns]
        if self._held is None:
            self._origin_ns, self._held, self._size = block.start_ns, own, len(own)
        else:
            self._held = np.concatenate([self._held, own])
        self._latest = block
        yield from self._complete(margin=HALF_LENGTH)

    def finish(self) -> Iterator[AccelerationBlock]:
        yield from self._complete(margin=0)

    def _complete(self, *, margin: int) -> Iterator[AccelerationBlock]:
        block, held = self._latest, self._held
        if block is None or held is None:
            return
        rate, unit = block.sampling_rate, self._unit
        while True:
            first = self._sequence * self._size
            numbers = first + np.arange(self._size)
            times = unit.times(numbers, rate)
            positions = times * rate - self._held_from
            if positions[-1] > len(held) - 1 - margin:
                break
            stamp = self._origin_ns + round((times[0] + unit.clock_offset) * NANOSECONDS)
            yield replace(
                block,
                unit=unit.name,
                layout_id=self._layout.layout_id,
                sequence=self._sequence,
                first_sample=first,
                start_ns=stamp,
                samples=interpolated(held.astype(np.float64), positions).astype(np.float32),
            )
            self._sequence += 1
        unneeded = min(len(held), max(0, int(positions[0]) - 2 * HALF_LENGTH))
        self._held, self._held_from = held[unneeded:], self._held_from + unneeded
