"""Results as Parquet, partitioned by turbine and month, and what is known of months that are whole.

    RESULTS/modes/turbine=T/month=2026-01/modes.parquet      a row group each day
            .months/turbine=T/2026-01.json                   its days, their fingerprints and counts

Folders are named as Hive does, which pyarrow, pandas, polars, DuckDB and Spark read as columns. A
month that gains a day is written again: the row groups of days that are as they were are copied,
so that it has the bytes that it would have had if it had been written at once.
"""

import json
import shutil
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from urllib.parse import quote

import pyarrow as pa
from pyarrow import parquet

from pipeline.export.results import RESULT_TABLES, ResultTable, Row, table_of_rows, tables_of
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from sensors.atomic_write import written_whole

WHOLE_MONTHS = ".months"  # folder of what is known of whole months
WRITING = ".writing"  # folder of a month that is not whole yet
ROW_GROUPS = b"pilewatch.days"  # metadata of a file: fingerprint of each row group's day
PARTITION_KEY = "turbine"  # column that the folder's name holds
SMALL = "zstd"  # compression
UNCOUNTED = "other"


@dataclass(frozen=True, slots=True)
class WrittenDay:
    """One day in a month's files."""

    date: str
    key: str
    """Fingerprint of the history up to it; "" where some of its posteriors failed."""
    identified: int = 0
    rejected: int = 0
    posteriors: int = 0
    events: int = 0


@dataclass(frozen=True, slots=True)
class WrittenMonth:
    """The days of a month that is whole."""

    days: tuple[WrittenDay, ...] = ()
    sizes: dict[str, int] = field(default_factory=dict)
    """Of its file in each table [bytes]."""

    @property
    def keys(self) -> dict[str, str]:
        """Date → fingerprint of the history up to it."""
        return {day.date: day.key for day in self.days if day.key}


def partition(folder: Path, table: str, turbine: str, month: str) -> Path:
    """Return the file of a turbine's month in a table."""
    return folder / table / _named(turbine) / f"month={month}" / f"{table}.parquet"


def _named(turbine: str) -> str:
    return f"{PARTITION_KEY}={quote(turbine, safe='')}"


def _manifest(folder: Path, turbine: str, month: str) -> Path:
    return folder / WHOLE_MONTHS / _named(turbine) / f"{month}.json"


def written_months(folder: Path, turbine: str) -> dict[str, WrittenMonth]:
    """Return the months of a turbine that are whole; one of which a file is gone or cut is not."""
    found = {}
    for path in sorted((folder / WHOLE_MONTHS / _named(turbine)).glob("*.json")):
        try:
            content = json.loads(path.read_bytes())
            days = tuple(WrittenDay(**day) for day in content["days"])
            month = WrittenMonth(days, dict(content["sizes"]))
        except (OSError, ValueError, KeyError, TypeError):
            continue  # damaged: the month is written again
        if all(
            _size(partition(folder, table, turbine, path.stem)) == size
            for table, size in month.sizes.items()
        ):
            found[path.stem] = month
    return found


def _size(path: Path) -> int | None:
    try:
        return path.stat().st_size
    except OSError:
        return None


def forget_months(folder: Path, turbine: str, months: Iterable[str]) -> None:
    """Remove months that the archive has no more."""
    for month in months:
        for table in RESULT_TABLES:
            shutil.rmtree(partition(folder, table.name, turbine, month).parent, ignore_errors=True)
        _manifest(folder, turbine, month).unlink(missing_ok=True)


class MonthWriter:
    """Writes the files of one turbine's month, day by day, and gives them their names at the end.

    Parameters
    ----------
    folder : Path
        Of the results.
    turbine : str
        Its id.
    month : str
        Of the files.
    before : WrittenMonth
        What its files hold now.
    """

    def __init__(self, folder: Path, turbine: str, month: str, before: WrittenMonth) -> None:
        self._folder, self._turbine, self._month = folder, turbine, month
        self._writing = folder / WRITING / _named(turbine) / month
        shutil.rmtree(self._writing, ignore_errors=True)
        self._writing.mkdir(parents=True)
        self._files: dict[str, _DayFile] = {}
        self._days: list[WrittenDay] = []
        self._before = before

    def copied(self, key: str) -> bool:
        """Take over a day from the files that are there; whether they have it."""
        known = {day.key: day for day in self._before.days if day.key}
        if key not in known:
            return False
        for table in RESULT_TABLES:
            if table.name in self._before.sizes:
                rows = _rows_of_day(self._path(table), key)
                if rows is not None:
                    self._file(table).add(rows, key)
        self._days.append(known[key])
        return True

    def add(self, date: str, key: str, messages: Iterable[Message], *, whole: bool) -> None:
        """Add a day's results in order.

        Parameters
        ----------
        date : str
            Of the day.
        key : str
            Fingerprint of the history up to it.
        messages : iterable of Message
            The results.
        whole : bool
            Whether all are there; else the day is done again by the next run.
        """
        rows: dict[str, list[Row]] = {}
        counts: Counter[str] = Counter()
        for message in messages:
            counts[_kind(message)] += 1
            for table in tables_of(message):
                rows.setdefault(table.name, []).extend(row[1:] for row in table.rows(message))
        for table in RESULT_TABLES:
            if found := rows.get(table.name):
                self._file(table).add(table_of_rows(found, _schema(table)), key)
        del counts[UNCOUNTED]
        self._days.append(WrittenDay(date, key if whole else "", **counts))

    def finished(self) -> WrittenMonth:
        """Close all and give them their names; the month is known as whole from then on."""
        sizes = {}
        for table in RESULT_TABLES:
            path = self._path(table)
            if table.name not in self._files:
                path.unlink(missing_ok=True)
                continue
            written = self._files[table.name].closed()
            path.parent.mkdir(parents=True, exist_ok=True)
            sizes[table.name] = written.replace(path).stat().st_size
        month = WrittenMonth(tuple(self._days), sizes)
        manifest = _manifest(self._folder, self._turbine, self._month)
        manifest.parent.mkdir(parents=True, exist_ok=True)
        content = {"days": [asdict(day) for day in month.days], "sizes": sizes}
        written_whole(manifest, json.dumps(content).encode())
        shutil.rmtree(self._writing, ignore_errors=True)
        return month

    def _path(self, table: ResultTable) -> Path:
        return partition(self._folder, table.name, self._turbine, self._month)

    def _file(self, table: ResultTable) -> "_DayFile":
        """Return the file of a table, made when its first rows come."""
        if table.name not in self._files:
            self._files[table.name] = _DayFile(self._writing / f"{table.name}.parquet", table)
        return self._files[table.name]


class _DayFile:
    """A Parquet file with a row group for each day."""

    def __init__(self, path: Path, table: ResultTable) -> None:
        schema = _schema(table)
        real = [each.name for each in schema if pa.types.is_floating(each.type)]
        others = [each.name for each in schema if each.name not in real]
        self._path = path
        self._keys: list[str] = []
        self._writer = parquet.ParquetWriter(
            path,
            schema,
            compression=SMALL,
            use_dictionary=others,
            use_byte_stream_split=real,
            store_schema=False,
        )

    def add(self, rows: pa.Table, key: str) -> None:
        self._writer.write_table(rows, row_group_size=max(1, len(rows)))
        self._keys.append(key)

    def closed(self) -> Path:
        self._writer.add_key_value_metadata({ROW_GROUPS.decode(): json.dumps(self._keys)})
        self._writer.close()
        return self._path


def _rows_of_day(path: Path, key: str) -> pa.Table | None:
    """Return the row group of a day; None where the day has no rows of that kind."""
    with parquet.ParquetFile(path) as file:
        keys = json.loads(file.metadata.metadata[ROW_GROUPS])
        return file.read_row_group(keys.index(key)) if key in keys else None


def _schema(table: ResultTable) -> pa.Schema:
    """Return the schema of the table's files, which lack the column that the folder names."""
    name, *_ = table.schema.names
    assert name == PARTITION_KEY
    return table.schema.remove(0)


def _kind(message: Message) -> str:
    """Under what name a message is counted."""
    match message:
        case ModalEstimate():
            return "identified"
        case WindowRejected():
            return "rejected"
        case FoundationPosterior():
            return "posteriors"
        case FoundationEvent():
            return "events"
    return UNCOUNTED


def tables_in(folder: Path) -> Iterator[Path]:
    """Folder of every table that has rows."""
    for table in RESULT_TABLES:
        if (folder / table.name).is_dir():
            yield folder / table.name
