"""Rows on their way into a file: so many are held at most."""

import os
from pathlib import Path

import pyarrow as pa
import pytest
from pyarrow import csv, parquet

from pipeline.export.table_file import Format, TableFile


def test_rows_are_written_in_groups_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pipeline.export.table_file.ROW_GROUP", 4)
    path, schema = tmp_path / "t.parquet", pa.schema([("n", pa.int64())])
    table = TableFile(path, schema, "parquet")
    for n in range(10):
        table.add_rows([(n,)])
    assert table.rows == 10
    table.close()
    whole = parquet.ParquetFile(path)
    assert [whole.metadata.row_group(n).num_rows for n in range(3)] == [4, 4, 2]
    assert whole.read()["n"].to_pylist() == list(range(10))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_a_closed_file_is_whole_and_holds_no_descriptor_while_its_table_is_there(
    tmp_path: Path, form: Format
) -> None:
    path, schema = tmp_path / "t", pa.schema([("n", pa.int64())])
    opened = os.listdir("/proc/self/fd")
    table = TableFile(path, schema, form)
    table.add_rows([(n,) for n in range(10)])
    table.close()
    assert len(os.listdir("/proc/self/fd")) == len(opened)
    whole = csv.read_csv(path) if form == "csv" else parquet.read_table(path)
    assert whole["n"].to_pylist() == list(range(10))


@pytest.mark.parametrize("form", ["csv", "parquet"])
def test_an_unfinished_file_that_is_removed_leaves_nothing_open(
    tmp_path: Path, form: Format
) -> None:
    opened = os.listdir("/proc/self/fd")
    table = TableFile(tmp_path / "t", pa.schema([("n", pa.int64())]), form)
    table.add_rows([(1,)])
    table.remove()
    assert len(os.listdir("/proc/self/fd")) == len(opened)
    assert list(tmp_path.iterdir()) == []
