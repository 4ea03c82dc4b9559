"""Parquet → ChannelTables, row group by row group.

One column a channel, its unit in brackets behind its name or in the field's metadata (`unit`). A
column called `t`, `time` or `timestamp`, else the first one of dates, holds the time, as in text
files.
"""

from collections.abc import Iterator
from pathlib import Path

import pyarrow as pa
from pyarrow import parquet

from sensors.files.columns import split_unit, tables_of_columns, time_column
from sensors.files.table import ChannelTable, FileError

ROWS = 2**16  # that are read at a time


def parquet_pieces(path: Path) -> Iterator[ChannelTable]:
    """The channels of a Parquet file in pieces. Raises FileError as it reads."""
    try:
        with parquet.ParquetFile(path) as file:
            titles = _titles(file.schema_arrow)
            yield from tables_of_columns(file.iter_batches(batch_size=ROWS), titles, path)
    except (OSError, pa.ArrowException) as error:
        reason = getattr(error, "strerror", None) or " ".join(str(error).split())
        raise FileError(f"{path}: no readable Parquet file: {reason}") from error


def _titles(schema: pa.Schema) -> list[str]:
    titles = [_title(field) for field in schema]
    if time_column(titles) is None:
        dates = next(
            (i for i, each in enumerate(schema.types) if pa.types.is_timestamp(each)), None
        )
        if dates is not None:
            titles[dates] = "time"
    return titles


def _title(field: pa.Field) -> str:
    unit = (field.metadata or {}).get(b"unit", b"").decode("utf-8", "replace")
    return f"{field.name} [{unit}]" if unit and not split_unit(field.name)[1] else str(field.name)
