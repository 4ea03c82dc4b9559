"""Parquet → ChannelTables, row group by row group.

One column a channel, its unit in brackets behind its name or in the field's metadata (`unit`). A
column called `t`, `time` or `timestamp` (or a word like it), else the first one of dates, holds the
time, as in text files. Columns of text are left out.
"""

from collections.abc import Iterator
from itertools import chain
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from sensors.files.table import EVERYTHING, ChannelTable, FileError, Wanted, readable, require_file
from sensors.files.text.column_titles import distinct, split_unit
from sensors.files.text.columns import (
    Column,
    ColumnKind,
    convert_batches,
    renamed_columns,
    sort_columns,
)
from sensors.files.text.dates import kind_of_text

ROWS_OF_BATCH = 2**16  # that are read at a time
LOOKED_AT = 60  # of the first rows, to find the kind of a column


def read_parquet_chunks(path: Path, wanted: Wanted = EVERYTHING) -> Iterator[ChannelTable]:
    """Yield the channels of a Parquet file in chunks.

    Raises
    ------
    FileError
        As it reads.
    """
    damage = (OSError, UnicodeError, pa.ArrowException)
    with readable(path, "Parquet file", *damage), parquet.ParquetFile(require_file(path)) as file:
        batches = file.iter_batches(batch_size=ROWS_OF_BATCH)
        first = next(batches, None)
        if first is None:
            raise FileError(f"{path}: 0 samples; at least two are needed")
        columns = sort_columns(_columns(file.schema_arrow, first), path, wanted)
        given = [name for name, _ in map(_title, file.schema_arrow)]
        columns = renamed_columns(given, columns, path)
        used = (batch.select(list(columns.used)) for batch in chain((first,), batches))
        yield from convert_batches(used, columns, path)


def _columns(schema: pa.Schema, batch: pa.RecordBatch) -> list[Column]:
    titles = [_title(field) for field in schema]
    names = distinct([name for name, _ in titles])
    return [
        Column(name, unit, *_kind_and_first(batch.column(i)))
        for i, (name, (_, unit)) in enumerate(zip(names, titles, strict=True))
    ]


def _title(field: pa.Field) -> tuple[str, str]:
    unit = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    name, in_brackets = split_unit(field.name)
    return (name, in_brackets) if in_brackets else (field.name, unit)


def _kind_and_first(column: pa.Array) -> tuple[ColumnKind, list[float] | list[str]]:
    some = column[:LOOKED_AT].drop_null()
    kind = some.type.value_type if pa.types.is_dictionary(some.type) else some.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind):
        texts = [str(each) for each in some.to_pylist()]
        return (kind_of_text(texts[0]) if texts else None) or "text", texts
    if pa.types.is_temporal(kind):
        return "moment", []
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        return "number", [float(each) for each in some.to_pylist()]
    return "text" if pa.types.is_boolean(kind) else "empty", []
