"""AccelerationBlock: one block of one acquisition unit, all its channels on one clock."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from enum import IntFlag
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

NANOSECONDS = 1_000_000_000  # [ns/s]
BLOCK_DURATION = 1.0  # of the blocks that feeds and files are cut into [s]
RATE_TOLERANCE = 1e-3  # between two values of one sampling rate, stated or by stamps, relative
CLOCK_STEP = 0.5  # of the stamps against the sample count, beyond which the clock was set [s]
RESTART_SILENCE = 600.0  # a unit that was silent that long begins a new session [s]
EARLIEST_CLOCK_NS = 315_532_800 * NANOSECONDS  # 1980-01-01; earlier times have no clock


class BlockStatus(IntFlag):
    """What the acquisition unit reports about its own block; 0 is healthy."""

    OK = 0
    CLIPPED = 1  # at least one sample at the end of the converter's range
    CLOCK_UNSYNCHRONISED = 2  # the unit has lost its time reference
    SENSOR_FAULT = 4  # at least one channel reports a fault


@dataclass(frozen=True, slots=True, eq=False)
class AccelerationBlock:
    """Consecutive samples of all channels of one acquisition unit.

    Sample i of the block was taken at `start_ns + i / sampling_rate`; it is sample
    `first_sample + i` of the session. A session starts whenever the unit starts.
    """

    turbine: str
    """Turbine id."""
    unit: str
    """Acquisition unit id."""
    session: str
    """Session id: one per start of the unit."""
    layout_id: str
    """SensorLayout that defines what each channel is."""
    sequence: int
    """Blocks since the session's start, from 0."""
    first_sample: int
    """Samples since the session's start, from 0."""
    start_ns: int
    """Sensor clock at the first sample [ns since 1970-01-01 UTC]."""
    sampling_rate: float
    """Sampling rate [Hz]."""
    samples: NDArray[np.float32]
    """(n_samples, n_channels) [m/s²], channel order of the layout."""
    status: BlockStatus = BlockStatus.OK

    @property
    def duration(self) -> float:
        """Time that the block covers [s]."""
        return len(self.samples) / self.sampling_rate

    @property
    def next_sample(self) -> int:
        """One after the block's last."""
        return self.first_sample + len(self.samples)

    @property
    def end_ns(self) -> int:
        """Sensor clock one sample after the last [ns]: the next block's `start_ns`."""
        return self.start_ns + round(self.duration * NANOSECONDS)


def parts_of(block: AccelerationBlock, most_samples: int) -> Iterable[AccelerationBlock]:
    """Return a block in parts of so many samples at most, each with the block's number.

    Parameters
    ----------
    most_samples : int
        At least 1.
    """
    if len(block.samples) <= most_samples:
        return (block,)
    return (
        replace(
            block,
            samples=block.samples[first : first + most_samples],
            first_sample=block.first_sample + first,
            start_ns=block.start_ns + round(first / block.sampling_rate * NANOSECONDS),
        )
        for first in range(0, len(block.samples), most_samples)
    )


@dataclass(frozen=True, slots=True)
class BlockMark:
    """A block without its samples."""

    session: str
    sequence: int
    first_sample: int
    n_samples: int
    start_ns: int
    sampling_rate: float
    """[Hz]"""
    n_channels: int

    @classmethod
    def of(cls, block: AccelerationBlock) -> "BlockMark":
        """Return the mark of a block."""
        return cls(
            block.session,
            block.sequence,
            block.first_sample,
            len(block.samples),
            block.start_ns,
            block.sampling_rate,
            block.samples.shape[1],
        )

    @property
    def next_sample(self) -> int:
        """One after the block's last."""
        return self.first_sample + self.n_samples

    @property
    def end_ns(self) -> int:
        """Stamp one sample after the block's last [ns]."""
        return self.start_ns + round(self.n_samples / self.sampling_rate * NANOSECONDS)


class Sampled(Protocol):
    """Samples of one boot of a unit: a block, its mark, a stretch of a file."""

    @property
    def first_sample(self) -> int:
        """Since the boot's start."""
        ...

    @property
    def start_ns(self) -> int:
        """Stamp of the first sample [ns since 1970-01-01 UTC]."""
        ...

    @property
    def sampling_rate(self) -> float:
        """[Hz]"""
        ...


def time_apart(before: Sampled, after: Sampled) -> tuple[float, float]:
    """Return the time between two first samples by their count and by their stamps [s]."""
    counted = (after.first_sample - before.first_sample) / before.sampling_rate
    return counted, (after.start_ns - before.start_ns) / NANOSECONDS


def has_clock(time_ns: int) -> bool:
    """Return whether a time is one of a clock, not counted from the start of a recording."""
    return time_ns >= EARLIEST_CLOCK_NS
