"""Files of measurements → AccelerationBlocks, as an acquisition unit would have sent them.

file 1  |‾‾‾‾‾‾‾‾‾‾‾|           chunks with their stamps
file 2                  |‾‾‾‾|  in order of time, never two at once
          │ BlockCutter
blocks  |0|1|2|3|4|5|   |9|10|  a second each; a gap ends one, numbers go on behind it
"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np

from sensors.acquisition.blocks import (
    BLOCK_DURATION,
    NANOSECONDS,
    RATE_TOLERANCE,
    RESTART_SILENCE,
    AccelerationBlock,
)
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, IntArray
from sensors.files.formats import read_chunks
from sensors.files.table import EVERYTHING, ChannelTable, FileError, Wanted
from sensors.files.text.columns import log_once
from sensors.files.text.dates import offset_name, repeated_after_ns
from sensors.files.text.preamble import start_in_name

GAP = 0.5  # a clock that is so far behind for good has lost a sample [samples]
FIRST_DAY_NS = 86_400 * NANOSECONDS  # of 1970: times in it count from a file's start [ns]
LATE_STAMPS = 16  # so many stamps in a row may be late without a sample being lost


@dataclass(frozen=True, slots=True, eq=False)
class StampedSamples:
    """Some consecutive samples of a measurement and when each was taken."""

    times_ns: IntArray
    """Time of each sample, (n,) [ns since 1970-01-01 UTC], rising."""

    samples: FloatArray
    """Samples, (n, n_channels)."""


@dataclass(frozen=True, slots=True)
class MeasurementFile:
    """One file and what its beginning states."""

    path: Path
    reader: str | None
    """package.module:function of its reader; None: the one of its suffix."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    sampling_rate: float | None
    """Sampling rate [Hz]; None: the file does not state it."""

    start_ns: int
    """Time of the first sample [ns since 1970-01-01 UTC]; 0: neither file nor name state it."""

    wanted: Wanted = EVERYTHING

    def chunks(self) -> Iterator[ChannelTable]:
        """Yield the samples, channels in the order of `names`."""
        for read in read_chunks(self.path, self.reader, self.wanted):
            chunk = read if read.start_ns else replace(read, start_ns=self.start_ns)
            if chunk.names == self.names:
                yield chunk
            else:
                columns = [chunk.names.index(name) for name in self.names]
                yield replace(chunk, names=self.names, samples=chunk.samples[:, columns])


def open_file(
    path: Path, reader: str | None = None, wanted: Wanted = EVERYTHING
) -> tuple[MeasurementFile, ChannelTable]:
    """Return a file and its first chunk.

    Parameters
    ----------
    path : Path
        Of the file.
    reader : str, optional
        "package.module:function" that gives SEP005 channels; None: the one of its suffix
        (`read_chunks`).
    wanted : Wanted, optional
        What of it is read; everything by default.

    Raises
    ------
    FileError
        If the file cannot be read, or has no samples.
    """
    first = next(read_chunks(path, reader, wanted), None)
    if first is None:
        raise FileError(f"{path}: 0 samples; at least two are needed")
    start_ns = first.start_ns or start_in_name(path.stem, wanted.time)
    if start_ns != first.start_ns:
        log_once("the date and time in a file's name are taken for its start: the file has none")
    known = first.names, first.units, first.sampling_rate, start_ns
    return MeasurementFile(path, reader, *known, wanted), first


def sort_by_time(files: Sequence[MeasurementFile]) -> list[MeasurementFile]:
    """Files that begin one after the other, with the same channels at the same rate.

    Raises
    ------
    FileError
        For one of several that does not state when it begins, or differs from the first.
    """
    if len(files) == 1:
        return list(files)
    for file in files:
        if not file.start_ns and not file.wanted.stamps:
            raise FileError(
                f"{file.path}: the samples of all files are counted, as some time stamps repeat or "
                "go back, and its name does not say when it begins (mast_20250301_000230.csv)"
            )
        if not file.start_ns:
            raise FileError(
                f"{file.path} does not say when it begins; several files are joined by the date "
                "and time in them or in their names (mast_20250301_000230.csv)"
            )
    ordered = sorted(files, key=lambda file: file.start_ns)
    return [ordered[0], *(_like(ordered[0], other) for other in ordered[1:])]


def _like(first: MeasurementFile, other: MeasurementFile) -> MeasurementFile:
    """Return the other file with its channels in the first one's order."""
    units = dict(zip(other.names, other.units, strict=True))
    if units != dict(zip(first.names, first.units, strict=True)):
        raise FileError(
            f"{other.path} has the channels {_titled(other)}, {first.path} {_titled(first)}; files "
            "of one measurement have the same"
        )
    rates = first.sampling_rate, other.sampling_rate
    if rates[0] and rates[1] and abs(rates[1] / rates[0] - 1) > RATE_TOLERANCE:
        raise FileError(
            f"{other.path} is sampled at {rates[1]:g} Hz, {first.path} at {rates[0]:g} Hz; files "
            "of one measurement have the same rate"
        )
    return replace(other, names=first.names, units=first.units)


def _titled(file: MeasurementFile) -> str:
    titles = zip(file.names, file.units, strict=True)
    return ", ".join(f"{name} [{unit}]" if unit else name for name, unit in titles)


def stamp_samples(
    files: Sequence[MeasurementFile], chunks: Iterable[tuple[int, ChannelTable]], rate: float
) -> Iterator[StampedSamples]:
    """Yield the chunks with every sample's time; rows without any number are left out as missing.

    Parameters
    ----------
    files : Sequence[MeasurementFile]
        Files in order of time.
    chunks : Iterable[tuple[int, ChannelTable]]
        Chunks of all of them, each with the number of its file.
    rate : float
        Rate [Hz], of what has no stamps.

    Raises
    ------
    FileError
        If time stands still or goes back, within a file or from one to the next.
    """
    counted, current, last_ns, last_file = 0, -1, None, 0
    before: StampedSamples | None = None
    for number, chunk in chunks:
        counted = counted if number == current else 0
        current = number
        times = chunk.times
        if times is None:
            times = (counted + np.arange(len(chunk.samples))) / rate
        counted += len(chunk.samples)
        times_ns = chunk.start_ns + np.round(times * NANOSECONDS).astype(np.int64)
        if times_ns[0] < 0:
            raise FileError(
                f"{files[number].path} begins at {moment(int(times_ns[0]))}, before 1970: its "
                "clock was not set"
            )
        if last_ns is not None and times_ns[0] <= last_ns and number != last_file:
            again = _repeated(before, times_ns, chunk.samples, 0.5 / rate)
            if not again:
                raise FileError(
                    f"{files[number].path} begins at {moment(int(times_ns[0]))}, before "
                    f"{files[last_file].path} ends at {moment(last_ns)}, with other samples; files "
                    f"must not overlap{_repeated_hour(files[number])}"
                )
            count = "sample" if again == 1 else f"{again} samples"
            log_once(
                f"{files[number].path} begins with the last {count} of {files[last_file].path}, "
                "taken once"
            )
            times_ns, chunk = times_ns[again:], replace(chunk, samples=chunk.samples[again:])
            if not len(times_ns):
                continue
        steps = np.diff(times_ns, prepend=times_ns[0] - 1 if last_ns is None else last_ns)
        if (steps <= 0).any():
            raise FileError(
                f"{files[number].path}: time stands still or goes back at "
                f"{moment(int(times_ns[np.argmax(steps <= 0)]))}; --sampling-rate HZ counts the "
                "samples instead"
            )
        last_ns, last_file = int(times_ns[-1]), number
        present = ~np.isnan(chunk.samples).all(axis=1)
        before = StampedSamples(times_ns, chunk.samples)
        if present.any():
            yield StampedSamples(times_ns[present], chunk.samples[present])


def _repeated(
    before: StampedSamples | None, times_ns: IntArray, samples: FloatArray, near: float
) -> int:
    """Return how many samples at a file's start end the file before; 0 where one of them differs.

    Parameters
    ----------
    before : StampedSamples, optional
        What came last of the file before.
    times_ns, samples : ndarray, shape (n,) and (n, n_channels)
        What comes first of the file.
    near : float
        Stamps of one sample may be so far apart [s].
    """
    if before is None:
        return 0
    count = int(np.searchsorted(times_ns, before.times_ns[-1] + near * NANOSECONDS))
    if count > len(before.times_ns):
        return 0
    stamps, values = before.times_ns[-count:], before.samples[-count:]
    together = (np.abs(times_ns[:count] - stamps) < near * NANOSECONDS).all()
    return count if together and np.array_equal(samples[:count], values, equal_nan=True) else 0


def _repeated_hour(file: MeasurementFile) -> str:
    """Return what an overlap may come from, where a local clock shows the file's start twice."""
    zone = file.wanted.time.zone
    first_ns = file.start_ns - NANOSECONDS * 3600 * file.wanted.time.second_hour
    later_ns = repeated_after_ns(first_ns, zone)
    if not later_ns:
        return ""
    first, second = offset_name(first_ns, zone), offset_name(first_ns + later_ns, zone)
    return (
        f". Summer time of {zone} ends in that night, and an hour of local time comes twice: "
        f"import the files before the clock went back with --zone {first}, the others apart with "
        f"--zone {second}"
    )


def moment(time_ns: int) -> str:
    """Return a time in words: "2024-03-01 12:00:00.250" (UTC); of a count from 0 "1000.050 s"."""
    if abs(time_ns) < FIRST_DAY_NS:
        return f"{time_ns / NANOSECONDS:.3f} s"
    seconds, rest = divmod(time_ns, NANOSECONDS)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%d %H:%M:%S}.{rest // 1_000_000:03d}"


class BlockCutter:
    """Cuts stamped samples into blocks of a second.

    Parameters
    ----------
    layout : SensorLayout
        Layout of the channels.
    sampling_rate : float
        Sampling rate [Hz].

    Notes
    -----
    A gap is where the stamps leap ahead of an even clock for good: by half a sample or more, for
    longer than some late stamps in a row. It ends a block; the sample and block numbers behind it
    count what is missing. After a silence of ten minutes a new session begins.
    """

    def __init__(self, layout: SensorLayout, sampling_rate: float) -> None:
        self._layout = layout
        self._rate = sampling_rate
        self._size = max(1, round(BLOCK_DURATION * sampling_rate))
        self._held: StampedSamples | None = None  # not yet in a block
        self._session = ""
        self._first_sample = 0  # of what is held
        self._sequence = 0
        self._end_ns: int | None = None  # one sample after the last one given [ns]

    def push(self, chunk: StampedSamples) -> Iterator[AccelerationBlock]:
        """Take more samples; give the blocks that are complete."""
        self._held = chunk if self._held is None else _join(self._held, chunk)
        yield from self._cut(final=False)

    def finish(self) -> Iterator[AccelerationBlock]:
        """Nothing more will come: give what is left."""
        yield from self._cut(final=True)

    def _cut(self, *, final: bool) -> Iterator[AccelerationBlock]:
        held = self._held
        if held is None or not len(held.times_ns):
            return
        times_ns, lost = self._even(held.times_ns)
        sure = len(times_ns) if final else len(times_ns) - LATE_STAMPS
        edges = [0, *np.flatnonzero(lost[1:]) + 1, len(times_ns)]
        done = 0
        for begin, end in pairwise(edges):
            if begin >= sure:
                break
            if lost[begin]:
                self._skip(int(lost[begin]))
            complete = (
                end if end < sure or final else begin + (sure - begin) // self._size * self._size
            )
            for first in range(begin, complete, self._size):
                last = min(first + self._size, complete)
                yield self._block(int(times_ns[first]), held.samples[first:last])
            done = complete
            if complete < end:
                break
        self._held = StampedSamples(held.times_ns[done:], held.samples[done:])
        if final:
            self._held = None

    def _even(self, times_ns: IntArray) -> tuple[IntArray, IntArray]:
        """Return the samples' times by a clock that late stamps do not move, (n,) [ns].

        The second array, (n,), counts the samples that are lost before each.
        """
        expected = times_ns[0] if self._end_ns is None else self._end_ns
        ahead = (times_ns - expected) * (self._rate / NANOSECONDS) - np.arange(len(times_ns))
        padded = np.append(ahead, np.full(LATE_STAMPS - 1, np.inf))
        settled = np.lib.stride_tricks.sliding_window_view(padded, LATE_STAMPS).min(axis=1)
        leaps = np.diff(settled, prepend=0.0)
        lost = np.where(leaps > GAP, np.maximum(1, np.round(leaps)), 0).astype(np.int64)
        late = np.round((ahead - settled) * (NANOSECONDS / self._rate)).astype(np.int64)
        return times_ns - late, lost

    def _skip(self, lost: int) -> None:
        if lost / self._rate > RESTART_SILENCE:
            self._session = ""
        elif lost:
            self._first_sample += lost
            self._sequence += max(1, round(lost / self._size))

    def _block(self, start_ns: int, samples: FloatArray) -> AccelerationBlock:
        if not self._session:
            seconds = datetime.fromtimestamp(start_ns / NANOSECONDS, UTC)
            self._session = f"{seconds:%Y%m%dT%H%M%SZ}"
            self._first_sample = self._sequence = 0
        block = AccelerationBlock(
            turbine=self._layout.turbine,
            unit=self._layout.unit,
            session=self._session,
            layout_id=self._layout.layout_id,
            sequence=self._sequence,
            first_sample=self._first_sample,
            start_ns=max(0, start_ns),  # a first stamp of 0 may be late
            sampling_rate=self._rate,
            samples=samples.astype(np.float32),
        )
        self._sequence += 1
        self._first_sample += len(samples)
        self._end_ns = block.end_ns
        return block


def _join(a: StampedSamples, b: StampedSamples) -> StampedSamples:
    return StampedSamples(
        np.concatenate([a.times_ns, b.times_ns]), np.concatenate([a.samples, b.samples])
    )
