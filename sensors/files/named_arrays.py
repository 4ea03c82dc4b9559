"""Named arrays with notes beside them (NPZ, HDF5, TDMS) → SEP005 channels.

None of these formats defines how a measurement is stored in it. This is what is understood:

- every series of numbers is a channel, every column of a matrix too, every field of a table; of
  several lengths, the most samples are the measurement, or the accelerations where none is among
  those and they last as long; the others are read where they are wanted by name;
- a matrix has as many samples as there are times, else channels as there are names, else its
  longer side is the samples;
- a series called `t`, `time` or `timestamp` (or a word like it) is the time, see `clock`;
- a series that rises evenly under another name is a clock or a counter, no channel;
- texts of a group called `units` that have the names of arrays are the units of these;
- notes, which are scalars or texts of the file, or attributes of a group or of an array, state the
  rest under one of the names below. What is nearest to the array holds.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.files.sep005 import Sep005Channel, timestamp_ns
from sensors.files.table import FileError, in_standard_unit, quantity_named, quantity_of
from sensors.files.text.column_titles import is_time_title, is_unit, split_unit, time_unit
from sensors.files.text.columns import log_once
from sensors.files.text.time_column import (
    ClockError,
    Scale,
    iso,
    known_unit,
    midnights_of_numbers,
    parse_start_ns,
    seconds_of_digits,
    since_1970,
)

Notes = Mapping[str, Any]

RATE = ("fs", "sampling_rate", "sampling_rate_hz", "sampling_frequency", "sample_rate", "rate",
        "samplerate", "samplingrate", "sampling_freq", "f_s", "fsamp", "samplingfrequency",
        "sample_frequency", "samplefrequency", "srate")  # fmt: skip
STEP_NOTES = ("dt", "sampling_interval", "sample_interval", "wf_increment", "delta_t",
              "time_step", "timestep")  # fmt: skip
# Also how long was measured, or when it began.
SHORT_STEP_NOTES = ("ts", "t_s", "sample_time", "sampling_time", "sample_period", "sampling_period")
LONGEST_SHORT_STEP = 1.0  # [s]
START = ("start_timestamp", "start_time", "wf_start_time", "start", "t0", "starttime")
OFFSET = ("wf_start_offset",)  # of the first sample behind `START` [s]
UNIT_NOTES = ("unit_str", "unit_string", "unit", "units")
NAME_NOTES = ("names", "channel_names", "channels", "columns", "labels", "channel_labels",
              "channelnames", "chan_names", "sensor_names", "sensors")  # fmt: skip
LASTING = 0.5  # of the longest series: accelerations that last as long are the measurement [-]
NEARLY = 0.99  # channels of one rate that are so much alike in length belong together

_FREQUENCY = {"hz": 1.0, "khz": 1e3, "s/s": 1.0, "sps": 1.0, "1/s": 1.0, "": 1.0}
_QUANTITY = re.compile(r"\s*([+-]?[\d.]+(?:[eE][+-]?\d+)?)\s*([^\d\s]*)\s*")
_SINCE = re.compile(r"(?P<unit>[A-Za-zµ]+)\s+since\s+(?P<moment>\S+(?:[ T]\S+)?)", re.IGNORECASE)


@dataclass(frozen=True, slots=True, eq=False)
class NamedArray:
    """One array of a file, and what the file notes of it."""

    name: str
    """Name with its groups: "tower/acc"."""

    values: NDArray[Any]
    notes: Notes = field(default_factory=dict)
    own: Notes = field(default_factory=dict)
    """Those among the notes that are of this array alone."""

    @property
    def title(self) -> str:
        """Name of the array without its groups; a slash in a unit's brackets separates none."""
        return self.name[len(self.group) :].removeprefix("/")

    @property
    def group(self) -> str:
        """Names of its groups, joined by slashes."""
        return self.name.partition("[")[0].rpartition("/")[0]

    @property
    def is_time(self) -> bool:
        """Whether the title names a time."""
        return self.values.ndim == 1 and is_time_title(split_unit(self.title)[0])


def find_channels(arrays: list[NamedArray], path: Path) -> list[Sep005Channel]:
    """Return the channels among the arrays.

    Raises
    ------
    FileError
        If there is none.
    """
    single = [part for array in arrays for part in _simple(array)]
    stamps = [a for a in single if a.is_time and a.values.dtype.kind in "iufM"]
    series = [
        _orient(a, stamps)
        for a in single
        if not a.is_time and a.values.ndim in (1, 2) and a.values.dtype.kind in "iuf"
    ]
    odd = [a.name for a in single if a.values.ndim > 2 or a.values.dtype.kind == "c"]
    longest = max((len(each.values) for each in series), default=0)
    if longest < 2:
        raise FileError(f"{path}: there is no series of numbers in it, that is no channel")
    kept = _measurement(series, stamps, path)
    short = len({each.title for each in kept}) == len(kept)
    channels = [
        channel
        for each in kept
        for channel in _channels(each, each.title if short else each.name, stamps, path)
    ]
    for each in series:
        if any(each is one for one in kept):
            continue
        beside = _channels_beside(each, {one["name"] for one in channels}, stamps, path)
        channels += beside
        if not beside:
            odd.append(each.name)
    if odd:
        log_once(f"{path}: {', '.join(odd)} not read: no series of real numbers in time")
    return channels


def _measurement(
    series: list[NamedArray], stamps: list[NamedArray], path: Path
) -> list[NamedArray]:
    """Return the series that are read where none is wanted by name."""

    def alike(length: int) -> list[NamedArray]:
        return [each for each in series if _belongs(each, length, stamps, path)]

    longest = alike(max(len(each.values) for each in series))
    parts = [_probable_channels(each, stamps, path) for each in longest]
    lasts = max(_duration(channels) for channels in parts)
    if not lasts or any(map(_has_acceleration, parts)):
        return longest
    others = [(each, _probable_channels(each, stamps, path)) for each in series]
    lengths = [
        len(each.values)
        for each, channels in others
        if _has_acceleration(channels) and _duration(channels) >= LASTING * lasts
    ]
    return alike(max(lengths)) if lengths else longest


def _probable_channels(
    array: NamedArray, stamps: list[NamedArray], path: Path, name: str = ""
) -> list[Sep005Channel]:
    """Return the channels of an array that may be none; [] where the notes do not fit it."""
    if len(array.values) < 2:
        return []
    try:
        return list(_channels(array, name or array.name, stamps, path))
    except FileError:
        return []


def _has_acceleration(channels: list[Sep005Channel]) -> bool:
    return any(
        each.get("quantity") == "a"
        or quantity_of(in_standard_unit(each["unit_str"])[0]) == "acceleration"
        or quantity_named(each["name"]) == "acceleration"
        for each in channels
    )


def _duration(channels: list[Sep005Channel]) -> float:
    """Return how long the channels of one array were measured [s]; 0: unknown."""
    for each in channels[:1]:
        if (times := each.get("time")) is not None:
            return float(times[-1] - times[0])
        if rate := each.get("fs"):
            return len(each["data"]) / rate
    return 0.0


def _channels_beside(
    array: NamedArray, taken: set[str], stamps: list[NamedArray], path: Path
) -> list[Sep005Channel]:
    """Return the channels of an array beside the measurement, by names that are not `taken`."""
    channels = _probable_channels(array, stamps, path, array.title)
    if taken.intersection(each["name"] for each in channels):
        channels = _probable_channels(array, stamps, path)
    for each in channels:
        if each["name"] in taken:  # of a matrix's columns
            each["name"] = f"{array.name}/{each['name']}"
        each["aside"] = True
    return channels


def _simple(array: NamedArray) -> Iterator[NamedArray]:
    """Yield an array without axes of length one; of a table, an array a field."""
    values = np.squeeze(array.values) if array.values.size > 1 else array.values
    if values.dtype.names is None:
        yield replace(array, values=values)
        return
    for name in values.dtype.names:
        yield replace(array, name=f"{array.group}/{name}".lstrip("/"), values=values[name])


def _orient(array: NamedArray, stamps: list[NamedArray]) -> NamedArray:
    """Return the array with its samples along the first axis."""
    if array.values.ndim < 2:
        return array
    rows, columns = array.values.shape
    lengths = {len(each.values) for each in stamps}
    named = np.size(_find_names(array.notes))
    lies = columns > rows
    if (rows in lengths) != (columns in lengths):
        lies = columns in lengths
    elif (rows == named) != (columns == named):
        lies = rows == named
    return replace(array, values=array.values.T) if lies else array


def _find_names(notes: Notes) -> NDArray[Any]:
    names = _find_note(notes, NAME_NOTES)
    return np.array([]) if names is None else np.asarray(names)


def _belongs(array: NamedArray, longest: int, stamps: list[NamedArray], path: Path) -> bool:
    length = len(array.values)
    if length == longest:
        return True
    timed = _find_time(stamps, array) is not None
    nearly = NEARLY * longest <= length < longest
    return nearly and not timed and _rate(array, path) is not None


def _channels(
    array: NamedArray, name: str, stamps: list[NamedArray], path: Path
) -> Iterator[Sep005Channel]:
    """Yield the channels of one array: itself, or its columns."""
    values = array.values
    if values.ndim == 1:
        bare, unit = split_unit(name)
        stated = unit or str(_find_note(array.notes, UNIT_NOTES) or "")
        yield _channel(values, bare, stated, array, stamps, path)
        return
    count = values.shape[1]
    names = (
        _listed(array.notes, NAME_NOTES, count, path)
        or _only_texts(array.notes, count)
        or [f"{name}{i + 1}" for i in range(count)]
    )
    units = _listed(array.notes, UNIT_NOTES, count, path) or [""] * count
    for column, title, unit in zip(values.T, names, units, strict=True):
        bare, in_brackets = split_unit(title)
        yield _channel(column, bare, in_brackets or unit, array, stamps, path)


def _channel(
    values: NDArray[Any],
    name: str,
    unit: str,
    array: NamedArray,
    stamps: list[NamedArray],
    path: Path,
) -> Sep005Channel:
    channel = Sep005Channel(data=values, name=name, unit_str=unit)
    stamp = _find_time(stamps, array)
    start = None
    if stamp is not None:
        channel["time"], start = _seconds(stamp, path)
    else:
        rate = _rate(array, path)
        if rate is not None:
            channel["fs"] = rate
    channel["start_timestamp"] = start or _start(array.notes, path)
    channel["quantity"] = _find_note(array.notes, ("quantity",))
    return channel


def _rate(array: NamedArray, path: Path) -> float | None:
    """Return the sampling rate in its notes, perhaps as the interval [Hz]."""
    rate = _find_note(array.notes, RATE)
    if rate is not None:
        return _number(rate, "the sampling rate", _FREQUENCY, path)
    factors = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "ns": 1e-9, "": 1.0}
    step = _find_note(array.notes, STEP_NOTES)
    if step is None:
        return _rate_of_short_step(_find_note(array.notes, SHORT_STEP_NOTES), factors)
    seconds = _number(step, "the sampling interval", factors, path)
    if not 0 < seconds < float("inf"):
        raise FileError(f"{path}: the sampling interval is {seconds:g} s; it must be positive")
    return 1.0 / seconds


def _rate_of_short_step(step: Any, factors: Mapping[str, float]) -> float | None:
    """Return the rate of a note such as MATLAB's Ts [Hz]; None where it is no short interval."""
    found = _QUANTITY.fullmatch(str(step))
    if found is None or found[2].lower() not in factors:
        return None
    seconds = float(found[1]) * factors[found[2].lower()]
    return 1.0 / seconds if 0 < seconds <= LONGEST_SHORT_STEP else None


def _number(stated: Any, what: str, factors: Mapping[str, float], path: Path) -> float:
    """Return a number, perhaps with its unit: 50, "50 Hz", several that are equal."""
    values = np.unique(np.asarray(stated))
    found = _QUANTITY.fullmatch(str(values[0])) if len(values) == 1 else None
    if values.dtype.kind in "iuf" and len(values) == 1 and np.isfinite(values[0]):
        return float(values[0])
    if found is None or found[2].lower() not in factors:
        raise FileError(f"{path}: {what} is {_shorten(stated)}; one number is needed")
    return float(found[1]) * factors[found[2].lower()]


def _shorten(stated: Any) -> str:
    return " ".join(repr(stated.tolist() if isinstance(stated, np.ndarray) else stated).split())[
        :60
    ]


def _find_time(stamps: list[NamedArray], array: NamedArray) -> NamedArray | None:
    """Return the time of an array: of its own group, else of one around it."""
    fitting = [
        each
        for each in stamps
        if len(each.values) == len(array.values) and _is_around(each.group, array.group)
    ]
    return max(fitting, key=lambda each: each.name.count("/"), default=None)


def _is_around(outer: str, group: str) -> bool:
    """Whether a group is another one, or in it; run1 is not around run10."""
    return not outer or f"{group}/".startswith(f"{outer}/")


def _seconds(stamp: NamedArray, path: Path) -> tuple[NDArray[np.float64], str | None]:
    """Seconds since the first sample or a start, and the time they count from where it is known."""
    values = stamp.values
    if values.dtype.kind == "M":
        if np.isnat(values).any():
            missing = int(np.argmax(np.isnat(values))) + 1
            raise FileError(
                f"{path}: the time {stamp.name!r} has no value in sample {missing}; every sample "
                "needs a time"
            )
        since = (values - values[0]) / np.timedelta64(1, "ns")
        return np.asarray(since * 1e-9), str(values[0].astype("datetime64[ns]"))
    try:
        return _seconds_of_numbers(stamp, path)
    except ClockError as error:
        raise FileError(f"{path}: the time {stamp.name!r} {error}") from error


def _seconds_of_numbers(stamp: NamedArray, path: Path) -> tuple[NDArray[np.float64], str | None]:
    values, noted = stamp.values, str(_find_note(stamp.own, UNIT_NOTES) or "")
    if values.dtype.kind == "u":
        values = values.astype(np.int64)
    since = _SINCE.fullmatch(noted.strip())
    name, unit = split_unit(stamp.title)
    around = str(_find_note(stamp.notes, UNIT_NOTES) or "")
    unit = (
        unit or time_unit(name) or (since["unit"] if since else noted)
        or (around if known_unit(around) is not None else "")
    )  # fmt: skip
    clock = seconds_of_digits(values, unit)
    if clock is not None:
        values, unit = clock, "s"
    step = float(np.median(np.diff(values[:100]))) if len(values) > 1 else None
    first = float(values[0])
    scale = Scale.of(unit, first, step if np.isfinite(first) else None)
    if since is not None:
        begin = timestamp_ns(since["moment"], path) + round(first * scale.seconds * 1e9)
        return np.asarray((values - values[0]) * scale.seconds), iso(begin)
    if not scale.absolute:
        seconds = np.asarray(values * scale.seconds, dtype=np.float64)
        return seconds + midnights_of_numbers().seconds_added(seconds), None
    return np.asarray((values - values[0]) * scale.seconds), iso(
        since_1970(values[0].item(), scale)
    )


def _start(notes: Notes, path: Path) -> str | None:
    """Time of the first sample; None where the notes state none or an impossible one (1904)."""
    start = _find_note(notes, START)
    if isinstance(start, np.ndarray):
        raise FileError(f"{path}: the start is {_shorten(start)}; one time is needed")
    if isinstance(start, np.datetime64):
        if not np.datetime64("1973") < start:
            return None
        start = str(start.astype("datetime64[ns]"))
    elif isinstance(start, int | float):
        try:
            began = parse_start_ns(start)
        except ClockError as error:
            raise FileError(f"{path}: the start {error}") from error
        start = iso(began) if began else None
    offset = _find_note(notes, OFFSET)
    if not start or not offset:
        return str(start) if start else None
    return iso(timestamp_ns(str(start), path) + round(float(offset) * 1e9))


def _find_note(notes: Notes, names: tuple[str, ...]) -> Any:
    """Return the first of these notes that there is, as a Python value."""
    plain = {key.lower().replace(" ", "_").replace("-", "_"): each for key, each in notes.items()}
    return _python_value(next((plain[name] for name in names if name in plain), None))


def units_apart(headers: Mapping[str, Notes]) -> tuple[dict[str, Any], dict[str, str]]:
    """Return the notes of groups that hold nothing else, and the units of arrays by their names.

    Parameters
    ----------
    headers : mapping
        Notes of each group by its name: of one called `units`, texts are units.
    """
    notes: dict[str, Any] = {}
    units: dict[str, str] = {}
    for group, inside in headers.items():
        values = {name: _python_value(each) for name, each in inside.items()}
        own = {name: each for name, each in values.items() if isinstance(each, str)}
        if group.lower() not in UNIT_NOTES:
            own = {}
        units |= own
        notes |= {n: each for n, each in inside.items() if n not in own or not is_unit(own[n])}
    return notes, units


def _python_value(value: Any) -> Any:
    """Return a note as Python has it; an array of several values stays one."""
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value.item() if isinstance(value, np.number | np.str_) else value


def _only_texts(notes: Notes, count: int) -> list[str]:
    """The one list of `count` texts among the notes, whatever it is called; [] where there are
    several."""
    lists = [np.asarray(each).reshape(-1) for each in notes.values() if np.size(each) == count]
    texts = [each for each in lists if each.dtype.kind in "US"]
    if len(texts) != 1 or len(set(texts[0].tolist())) != count or count == 1:
        return []
    return [
        each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each)
        for each in texts[0]
    ]


def _listed(notes: Notes, names: tuple[str, ...], count: int, path: Path) -> list[str]:
    """One text for each column; one that holds for all is repeated; [] where there is none."""
    value = _find_note(notes, names)
    if value is None:
        return []
    texts = [value] * count if isinstance(value, str) else list(np.asarray(value).reshape(-1))
    if len(texts) != count:
        raise FileError(
            f"{path}: {len(texts)} {names[-1]} are given for a matrix of {count} channels"
        )
    return [each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each)
            for each in texts]  # fmt: skip
