"""Comma-, semicolon- or tab-separated text → ChannelTable.

One row a sample and one column a channel, under a header row. A column called `t`, `time` or
`timestamp` holds the time: in the unit in brackets behind its name, in seconds where there is
none, or as date and time (ISO 8601). A channel's unit stands in brackets behind its name
(`z145-fa [g]`); accelerations are converted to m/s², velocities to
m/s, displacements to m; other quantities stay as they are.
"""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from numpy.typing import NDArray
from pyarrow import csv as arrow_csv

from sensors.files.table import ChannelTable, FileError, in_standard_unit

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
MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "n/a", "N/A", "-nan")

_BRACKETS = re.compile(r"^(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]\s*$")


def read_csv(path: Path) -> ChannelTable:
    """The channels of a text file.

    Raises FileError: missing or empty file, fewer than two samples, text where a number should
    be, only NaN, a time column that ends before it starts, no channel beside the time.
    """
    header, skipped, delimiter = _header(path)
    table = _parsed(path, header, skipped, delimiter)
    columns = {_split_unit(name): table.column(i) for i, name in enumerate(header)}
    times, start_ns = None, 0
    names, units, channels = [], [], []
    for (name, unit), column in columns.items():
        if name.lower() in TIME_NAMES and times is None:
            times, start_ns = _seconds(column, name, unit, path)
            continue
        standard_unit, factor = in_standard_unit(unit)
        names.append(name)
        units.append(standard_unit)
        channels.append(factor * _numbers(column, name, path, skipped))
    if not channels:
        raise FileError(f"{path}: no channel beside the time column {header[0]!r}")
    samples = np.column_stack(channels)
    if len(samples) and not np.isfinite(samples).any():
        raise FileError(f"{path}: only NaN in {', '.join(names)}; numbers are needed")
    if len(samples) < 2:
        raise FileError(f"{path}: {len(samples)} sample(s); at least two are needed")
    return ChannelTable(tuple(names), tuple(units), samples, times, start_ns)


def _header(path: Path) -> tuple[list[str], int, str]:
    """Column names, lines before the first sample, and the delimiter."""
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as lines:
            stripped = ((count, raw.strip()) for count, raw in enumerate(lines, start=1))
            rows = (row for row in stripped if row[1] and not row[1].startswith(("#", "%")))
            count, line = next(rows, (0, ""))
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
    if not line:
        raise FileError(f"{path}: the file is empty; a header row is needed")
    delimiter = max(";\t,", key=line.count)
    names = [name.strip().strip('"') for name in line.split(delimiter)]
    if all(_is_number(name) for name in names):
        return [f"ch{i + 1}" for i in range(len(names))], count - 1, delimiter
    return _distinct(names), count, delimiter


def _distinct(names: list[str]) -> list[str]:
    """Column names without duplicates or blanks: a blank becomes "ch3", a second "a" "a.2"."""
    given = [name or f"ch{i + 1}" for i, name in enumerate(names)]
    return [
        name if given[:i].count(name) == 0 else f"{name}.{given[:i].count(name) + 1}"
        for i, name in enumerate(given)
    ]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _split_unit(title: str) -> tuple[str, str]:
    match = _BRACKETS.match(title)
    return (match["name"].strip(), match["unit"].strip()) if match else (title, "")


def _parsed(path: Path, header: list[str], skipped: int, delimiter: str) -> pa.Table:
    decimal = "," if delimiter == ";" else "."
    try:
        return arrow_csv.read_csv(
            path,
            read_options=arrow_csv.ReadOptions(skip_rows=skipped, column_names=header),
            parse_options=arrow_csv.ParseOptions(delimiter=delimiter),
            convert_options=arrow_csv.ConvertOptions(
                null_values=list(MISSING),
                strings_can_be_null=True,
                decimal_point=_decimal_point(path, skipped, delimiter, decimal),
            ),
        )
    except pa.ArrowInvalid as error:
        if "Empty CSV" in str(error):
            raise FileError(
                f"{path}: 0 samples below the header; at least two are needed"
            ) from None
        raise FileError(f"{path}: {' '.join(str(error).split())}") from error


def _decimal_point(path: Path, skipped: int, delimiter: str, preferred: str) -> str:
    """Semicolon-separated files are written with either decimal sign: the first row tells."""
    with path.open(encoding="utf-8-sig", errors="replace") as lines:
        row = next((line for i, line in enumerate(lines) if i >= skipped), "")
    return preferred if preferred in row.replace(delimiter, "") else "."


def _numbers(column: pa.ChunkedArray, name: str, path: Path, skipped: int) -> NDArray[np.float64]:
    if pa.types.is_null(column.type):
        return np.full(len(column), np.nan)
    if not (pa.types.is_floating(column.type) or pa.types.is_integer(column.type)):
        row, value = _first_text(column)
        raise FileError(
            f"{path}: column {name!r} has {value!r} in line {row + skipped + 1}; "
            "a number is needed (or nothing, for a missing sample)"
        )
    return np.asarray(column.cast(pa.float64()).to_numpy(), dtype=np.float64)


def _first_text(column: pa.ChunkedArray) -> tuple[int, Any]:
    for row, value in enumerate(column.to_pylist()):
        if value is not None and not _is_number(str(value)):
            return row, value
    return 0, column[0].as_py()


def _seconds(
    column: pa.ChunkedArray, name: str, unit: str, path: Path
) -> tuple[NDArray[np.float64], int]:
    """Seconds since the first sample, and the first sample [ns since 1970] where it is absolute."""
    if pa.types.is_timestamp(column.type):
        stamps = column.cast(pa.timestamp("ns", tz=column.type.tz)).cast(pa.int64()).to_numpy()
        return (stamps - stamps[0]) * 1e-9, int(stamps[0])
    scale = SECONDS_PER_UNIT.get(unit.lower())
    if scale is None:
        known = ", ".join(key for key in SECONDS_PER_UNIT if key)
        raise FileError(f"{path}: the time column's unit is [{unit}]; it can be {known}")
    values = _numbers(column, name, path, 1)
    if not np.isfinite(values).all():
        row = int(np.argmin(np.isfinite(values)))
        raise FileError(f"{path}: the time column {name!r} has no value in sample {row + 1}")
    seconds = (values - values[0]) * scale
    if len(seconds) > 1 and seconds[-1] <= 0:
        raise FileError(
            f"{path}: the time column {name!r} does not increase "
            f"(first {values[0]:g}, last {values[-1]:g})"
        )
    absolute = values[0] * scale > 1e8  # later than 1973: seconds since 1970, not since a start
    return seconds, round(values[0] * scale * 1e9) if absolute else 0
