"""Columns of a table (of a text file, of a Parquet file) → ChannelTables, chunk by chunk.

A column's title holds its unit in brackets. One of the columns may hold the time, or several of
them date and time of day or the parts of a clock; columns that only number the samples, and columns
of text, are left out; the others are channels.
"""

import logging
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, reduce
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc

from sensors.arrays import FloatArray
from sensors.files.table import (
    EVERYTHING,
    UNSTATED,
    ChannelTable,
    FileError,
    TimeColumn,
    Wanted,
    in_standard_unit,
)
from sensors.files.text.arrow_values import values_of
from sensors.files.text.column_titles import is_number_title, is_time_title, time_unit
from sensors.files.text.dates import is_date_of_digits, zone_in_title
from sensors.files.text.split_clock import (
    ClockPart,
    PartError,
    is_fraction,
    joined_clock,
    part_of,
    split_clock,
)
from sensors.files.text.time_column import ClockError, TextClock, known_unit

logger = logging.getLogger(__name__)

ColumnKind = Literal["number", "moment", "date", "time of day", "text", "empty"]

EVEN = 1e-3  # a column that rises by steps so much alike is a clock, relative
RECORD_NUMBER = "rn"  # "unit" of a record counter, whatever its steps: Campbell's TOA5
LARGEST = float(np.finfo(np.float32).max)  # of a sample: blocks are of single precision
FEWEST = 10  # rows that are needed to see that


@dataclass(frozen=True, slots=True, eq=False)
class Column:
    """One column of a table, and what its first rows hold."""

    name: str
    unit: str
    """Unit; empty: not stated."""

    kind: ColumnKind
    first: Sequence[Any]
    """Its first values: floats of a number column, texts of others."""

    titled: bool = True
    """False: it has a number for a name."""

    @property
    def title(self) -> str:
        """Name and unit in brackets."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


@dataclass(frozen=True, slots=True, eq=False)
class SortedColumns:
    """Which columns of a table are what."""

    all: tuple[Column, ...]
    channels: tuple[int, ...]
    clock: tuple[int, ...]
    """Places of the time: one column, date and time of day, the parts of a clock, or none."""

    rate: float | None = None
    """Sampling rate [Hz], where the file states it beside the columns."""

    start_ns: int = 0
    """Time of the first sample [ns since 1970-01-01 UTC]; 0: not stated."""

    time: TimeColumn = UNSTATED
    """What is stated of the time beside the file."""

    left_out: tuple[str, ...] = ()
    """What is left out or renamed, in sentences; logged when samples were read, beside no error."""

    @property
    def used(self) -> tuple[int, ...]:
        """All that are read, in their order."""
        return tuple(sorted((*self.clock, *self.channels)))


def sort_columns(
    columns: Sequence[Column], path: Path, wanted: Wanted = EVERYTHING
) -> SortedColumns:
    """Find time, channels, and what is left out.

    Parameters
    ----------
    columns : sequence of Column
        Of the file, in order.
    path : Path
        Of the file, for messages.
    wanted : Wanted, optional
        What of it is read; everything by default.

    Raises
    ------
    FileError
        No channel; a column that looks like a clock under another name.
    """
    if wanted.time.column:
        columns, clock = _stated_clock(columns, wanted.time, path)
    else:
        clock = _clock_columns(columns, path, wanted)
    parts = split_clock(_number_titles(columns)).values()
    times = [
        i for i, each in enumerate(columns) if i not in clock and (_holds_time(each) or i in parts)
    ]
    numbers = [i for i, each in enumerate(columns) if i not in clock and _counts(each)]
    texts = [i for i, each in enumerate(columns) if i not in clock and each.kind == "text"]
    blank = [i for i, each in enumerate(columns) if each.kind == "empty" and not each.titled]
    left_out = {*clock, *times, *numbers, *texts, *blank}
    channels = tuple(i for i in range(len(columns)) if i not in left_out)
    if not channels and columns:
        time = "time " if clock == tuple(left_out) else ""
        what = f"no channel beside the {time}{_listed(columns, sorted(left_out))}"
        raise FileError(f"{path}: {what}{_text_among(columns, texts)}")
    channels = tuple(channels[i] for i in wanted.among([columns[i].name for i in channels]))
    sentences = [
        f"{path}: column {columns[number].name!r} holds text "
        f"({str(next(iter(columns[number].first), ''))!r}) and is left out"
        for number in (texts if not wanted.names else ())
    ]
    if times:
        why = "another one is the time" if clock else "it has the date alone"
        sentences.append(f"{path}: {_listed(columns, times)} left out; {why}")
    used = clock if wanted.stamps else ()
    return SortedColumns(
        tuple(columns), channels, used, time=wanted.time, left_out=tuple(sentences)
    )


def renamed_columns(given: Sequence[str], columns: SortedColumns, path: Path) -> SortedColumns:
    """Return the columns with a sentence, to be logged, about those whose name another one has.

    Parameters
    ----------
    given : sequence of str
        Names as the file has them.
    columns : SortedColumns
        The same by the names that they are read by.
    path : Path
        Of the file, for the sentence.
    """
    sentence = said_of_renamed(given, [column.name for column in columns.all], path, "column")
    return replace(columns, left_out=(*columns.left_out, sentence)) if sentence else columns


def said_of_renamed(given: Sequence[str], names: Sequence[str], path: Path, what: str) -> str:
    """Return a sentence about those whose name another one has; "" where there are none.

    Parameters
    ----------
    given, names : sequence of str
        Names as the file has them, and those that they are read by.
    path : Path
        Of the file, for the sentence.
    what : str
        That they are names of: "column".
    """
    renamed = [
        f"{what} {place}, {own!r}, is called {name!r}"
        for place, (own, name) in enumerate(zip(given, names, strict=True), start=1)
        if own and own != name
    ]
    return f"{path}: several {what}s have one name: {', '.join(renamed)}" if renamed else ""


def _stated_clock(
    columns: Sequence[Column], time: TimeColumn, path: Path
) -> tuple[list[Column], tuple[int, ...]]:
    """Return the columns, the stated time in its stated unit, and where that time stands."""
    names = [each.name for each in columns]
    if time.column not in names:
        raise FileError(f"{path}: no column {time.column!r} to be the time; {no_such(names)}")
    place = names.index(time.column)
    stated = replace(columns[place], unit=time.unit or columns[place].unit)
    return [*columns[:place], stated, *columns[place + 1 :]], (place,)


def no_such(names: Sequence[str]) -> str:
    """Return what a file has instead of a name that it lacks."""
    return f"it has {', '.join(names)}"


def _clock_columns(columns: Sequence[Column], path: Path, wanted: Wanted) -> tuple[int, ...]:
    of_digits = [i for i, each in enumerate(columns) if _is_date_of_digits(each)]
    dates = [i for i, each in enumerate(columns) if each.kind == "date"] + of_digits
    clocks = [i for i, each in enumerate(columns) if each.kind == "time of day"]
    if dates and clocks:
        return (dates[0], clocks[0], *_fraction(columns))
    named = [i for i, each in enumerate(columns) if _holds_time(each) and i not in of_digits]
    parts = split_clock(_number_titles(columns))
    if parts and all(i in parts.values() or i in dates for i in named):
        return (*(dates[:1] if "year" not in parts else []), *parts.values())
    if named:
        return (named[0], *(_fraction(columns) if columns[named[0]].kind != "number" else []))
    _require_readable_time(columns, path)
    first = columns[0] if columns else None
    if first is None or not _is_even_ramp(first) or _counts(first):
        return ()
    if first.unit and known_unit(first.unit) is not None:
        return (0,)
    rise = f"from {first.first[0]:g} by {first.first[1] - first.first[0]:.6g}"
    if first.titled and wanted.rate_known:
        log_once(f"{path}: column {first.name!r} rises evenly {rise} and is left out")
        return (0,)
    if first.titled:
        raise FileError(
            f"{path}: column {first.name!r} rises evenly {rise}: call it 'time [s]' where it is "
            "the time, 'sample' where it counts the samples; --sampling-rate HZ leaves it out, "
            f"[time] column = {first.name!r} of a layout takes it"
        )
    log_once(f"{path}: no header; the first column rises evenly and is taken for seconds")
    return (0,)


def _number_titles(columns: Sequence[Column]) -> list[str]:
    """Names of columns of numbers, "" of the others."""
    return [each.name if each.kind == "number" else "" for each in columns]


def _fraction(columns: Sequence[Column]) -> list[int]:
    """Where the column stands that counts within the seconds of another; empty: there is none."""
    return [
        i for i, each in enumerate(columns)
        if each.kind == "number" and is_fraction(each.name, each.first)
    ][:1]  # fmt: skip


def _require_readable_time(columns: Sequence[Column], path: Path) -> None:
    for column in columns:
        if column.kind == "text" and is_time_title(column.name):
            raise FileError(
                f"{path}: column {column.name!r} has {str(next(iter(column.first), ''))!r}; a time "
                "is needed: a number, or 2024-12-31T23:59:59.5"
            )


def _holds_time(column: Column) -> bool:
    if column.kind in ("moment", "date", "time of day"):
        return True
    return column.kind == "number" and is_time_title(column.name)


def _text_among(columns: Sequence[Column], texts: Sequence[int]) -> str:
    """Return what the first of some columns of text holds instead of numbers; "" of none."""
    if not texts:
        return ""
    first = columns[texts[0]]
    text = str(next(iter(first.first), ""))
    return f"; {first.title!r} holds text ({text!r}) where numbers are needed"


def _is_date_of_digits(column: Column) -> bool:
    """Whether a column has dates without marks, 20240313, and no other time."""
    if not _holds_time(column) or column.kind != "number" or not len(column.first):
        return False
    return all(np.isfinite(each) and is_date_of_digits(each) for each in column.first)


def _counts(column: Column) -> bool:
    """Whether a column numbers the samples."""
    if column.unit.lower() == RECORD_NUMBER:
        return True
    with np.errstate(invalid="ignore"):  # between infinite values
        steps = np.diff(np.asarray(column.first[:FEWEST] if column.kind == "number" else []))
    counted = bool(len(steps)) and bool((steps == 1).all())
    named = is_number_title(column.name) or not column.titled
    return counted and named and (len(steps) >= FEWEST - 1 or column.titled)


def _is_even_ramp(column: Column) -> bool:
    if column.kind != "number" or len(column.first) < FEWEST:
        return False
    first = np.asarray(column.first, dtype=np.float64)
    if not np.isfinite(first).all():
        return False
    steps = np.diff(first)
    mean = float(np.mean(steps))
    return bool(mean > 0 and (np.abs(steps - mean) <= EVEN * mean).all())


def _listed(columns: Sequence[Column], numbers: Sequence[int]) -> str:
    names = ", ".join(repr(columns[i].title) for i in numbers)
    return f"column{'s' if len(numbers) > 1 else ''} {names}"


@lru_cache(maxsize=256)
def log_once(text: str) -> None:
    """Log a text once, though its file is opened more often."""
    logger.warning(text)


def convert_batches(
    batches: Iterable[pa.RecordBatch], columns: SortedColumns, path: Path
) -> Iterator[ChannelTable]:
    """Yield the batches of a file as chunks; `times` of all count from the file's first sample.

    Parameters
    ----------
    batches : Iterable[pa.RecordBatch]
        Batches of the columns `columns.used`.

    Raises
    ------
    FileError
        A column that holds no numbers, a time that is missing, in an unknown unit, or of no
        known kind.
    """
    place = {number: i for i, number in enumerate(columns.used)}
    chosen = [columns.all[i] for i in columns.channels]
    units, factors = zip(*(in_standard_unit(each.unit) for each in chosen), strict=True)
    names = tuple(each.name for each in chosen)
    seconds = _seconds_of(columns, place, path)
    named: set[str] = set()
    rows = 0
    for raw in batches:
        batch = _without_empty_rows(raw) if columns.clock else raw
        if not batch.num_rows:
            continue
        numbers = [
            _numbers(batch.column(place[i]), columns.all[i].name, path) for i in columns.channels
        ]
        with np.errstate(over="ignore"):  # becomes infinite, and is named as such
            samples = np.column_stack(numbers) * np.array(factors)
        chunk = ChannelTable(
            names=names,
            units=units,
            samples=samples,
            times=None,
            stated_rate=columns.rate,
        )
        named |= leave_out_infinite(chunk, path, rows, named)
        rows += len(chunk.samples)
        timed = seconds(chunk, batch)
        for sentence in columns.left_out:
            log_once(sentence)
        yield timed


def leave_out_infinite(
    chunk: ChannelTable, path: Path, before: int = 0, named: Collection[str] = ()
) -> set[str]:
    """Make NaN of a chunk's infinite samples, in place; return their channels, which are logged.

    Parameters
    ----------
    chunk : ChannelTable
        Some consecutive samples.
    path : Path
        Of the file, for messages.
    before : int
        Number of the file's samples before this chunk.
    named : collection of str
        Channels that need not be logged again.

    Notes
    -----
    Numbers that single precision does not hold, as blocks and recordings have it, are infinite.
    """
    infinite = np.abs(chunk.samples) > LARGEST
    if not infinite.any():
        return set()
    found = {
        name: flags for name, flags in zip(chunk.names, infinite.T, strict=True) if flags.any()
    }
    for name, flags in found.items():
        if name not in named:
            log_once(
                f"{path}: {name} is infinite, the first time in sample "
                f"{before + int(np.argmax(flags)) + 1}; infinite samples are taken as missing"
            )
    chunk.samples[infinite] = np.nan
    return set(found)


def _without_empty_rows(batch: pa.RecordBatch) -> pa.RecordBatch:
    """The rows with a value in any column: spreadsheets write others of separators alone."""
    if not all(column.null_count for column in batch.columns):
        return batch
    filled = reduce(pc.or_, (column.is_valid() for column in batch.columns))
    return batch.filter(filled)


def _seconds_of(
    columns: SortedColumns, place: dict[int, int], path: Path
) -> Callable[[ChannelTable, pa.RecordBatch], ChannelTable]:
    """Return what puts the times beside the samples of a batch."""
    if not columns.clock:
        return lambda chunk, _: replace(chunk, start_ns=columns.start_ns)
    titles = [columns.all[i] for i in columns.clock]
    unit = titles[0].unit or time_unit(titles[0].name)
    title = " and ".join(each.name for each in titles)
    zone = zone_in_title(f"{title} {titles[0].unit}") or columns.time.zone
    clock = TextClock(title, unit, columns.time.dates, zone, columns.time.second_hour)

    def timed(chunk: ChannelTable, batch: pa.RecordBatch) -> ChannelTable:
        stamps = [batch.column(place[i]) for i in columns.clock]
        try:
            times = clock.seconds(stamps[0] if len(stamps) == 1 else _joined(stamps, titles))
        except (ClockError, PartError) as error:
            raise FileError(f"{path}: the time column {clock.title!r} {error}") from error
        for remark in clock.local_clock.remarks:
            log_once(f"{path}: {remark}")
        return replace(chunk, times=times, start_ns=clock.start_ns or columns.start_ns,
                       stated_rate=None, went_back=clock.local_clock.went_back)  # fmt: skip

    return timed


def _joined(stamps: Sequence[pa.Array], columns: Sequence[Column]) -> pa.Array:
    parts: dict[ClockPart, pa.Array] = {}
    texts = []
    for stamp, column in zip(stamps, columns, strict=True):
        part = part_of(column.name) if column.kind == "number" else None
        if part is None:
            texts.append(stamp)
        else:
            parts[part] = stamp
    return joined_clock(texts, parts)


def _numbers(column: pa.Array, title: str, path: Path) -> FloatArray:
    kind = column.type
    if pa.types.is_dictionary(kind):
        column = column.dictionary_decode()
        kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        raise FileError(f"{path}: column {title!r} holds {kind}; numbers are needed")
    return values_of(column.cast(pa.float64(), safe=False))
