"""Write one table into a file, part by part."""

from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, BinaryIO, Literal

import pyarrow as pa
from pyarrow import csv, parquet

from sensors.errors import InputError

Format = Literal["csv", "parquet"]

TIMESTAMP = pa.timestamp("ns", tz="UTC")
FORMULA = ("=", "+", "-", "@", "\t", "\r")  # what a spreadsheet may run when a cell begins so
ROW_GROUP = 16_384  # rows that are held and written together: seven minutes at 40 Hz


class TableFile:
    """Write rows to `path`, a CSV with a header row or a Parquet file of row groups.

    Parameters
    ----------
    schema : pa.Schema
        Names and types of the columns; its metadata goes into a Parquet file.

    Raises
    ------
    InputError
        If the file exists or cannot be created.
    """

    def __init__(self, path: Path, schema: pa.Schema, form: Format) -> None:
        self.path = path
        self.schema = schema
        self.rows = 0  # written and held
        self._held: list[pa.Table] = []
        self._held_rows: list[Sequence[Any]] = []  # not yet a table
        self._n_held = 0
        self._file = new_file(path)
        self._is_text = form == "csv"
        self._writer: Any = (
            csv.CSVWriter(self._file, pa.schema([_harmless_field(each) for each in schema]))
            if self._is_text
            else parquet.ParquetWriter(self._file, schema)
        )

    def add_rows(self, rows: Sequence[Sequence[Any]]) -> None:
        """Add rows of values in the order of the columns."""
        self._held_rows += rows
        self._count(len(rows))

    def add(self, part: pa.Table) -> None:
        """Add rows as a table of the schema."""
        self._held.append(part)
        self._count(len(part))

    def close(self) -> None:
        """Write what is held and finish the file."""
        self._write()
        self._writer.close()
        self._file.close()

    def remove(self) -> None:
        """Close and remove an unfinished file."""
        with suppress(OSError, pa.ArrowException):
            self._writer.close()
        with suppress(OSError):  # what it still holds finds no room either
            self._file.close()
        self.path.unlink(missing_ok=True)

    def _count(self, rows: int) -> None:
        self.rows += rows
        self._n_held += rows
        if self._n_held >= ROW_GROUP:
            self._write()

    def _write(self) -> None:
        if self._held_rows:
            columns = zip(*self._held_rows, strict=True)
            fields = zip(columns, self.schema, strict=True)
            arrays = [pa.array(column, field.type) for column, field in fields]
            self._held.append(pa.Table.from_arrays(arrays, schema=self.schema))
        if self._held:
            table = pa.concat_tables(self._held).combine_chunks()
            self._writer.write_table(_harmless(table) if self._is_text else table)
        self._held, self._held_rows, self._n_held = [], [], 0


def _harmless_text(text: str | None) -> str | None:
    """Return a text that no spreadsheet takes for a formula. Source: OWASP, CSV injection."""
    return f"'{text}" if text and text != "-" and text.startswith(FORMULA) else text


def _harmless_field(field: pa.Field) -> pa.Field:
    return field.with_name(_harmless_text(field.name))


def _harmless(table: pa.Table) -> pa.Table:
    columns = [
        pa.array([_harmless_text(each) for each in column.to_pylist()], column.type)
        if pa.types.is_string(column.type)
        else column
        for column in table.columns
    ]
    names = [_harmless_text(name) for name in table.column_names]
    return pa.Table.from_arrays(columns, names=names)


def new_file(path: Path) -> BinaryIO:
    """Open a file that does not exist yet; its folder is made. Raises InputError."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        return path.open("xb")
    except FileExistsError:
        raise InputError(f"{path} exists already; name another folder with -o") from None
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror or error}") from error
