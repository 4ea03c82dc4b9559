"""Named arrays with notes beside them (NPZ, HDF5, TDMS) → SEP005 channels.

None of these formats says how a measurement is written down in it. This is what is understood:

- every series of numbers is a channel, every column of a matrix too; of several lengths, the most
  samples are the measurement;
- a series called `t`, `time` or `timestamp` is the time [s];
- notes, which are scalars or texts of the file, or attributes of a group or of an array, say the
  rest under one of the names below. What is nearest to the array holds.
"""

import logging
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.files.clock import ABSOLUTE, SECONDS_PER_UNIT
from sensors.files.sep005 import Channel
from sensors.files.table import FileError
from sensors.files.titles import TIME_NAMES, split_unit

logger = logging.getLogger(__name__)

Notes = Mapping[str, Any]

RATE = ("fs", "sampling_rate", "sampling_rate_hz", "sampling_frequency", "sample_rate", "rate")
STEP = ("dt", "sampling_interval", "sample_interval", "wf_increment")
START = ("start_timestamp", "start_time", "wf_start_time", "start", "t0")
UNIT = ("unit_str", "unit_string", "unit", "units")
NAMES = ("names", "channel_names", "channels", "columns")


@dataclass(frozen=True, slots=True, eq=False)
class NamedArray:
    """One array of a file, and what the file notes of it."""

    name: str  # with its groups: "tower/acc"
    values: NDArray[Any]
    notes: Notes = field(default_factory=dict)

    @property
    def title(self) -> str:
        """Its own name, without its groups."""
        return self.name.rpartition("/")[2]

    @property
    def is_time(self) -> bool:
        return split_unit(self.title)[0].lower() in TIME_NAMES and self.values.ndim == 1


def channels_of_arrays(arrays: list[NamedArray], path: Path) -> list[Channel]:
    """The channels among the arrays. Raises FileError where there is none."""
    numbers = [a for a in arrays if a.values.ndim in (1, 2) and a.values.dtype.kind in "iuf"]
    stamps = [a for a in arrays if a.is_time and a.values.dtype.kind in "iufM"]
    series = [a for a in numbers if not a.is_time]
    longest = max((max(each.values.shape) for each in series), default=0)
    if longest < 2:
        raise FileError(f"{path}: there is no series of numbers in it, that is no channel")
    ignored = [each.name for each in series if max(each.values.shape) < longest]
    if ignored:
        logger.info("%s: %s shorter than the others, not read", path, ", ".join(ignored))
    kept = [each for each in series if max(each.values.shape) == longest]
    short = _titles_are_distinct(kept)
    return [
        channel
        for each in kept
        for channel in _channels(each, each.title if short else each.name, stamps, path)
    ]


def _titles_are_distinct(arrays: list[NamedArray]) -> bool:
    return len({each.title for each in arrays}) == len(arrays)


def _channels(
    array: NamedArray, name: str, stamps: list[NamedArray], path: Path
) -> Iterator[Channel]:
    """The channels of one array: itself, or its columns."""
    values = array.values
    if values.ndim == 1:
        bare, unit = split_unit(name)
        yield _channel(values, bare, unit or str(_noted(array.notes, UNIT) or ""), array, stamps)
        return
    columns = values if values.shape[0] >= values.shape[1] else values.T
    count = columns.shape[1]
    names = _listed(array.notes, NAMES, count, path) or [f"{name}{i + 1}" for i in range(count)]
    units = _listed(array.notes, UNIT, count, path) or [""] * count
    for column, title, unit in zip(columns.T, names, units, strict=True):
        bare, in_brackets = split_unit(title)
        yield _channel(column, bare, in_brackets or unit, array, stamps)


def _channel(
    values: NDArray[Any], name: str, unit: str, array: NamedArray, stamps: list[NamedArray]
) -> Channel:
    channel = Channel(data=values, name=name, unit_str=unit)
    rate, step = _noted(array.notes, RATE), _noted(array.notes, STEP)
    stamp = _nearest(stamps, array.name, len(values))
    if stamp is not None:
        channel["time"], start = _seconds(stamp)
    else:
        start = None
        if rate is not None or step:
            channel["fs"] = float(rate) if rate is not None else 1.0 / float(step)
    channel["start_timestamp"] = start or _start(array.notes)
    channel["quantity"] = _noted(array.notes, ("quantity",))
    return channel


def _nearest(stamps: list[NamedArray], name: str, length: int) -> NamedArray | None:
    """The time of an array: of its own group, else of one around it."""
    group = name.rpartition("/")[0]
    fitting = [
        each
        for each in stamps
        if len(each.values) == length and f"{group}/".startswith(each.name.rpartition("/")[0])
    ]
    return max(fitting, key=lambda each: each.name.count("/"), default=None)


def _seconds(stamp: NamedArray) -> tuple[NDArray[np.float64], str | None]:
    """Seconds, and the time they count from where they are dates."""
    if stamp.values.dtype.kind == "M":
        first = stamp.values[0]
        since = (stamp.values - first) / np.timedelta64(1, "ns")
        return np.asarray(since * 1e-9, dtype=np.float64), str(first.astype("datetime64[ns]"))
    unit = split_unit(stamp.title)[1] or str(_noted(stamp.notes, UNIT) or "")
    return np.asarray(stamp.values * SECONDS_PER_UNIT.get(unit.lower(), 1.0)), None


def _start(notes: Notes) -> str | None:
    """When the first sample was taken; None where the notes do not say, or say nonsense (1904)."""
    start = _noted(notes, START)
    if isinstance(start, np.datetime64):
        after = np.datetime64("1973") < start
        return str(start.astype("datetime64[ns]")) if after else None
    if isinstance(start, int | float):
        if start <= ABSOLUTE:
            return None
        return datetime.fromtimestamp(start, UTC).isoformat()
    return None if not start else str(start)


def _noted(notes: Notes, names: tuple[str, ...]) -> Any:
    """The first of these notes that there is, as a Python value."""
    plain = {key.lower().replace(" ", "_").replace("-", "_"): each for key, each in notes.items()}
    value = next((plain[name] for name in names if name in plain), None)
    if isinstance(value, np.ndarray) and value.size == 1:
        value = value.reshape(-1)[0]
    if isinstance(value, bytes):
        return value.decode("utf-8", "replace")
    return value.item() if isinstance(value, np.number) else value


def _listed(notes: Notes, names: tuple[str, ...], count: int, path: Path) -> list[str]:
    """One text for each column; one that holds for all is repeated; [] where there is none."""
    value = _noted(notes, names)
    if value is None:
        return []
    texts = [value] * count if isinstance(value, str) else list(np.asarray(value).reshape(-1))
    if len(texts) != count:
        raise FileError(
            f"{path}: {len(texts)} {names[-1]} are given for a matrix of {count} channels"
        )
    return [each.decode("utf-8", "replace") if isinstance(each, bytes) else str(each)
            for each in texts]  # fmt: skip
