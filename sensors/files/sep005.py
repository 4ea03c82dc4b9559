"""SEP005: how programs of structural dynamics hand on a measured channel → ChannelTable.

A channel is a dictionary; a file is a list of them. Source: SDyPy enhancement proposal 5, "A
unified timeseries model", https://github.com/sdypy (its checker: the package sdypy-sep005).
"""

import re
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NotRequired, TypedDict

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.files.table import (
    EVERYTHING,
    ChannelTable,
    FileError,
    Quantity,
    TimeColumn,
    Wanted,
    in_standard_unit,
    zone_named,
)
from sensors.files.text.column_titles import distinct
from sensors.files.text.columns import leave_out_infinite, log_once, said_of_renamed
from sensors.files.text.dates import MONTHS, zone_in_title
from sensors.files.text.time_column import ABSOLUTE, ClockError, TextClock, iso

FEWEST_OF_RAMP = 10  # samples from which an even rise is no chance
TOGETHER = 0.05  # channels whose samples lie less apart are sampled together [samples]
MOST_PADDED = 100  # times the samples that a file has: more is a wrong start, and no gap [-]

_QUANTITIES: dict[str, Quantity] = {
    "a": "acceleration",
    "v": "velocity",
    "d": "displacement",
    "e": "displacement",  # strain
}


class Sep005Channel(TypedDict):
    """One measured channel as SEP005 has it. With neither `fs` nor `time` its rate is unknown."""

    data: Any
    """Data, (n,) samples."""

    name: str
    unit_str: str
    fs: NotRequired[float | None]
    """Sampling rate [Hz]."""

    time: NotRequired[Any]
    """Time, (n,) [s]: since `start_timestamp` where there is one."""

    start_timestamp: NotRequired[str | datetime | None]
    """Start timestamp of the first sample, ISO 8601; UTC."""

    quantity: NotRequired[str | None]
    """What is measured: "a", "v", "d" or "e" (strain)."""

    aside: NotRequired[bool]
    """Whether it is beside the measurement, in another number of samples: it is read where it is
    wanted by name. No part of SEP005."""


def join_channels(
    channels: Sequence[Sep005Channel], path: Path, wanted: Wanted = EVERYTHING
) -> ChannelTable:
    """Return the channels of one file side by side.

    Parameters
    ----------
    channels : sequence of Sep005Channel
        Of the file.
    path : Path
        Of the file, for messages.
    wanted : Wanted, optional
        Names, time and stamps that are read; everything by default.

    Raises
    ------
    FileError
        No channel; data that are no series of numbers; channels that differ in rate, in their
        time vectors, or by a part of a sample.

    Notes
    -----
    Channels of one rate that begin or end at different times are put on one clock, NaN where one
    has nothing; where none has anything, there is a gap in `times`.
    """
    if not channels:
        raise FileError(f"{path}: there is no channel of numbers in it")
    channels = _with_names(channels, path)
    if not _are_among(wanted, channels):
        channels = _without_aside(channels, path, wanted)
    if wanted.time.column and wanted.stamps:
        channels = _with_time(channels, wanted.time, path)
    if not wanted.names:
        channels = _without_ramps(channels, path)
    chosen = wanted.among([channel["name"] for channel in channels])
    channels = [channels[i] if wanted.stamps else _without_clock(channels[i]) for i in chosen]
    channels = [_dated(channel, path, wanted.time.zone) for channel in channels]
    columns = [_samples(channel, path) for channel in channels]
    times, start_ns, samples = _on_one_clock(channels, columns, path)
    rate = channels[0].get("fs")
    units, factors = zip(
        *(in_standard_unit(str(channel.get("unit_str") or "")) for channel in channels),
        strict=True,
    )
    with np.errstate(over="ignore"):  # becomes infinite, and is named as such
        scaled = samples * np.array(factors)
    table = ChannelTable(
        names=tuple(channel["name"] for channel in channels),
        units=units,
        samples=scaled,
        times=times,
        start_ns=start_ns,
        stated_rate=None if rate is None else float(rate),
        stated_quantities=tuple(_QUANTITIES.get(str(each.get("quantity"))) for each in channels),
    )
    leave_out_infinite(table, path)
    return table


def _with_names(channels: Sequence[Sep005Channel], path: Path) -> list[Sep005Channel]:
    """Return the channels of a whole file by names that differ, whichever of them are read."""
    given = [str(channel.get("name") or "") for channel in channels]
    names = distinct(given)
    sentence = said_of_renamed(given, names, path, "channel")
    if sentence:
        log_once(sentence)
    return [{**channel, "name": name} for channel, name in zip(channels, names, strict=True)]


def _are_among(wanted: Wanted, channels: Sequence[Sep005Channel]) -> bool:
    """Whether channels are wanted by name, and there are all of them."""
    return bool(wanted.names) and wanted.names <= {channel["name"] for channel in channels}


def _without_aside(
    channels: Sequence[Sep005Channel], path: Path, wanted: Wanted
) -> list[Sep005Channel]:
    """Return the channels of the measurement; those beside it are named."""
    time = wanted.time.column
    aside = [each["name"] for each in channels if each.get("aside") and each["name"] != time]
    if aside and not _are_among(wanted, channels):
        log_once(
            f"{path}: {', '.join(aside)} not read: in another number of samples than the others; "
            "a layout file (--layout) that lists channels of one rate chooses them"
        )
    return [channel for channel in channels if channel["name"] not in aside]


def _without_ramps(channels: Sequence[Sep005Channel], path: Path) -> list[Sep005Channel]:
    """Return the channels that do not rise evenly: a counter, or a time under another name."""
    moving = [each for each in channels if not _is_ramp(np.asarray(each["data"]))]
    for each in channels if moving else []:
        if any(each is one for one in moving):
            continue
        first, second = np.asarray(each["data"])[:2].astype(np.float64)
        timed = each.get("time") is not None or each.get("fs")
        hint = "" if timed else "; where it is the time, --sampling-rate HZ stands for it"
        log_once(
            f"{path}: {each['name']} rises evenly from {first:g} by {second - first:.6g} and is no "
            f"channel{hint}"
        )
    return moving or list(channels)


def _is_ramp(values: NDArray[Any]) -> bool:
    """Whether (n,) values rise by one step all the time, as exactly as their type has it."""
    if values.ndim != 1 or values.dtype.kind not in "iuf" or len(values) < FEWEST_OF_RAMP:
        return False
    first, last = float(values[0]), float(values[-1])
    step = (last - first) / (len(values) - 1)
    if not 0 < step < np.inf:
        return False
    return bool(np.abs(values - np.linspace(first, last, len(values))).max() < step / 2)


def list_channels(
    channels: Sequence[Sep005Channel], path: Path, wanted: Wanted = EVERYTHING
) -> ChannelTable:
    """Return names and units of the measurement's channels, without samples.

    Parameters
    ----------
    channels : sequence of Sep005Channel
        Of the file.
    path : Path
        Of the file, for messages.
    wanted : Wanted, optional
        What is read: where channels beside the measurement are wanted, none is named as left out.

    Raises
    ------
    FileError
        If there is no channel.
    """
    if not channels:
        raise FileError(f"{path}: there is no channel of numbers in it")
    channels = _without_aside(_with_names(channels, path), path, wanted)
    units = [in_standard_unit(str(channel.get("unit_str") or ""))[0] for channel in channels]
    return ChannelTable(
        names=tuple(channel["name"] for channel in channels),
        units=tuple(units),
        samples=np.empty((0, len(channels))),
        times=None,
    )


def constant_series(channels: Sequence[Sep005Channel], path: Path) -> tuple[str, ...]:
    """Return the names of the channels that are one number throughout, or none.

    Raises
    ------
    FileError
        Data that are no series of numbers.
    """
    series = [(each["name"], _samples(each, path)) for each in _with_names(channels, path)]
    known = [(name, samples[np.isfinite(samples)]) for name, samples in series]
    return tuple(name for name, each in known if not len(each) or each.min() == each.max())


def _with_time(
    channels: Sequence[Sep005Channel], time: TimeColumn, path: Path
) -> list[Sep005Channel]:
    """Return the other channels, stamped by the one that is stated to be the time."""
    names = [channel["name"] for channel in channels]
    if time.column not in names:
        raise FileError(
            f"{path}: no series {time.column!r} to be the time; it has {', '.join(names)}"
        )
    place = names.index(time.column)
    unit = time.unit or str(channels[place].get("unit_str") or "")
    clock = TextClock(time.column, unit, time.dates, time.zone, time.second_hour)
    try:
        seconds = clock.seconds(pa.array(np.asarray(channels[place]["data"])))
    except (ClockError, pa.ArrowException) as error:
        raise FileError(f"{path}: the time {time.column!r} {error}") from error
    begin = iso(clock.start_ns) if clock.start_ns else channels[place].get("start_timestamp")
    return [
        _without_clock(channel) | Sep005Channel(time=seconds, start_timestamp=begin)  # type: ignore[typeddict-item]
        for channel in (*channels[:place], *channels[place + 1 :])
    ]


def _without_clock(channel: Sep005Channel) -> Sep005Channel:
    """Return a channel without its rate and its time stamps."""
    return Sep005Channel(
        data=channel["data"],
        name=channel["name"],
        unit_str=channel.get("unit_str", ""),
        start_timestamp=channel.get("start_timestamp"),
        quantity=channel.get("quantity"),
    )


def _samples(channel: Sep005Channel, path: Path) -> FloatArray:
    name = channel.get("name")
    try:
        samples = np.ma.filled(np.ma.asarray(channel["data"], dtype=np.float64), np.nan)
    except (KeyError, TypeError, ValueError):
        raise FileError(f"{path}: channel {name!r} holds no series of numbers") from None
    if samples.ndim != 1:
        raise FileError(
            f"{path}: channel {name!r} has {samples.ndim} dimensions; one series is needed"
        )
    return samples


def _on_one_clock(
    channels: Sequence[Sep005Channel], columns: list[FloatArray], path: Path
) -> tuple[FloatArray | None, int, FloatArray]:
    """Return times, start and samples of all channels on one clock.

    Seconds since the first sample (None: unknown), that sample [ns since 1970; 0: unknown], and
    (n, n_channels) samples.
    """
    rates = {channel.get("fs") for channel in channels}
    if len(rates) > 1:
        raise FileError(
            f"{path}: channels differ in sampling rate ({_rates_in_words(channels)}); a layout "
            "file (--layout) that lists channels of one rate chooses them"
        )
    (rate,) = rates
    stamps = channels[0].get("time")
    if stamps is None and rate is not None:
        if not 0 < float(rate) < float("inf"):
            raise FileError(f"{path}: the sampling rate is {rate} Hz; it must be positive")
        return _on_grid(channels, columns, float(rate), path)
    _require_alike(channels, columns, path)
    start_ns = timestamp_ns(channels[0].get("start_timestamp"), path)
    if stamps is None:
        return None, start_ns, np.column_stack(columns)
    times = np.asarray(stamps, dtype=np.float64)
    if not start_ns and times[0] > ABSOLUTE:
        return times - times[0], round(float(times[0]) * NANOSECONDS), np.column_stack(columns)
    begin_ns = start_ns + round(float(times[0]) * NANOSECONDS) if start_ns else 0
    return times - times[0], begin_ns, np.column_stack(columns)


def _rates_in_words(channels: Sequence[Sep005Channel]) -> str:
    first: dict[Any, str] = {}
    for channel in channels:
        first.setdefault(channel.get("fs"), channel["name"])
    rates = [
        f"{name} {'of unknown rate' if rate is None else f'{rate:g} Hz'}"
        for rate, name in first.items()
    ]
    return ", ".join(rates)


def _require_alike(
    channels: Sequence[Sep005Channel], columns: list[FloatArray], path: Path
) -> None:
    first = channels[0]
    for channel, column in zip(channels, columns, strict=True):
        stamps = channel.get("time")
        length = len(column) if stamps is None else len(stamps)
        same = stamps is first.get("time") or _equal(stamps, first.get("time"))
        if len(column) != len(columns[0]) or length != len(column) or not same:
            raise FileError(
                f"{path}: channels {first['name']!r} ({len(columns[0])} samples) and "
                f"{channel['name']!r} ({len(column)} samples) do not share their time stamps; a "
                "layout file (--layout) that lists those that do chooses them"
            )


def _equal(a: Any, b: Any) -> bool:
    return a is not None and b is not None and bool(np.array_equal(a, b))


def _on_grid(
    channels: Sequence[Sep005Channel], columns: list[FloatArray], rate: float, path: Path
) -> tuple[FloatArray, int, FloatArray]:
    starts = [timestamp_ns(channel.get("start_timestamp"), path) for channel in channels]
    start_ns = min(starts)
    offsets = [(start - start_ns) * rate / NANOSECONDS for start in starts]
    for channel, offset in zip(channels, offsets, strict=True):
        if abs(offset - round(offset)) > TOGETHER:
            raise FileError(
                f"{path}: channel {channel['name']!r} is sampled {offset - np.floor(offset):.2f} "
                f"of a sample after {channels[starts.index(start_ns)]['name']!r}; channels that "
                "are not sampled together cannot be compared"
            )
    firsts = [round(offset) for offset in offsets]
    ends = [first + len(column) for first, column in zip(firsts, columns, strict=True)]
    if max(ends) > MOST_PADDED * max(len(column) for column in columns):
        raise FileError(f"{path}: its channels begin {max(firsts) / rate:g} s apart")
    samples = np.full((max(ends), len(columns)), np.nan)
    for number, (first, column) in enumerate(zip(firsts, columns, strict=True)):
        samples[first : first + len(column), number] = column
    present = ~np.isnan(samples).all(axis=1)
    return np.flatnonzero(present) / rate, start_ns, samples[present]


def _dated(channel: Sep005Channel, path: Path, zone: str) -> Sep005Channel:
    """Return the channel with its start in UTC; `zone` is that of a start which states none."""
    start_ns = timestamp_ns(channel.get("start_timestamp"), path, zone)
    return channel | Sep005Channel(start_timestamp=iso(start_ns) if start_ns else None)  # type: ignore[typeddict-item]


def timestamp_ns(stamp: str | datetime | None, path: Path, zone: str = "") -> int:
    """Return nanoseconds since 1970 of a time, in `zone` where it states none; 0 for None.

    Parameters
    ----------
    stamp : str or datetime or None
        ISO 8601, its fraction behind a point or a comma, or as MATLAB's datestr writes it:
        01-Mar-2026 12:00:00; behind it perhaps the name of a zone: UTC, CET, UTC+2.
    path : Path
        Of the file, for messages.
    zone : str, optional
        Where the time states none; "" is UTC.

    Raises
    ------
    FileError
        If it is no such time.
    """
    if stamp is None:
        return 0
    if isinstance(stamp, datetime):
        stamp = stamp.isoformat()
    named = _NAMED_ZONE.search(stamp)
    if named is not None and (stated := zone_in_title(named[0])) is not None:
        stamp, zone = stamp[: named.start()], stated
    stamp = stamp.strip().replace("Z", "+00:00")
    fraction = _FRACTION.search(stamp)  # apart: a datetime has whole microseconds
    digits = fraction[1] if fraction else ""
    try:
        moment = _moment(_FRACTION.sub("", stamp, count=1))
    except ValueError:
        raise FileError(
            f"{path}: its start is {stamp!r}; a time like 2024-12-31T23:59:59.5 is needed"
        ) from None
    aware = moment if moment.tzinfo else moment.replace(tzinfo=zone_named(zone))
    return round(aware.timestamp()) * NANOSECONDS + int(f"{digits:0<9}"[:9])


_FRACTION = re.compile(r"(?:(?<=:\d\d:\d\d)|(?<=[T ]\d{6}))[.,](\d*)")
_NAMED_ZONE = re.compile(r" [A-Z]{3,4}(?:[+-]\d{1,2}(?::?\d{2})?)?\s*$")


def _moment(text: str) -> datetime:
    """Raises ValueError for a text that is neither ISO 8601 nor MATLAB's."""
    if re.search(r"[T ]\d\d(?::?\d\d)?[.,]\d", text):
        raise ValueError("a fraction of a minute, which a datetime takes for one of a second")
    matlab = re.fullmatch(r"(\d\d)-([A-Z][a-z]{2})-(\d{4}) (\d\d:\d\d:\d\d)", text)
    names = enumerate(MONTHS, start=1)
    months = [number for number, name in names if matlab and re.match(name, matlab[2].lower())]
    if matlab is None or not months:
        return datetime.fromisoformat(text)
    day, _, year, clock = matlab.groups()
    return datetime.fromisoformat(f"{year}-{months[0]:02d}-{day}T{clock}")
