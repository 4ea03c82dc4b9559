"""Text of numbers in columns → ChannelTables, chunk by chunk.

One row a sample and one column a channel, kept apart by commas, semicolons, tabs or blanks, with a
decimal point or comma, in UTF-8, UTF-16 or Latin-1, perhaps zipped by gzip. A column called `t`,
`time` or `timestamp` (or a word like it) holds the time: in the unit in brackets behind its name or
in the row below, or as date and time. A channel's unit stands in brackets behind its name
(`z145-fa [g]`) or in the row below; accelerations are converted to m/s², velocities to m/s,
displacements to m; other quantities stay as they are.
"""

import re
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import csv as arrow_csv

from sensors.files.missing_values import MISSING
from sensors.files.table import EVERYTHING, ChannelTable, FileError, Wanted
from sensors.files.text.columns import convert_batches
from sensors.files.text.decoding import UNREADABLE, open_arrow_stream
from sensors.files.text.dialect import COMMENT, TextHead, read_head

CHUNK_BYTES = 2**22  # of text that is read at a time

_CONVERSION = re.compile(r"column #(\d+): Row #(\d+): .* invalid value '(.*)'")
_GROUPED_THOUSANDS = re.compile(r"\s*[+-]?\d{1,3}([.,'’\s]\d{3})+(?!\d)")
_COUNT = re.compile(r"Row #(\d+): Expected (\d+) columns, got (\d+)")


def read_csv_chunks(path: Path, wanted: Wanted = EVERYTHING) -> Iterator[ChannelTable]:
    """Yield the channels of a text file in chunks of some megabytes.

    Raises
    ------
    FileError
        As it reads.
    """
    head = read_head(path, wanted)
    yield from convert_batches(_batches(path, head), head.columns, path)


def _batches(path: Path, head: TextHead) -> Iterator[pa.RecordBatch]:
    try:
        with (
            open_arrow_stream(
                path, head.encoding, blanks=head.delimiter == " ", nul=head.nul
            ) as stream,
            arrow_csv.open_csv(
                stream,
                # one thread: only then do errors name the row
                read_options=arrow_csv.ReadOptions(
                    skip_rows=head.skipped,
                    column_names=_column_names(head),
                    use_threads=False,
                    block_size=CHUNK_BYTES,
                ),
                parse_options=_parsing(head.delimiter),
                convert_options=_conversion(head),
            ) as reader,
        ):
            yield from reader
    except pa.ArrowInvalid as error:
        if "Empty CSV" not in str(error):
            raise FileError(f"{path}: {_explain(str(error), head)}") from error
    except UNREADABLE as error:
        reason = getattr(error, "strerror", None) or error
        raise FileError(f"{path}: it cannot be read to its end: {reason}") from error


def _column_names(head: TextHead) -> list[str]:
    """Names for Arrow's columns, no two alike."""
    return [str(number) for number in range(len(head.columns.all))]


@cache
def _parsing(delimiter: str) -> arrow_csv.ParseOptions:
    """Return how rows are parsed.

    Kept for good: Arrow's thread, which may outlive a reader that was left before its end, must
    not be the last to let go of a Python function while the interpreter ends.
    """
    return arrow_csv.ParseOptions(delimiter=delimiter, invalid_row_handler=_comments_are_skipped)


def _comments_are_skipped(row: Any) -> str:
    text = (row.text or "").strip()
    return "skip" if not text or text.startswith(COMMENT) else "error"


def _conversion(head: TextHead) -> arrow_csv.ConvertOptions:
    columns = head.columns
    types: dict[str, pa.DataType] = {str(i): pa.float64() for i in columns.channels}
    for i in columns.clock:
        is_number = columns.all[i].kind == "number" and len(columns.clock) == 1
        exact = pa.decimal128(32, 12) if head.exact_time else pa.float64()
        types[str(i)] = exact if is_number else pa.string()
    spelled = {each for word in MISSING for each in (word, word.upper(), word.capitalize())}
    return arrow_csv.ConvertOptions(
        null_values=sorted(spelled | {"NaN", "-NaN", "#NAME?", *head.missing}),
        strings_can_be_null=True,
        decimal_point=head.decimal_point,
        column_types=types,
        include_columns=[str(i) for i in columns.used],
    )


def _explain(error: str, head: TextHead) -> str:
    """Arrow's error as one line that names column, line and value."""
    uneven = _COUNT.search(error)
    if uneven is not None:
        return f"line {uneven[1]} has {uneven[3]} columns where {uneven[2]} are expected"
    found = _CONVERSION.search(error)
    if found is None:
        return " ".join(error.split())
    column, line, value = int(found[1]), found[2], found[3]
    title = head.columns.all[column].title
    if column in head.columns.clock:
        return (
            f"column {title!r} has {value!r} in line {line}; a time is needed: a number, or "
            "2024-12-31T23:59:59.5, alike in every row"
        )
    between = ", without a mark between thousands" if _GROUPED_THOUSANDS.match(value) else ""
    return (
        f"column {title!r} has {value!r} in line {line}; "
        f"a number is needed{between} (or nothing, for a missing sample)"
    )
