"""Columns of a table (of a text file, of a Parquet file) → ChannelTables, piece by piece.

A column's title holds its unit in brackets. One of the columns may hold the time; the others are
channels.
"""

import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from sensors.blocks import NANOSECONDS
from sensors.files.table import ChannelTable, FileError, in_standard_unit

FloatArray = NDArray[np.float64]

TIME_NAMES = ("t", "time", "timestamp")
SECONDS_PER_UNIT = {
    "": 1.0,
    "s": 1.0,
    "sec": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
}
ABSOLUTE = 1e8  # seconds that count from 1970, not from a start: later than 1973 [s]

_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")


def split_unit(title: str) -> tuple[str, str]:
    """Name and unit of a title: "top [mm/s]" gives "top" and "mm/s", "top" gives "top" and ""."""
    match = _BRACKETS.match(title)
    return (match["name"].strip(), match["unit"].strip()) if match else (title, "")


def distinct(names: list[str]) -> list[str]:
    """Names without duplicates or blanks: a blank becomes "ch3", a second "a" becomes "a.2"."""
    given = [name or f"ch{i + 1}" for i, name in enumerate(names)]
    return [
        name if given[:i].count(name) == 0 else f"{name}.{given[:i].count(name) + 1}"
        for i, name in enumerate(given)
    ]


def time_column(titles: list[str]) -> int | None:
    """Which column holds the time; None where none does."""
    names = [split_unit(title)[0].lower() for title in titles]
    return next((i for i, name in enumerate(names) if name in TIME_NAMES), None)


def tables_of_columns(
    batches: Iterable[pa.RecordBatch], titles: list[str], path: Path
) -> Iterator[ChannelTable]:
    """The batches of a file as pieces; `times` of all count from the file's first sample.

    Raises FileError: no channel beside the time, a column that holds no numbers, a time that is
    missing, in an unknown unit, or of no known kind.
    """
    timed = time_column(titles)
    channels = [i for i in range(len(titles)) if i != timed]
    if not channels:
        raise FileError(f"{path}: no channel beside the time column {titles[0]!r}")
    named = [split_unit(titles[i]) for i in channels]
    units, factors = zip(*(in_standard_unit(unit) for _, unit in named), strict=True)
    clock = None if timed is None else _Clock(titles[timed], path)
    for batch in batches:
        if not batch.num_rows:
            continue
        numbers = [_numbers(batch.column(i), titles[i], path) for i in channels]
        yield ChannelTable(
            names=tuple(name for name, _ in named),
            units=units,
            samples=np.column_stack(numbers) * np.array(factors),
            times=None if clock is None or timed is None else clock.seconds(batch.column(timed)),
            start_ns=0 if clock is None else clock.start_ns,
        )


def _numbers(column: pa.Array, title: str, path: Path) -> FloatArray:
    kind = column.type
    if pa.types.is_null(kind):
        return np.full(len(column), np.nan)
    if not (pa.types.is_floating(kind) or pa.types.is_integer(kind) or pa.types.is_decimal(kind)):
        raise FileError(f"{path}: column {title!r} holds {kind}; numbers are needed")
    return np.asarray(column.cast(pa.float64()).to_numpy(zero_copy_only=False), dtype=np.float64)


@dataclass(slots=True)
class _Clock:
    """The time column of a file, batch by batch."""

    title: str
    path: Path
    start_ns: int = 0  # the file's first stamp [ns since 1970]; 0 where it counts from a start
    _first: Any = None  # that stamp as the column has it: an int, a float or a Decimal
    _rows: int = 0  # stamps that were read

    def seconds(self, column: pa.Array) -> FloatArray:
        """Seconds since the file's first stamp."""
        if column.null_count:
            row = self._rows + int(np.argmax(column.is_null().to_numpy(zero_copy_only=False)))
            raise FileError(
                f"{self.path}: the time column {self.title!r} has no value in sample {row + 1}"
            )
        self._rows += len(column)
        if pa.types.is_timestamp(column.type):
            return self._since_first(self._stamps(column), 1e-9, absolute=True)
        if pa.types.is_decimal(column.type):
            return self._decimals(column)
        values = _numbers(column, self.title, self.path)
        if not np.isfinite(values).all():
            row = self._rows - len(values) + int(np.argmin(np.isfinite(values)))
            raise FileError(
                f"{self.path}: the time column {self.title!r} has no value in sample {row + 1}"
            )
        return self._since_first(values, self._scale)

    @property
    def _scale(self) -> float:
        """[s] per unit of the column."""
        unit = split_unit(self.title)[1]
        if unit.lower() not in SECONDS_PER_UNIT:
            known = ", ".join(key for key in SECONDS_PER_UNIT if key)
            raise FileError(f"{self.path}: the time column's unit is [{unit}]; it can be {known}")
        return SECONDS_PER_UNIT[unit.lower()]

    def _stamps(self, column: pa.Array) -> NDArray[np.int64]:
        nanoseconds = column.cast(pa.timestamp("ns", tz=column.type.tz)).cast(pa.int64())
        return np.asarray(nanoseconds.to_numpy(), dtype=np.int64)

    def _since_first(
        self, values: NDArray[Any], scale: float, *, absolute: bool = False
    ) -> FloatArray:
        if self._first is None:
            self._first = values[0].item()
            if absolute or values[0] * scale > ABSOLUTE:
                ns_per_unit = round(scale * NANOSECONDS)
                self.start_ns = round(self._first * ns_per_unit)
        return np.asarray((values - self._first) * scale, dtype=np.float64)

    def _decimals(self, column: pa.Array) -> FloatArray:
        """Seconds since 1970 in so many digits that a double does not hold them."""
        if self._first is None:
            self._first = column[0].as_py()
            self.start_ns = round(self._first * NANOSECONDS)
        since = pc.subtract(column, pa.scalar(self._first, column.type))
        return np.asarray(since.cast(pa.float64()).to_numpy(zero_copy_only=False))
