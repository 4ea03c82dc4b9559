"""Comma-, semicolon- or tab-separated text → ChannelTables, piece by piece.

One row a sample and one column a channel, under a header row. A column called `t`, `time` or
`timestamp` holds the time: in the unit in brackets behind its name, in seconds where there is
none, or as date and time (ISO 8601). A channel's unit stands in brackets behind its name
(`z145-fa [g]`); accelerations are converted to m/s², velocities to
m/s, displacements to m; other quantities stay as they are.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pyarrow as pa
from pyarrow import csv as arrow_csv

from sensors.files.columns import ABSOLUTE, distinct, split_unit, tables_of_columns, time_column
from sensors.files.table import ChannelTable, FileError, whole

MISSING = ("", "nan", "NaN", "NAN", "null", "NULL", "n/a", "N/A", "-nan")
PIECE_BYTES = 2**22  # of text that is read at a time

_CONVERSION = re.compile(r"column #(\d+): Row #(\d+): .* invalid value '(.*)'")
_ZONE = re.compile(r"\d{2}:?\d{2}.*(Z|[+-]\d{2}(:?\d{2})?)$")


@dataclass(frozen=True, slots=True)
class _Head:
    """What the first two rows tell of a text file."""

    titles: list[str]
    skipped: int  # lines before the first sample
    delimiter: str
    first_row: str

    @property
    def decimal_point(self) -> str:
        """Semicolon-separated files are written with either decimal sign: the first row tells."""
        cells = self.first_row.replace(self.delimiter, "")
        return "," if self.delimiter == ";" and "," in cells else "."

    @property
    def time_type(self) -> pa.DataType:
        """Of the time column: date and time, seconds since 1970 to all their digits, or numbers."""
        timed = time_column(self.titles)
        cells = self.first_row.split(self.delimiter)
        cell = cells[timed].strip().strip('"') if timed is not None and timed < len(cells) else ""
        try:
            value = float(cell.replace(self.decimal_point, "."))
        except ValueError:
            stamped = re.match(r"\d{4}-\d{2}-\d{2}", cell)
            zone = "UTC" if _ZONE.search(cell) else None
            return pa.timestamp("ns", tz=zone) if stamped else pa.float64()
        in_seconds = split_unit(self.titles[timed or 0])[1] in ("", "s")
        plain = re.fullmatch(r"\d+\.\d{1,12}", cell)
        return pa.decimal128(32, 12) if in_seconds and plain and value > ABSOLUTE else pa.float64()


def read_csv(path: Path) -> ChannelTable:
    """The channels of a text file.

    Raises FileError: missing or empty file, fewer than two samples, text where a number should
    be, only NaN, a time column that ends before it starts, no channel beside the time.
    """
    return whole(csv_pieces(path), path)


def csv_pieces(path: Path) -> Iterator[ChannelTable]:
    """The channels of a text file in pieces of some megabytes. Raises FileError as it reads."""
    head = _head(path)
    empty = True
    for piece in tables_of_columns(_batches(path, head), head.titles, path):
        empty = False
        yield piece
    if empty:
        raise FileError(f"{path}: 0 sample(s) below the header; at least two are needed")


def _head(path: Path) -> _Head:
    try:
        with path.open(encoding="utf-8-sig", errors="replace") as lines:
            stripped = ((count, raw.strip()) for count, raw in enumerate(lines, start=1))
            rows = (row for row in stripped if row[1] and not row[1].startswith(("#", "%")))
            count, line = next(rows, (0, ""))
            _, following = next(rows, (0, ""))
    except OSError as error:
        raise FileError(f"{path}: {error.strerror or error}") from error
    if not line:
        raise FileError(f"{path}: the file is empty; a header row is needed")
    if "\0" in line:
        raise FileError(f"{path}: this is no text; a table of numbers with a header row is needed")
    delimiter = max(";\t,", key=line.count)
    titles = [name.strip().strip('"') for name in line.split(delimiter)]
    if all(_is_number(title) for title in titles):
        numbered = [f"ch{i + 1}" for i in range(len(titles))]
        return _Head(numbered, count - 1, delimiter, line)
    return _Head(distinct(titles), count, delimiter, following)


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _batches(path: Path, head: _Head) -> Iterator[pa.RecordBatch]:
    timed = time_column(head.titles)
    types = {
        title: head.time_type if i == timed else pa.float64() for i, title in enumerate(head.titles)
    }
    try:
        with arrow_csv.open_csv(
            path,
            # one thread: only then do errors say the row
            read_options=arrow_csv.ReadOptions(
                skip_rows=head.skipped,
                column_names=head.titles,
                use_threads=False,
                block_size=PIECE_BYTES,
            ),
            parse_options=arrow_csv.ParseOptions(delimiter=head.delimiter),
            convert_options=arrow_csv.ConvertOptions(
                null_values=list(MISSING),
                strings_can_be_null=True,
                decimal_point=head.decimal_point,
                column_types=types,
            ),
        ) as reader:
            yield from reader
    except pa.ArrowInvalid as error:
        if "Empty CSV" not in str(error):
            raise FileError(f"{path}: {_in_words(str(error), head)}") from error


def _in_words(error: str, head: _Head) -> str:
    """Arrow's complaint as one line that names column, line and value."""
    found = _CONVERSION.search(error)
    if found is None:
        return " ".join(error.split())
    column, line, value = int(found[1]), found[2], found[3]
    title = head.titles[column]
    if column == time_column(head.titles):
        return (
            f"column {title!r} has {value!r} in line {line}; a time is needed: a number, or "
            "2024-12-31T23:59:59.5, alike in every row"
        )
    return (
        f"column {title!r} has {value!r} in line {line}; "
        "a number is needed (or nothing, for a missing sample)"
    )
