"""Export a recording, or a session's folder, into a folder of tables."""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from pipeline.export.results import RESULT_TABLES, ResultTable, tables_of
from pipeline.export.samples import samples_schema, samples_table
from pipeline.export.table_file import Format, TableFile
from pipeline.recording.reader import read_metadata
from pipeline.sources.recorded_stream import SensorMessage, each_block_once, sensor_messages
from pipeline.sources.session_files import session_files, session_messages
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.replayed import ReplayedTower
from sensors.errors import InputError


@dataclass(frozen=True, slots=True)
class Exported:
    """One file that was written."""

    path: Path
    rows: int


def export(
    recording: Path,
    folder: Path,
    form: Format,
    *,
    report: Callable[[AccelerationBlock], None] | None = None,
) -> tuple[Exported, ...]:
    """Write the samples and the results of a recording; kinds without rows make no file.

    Parameters
    ----------
    recording : Path
        A file, or a folder with a session's parts and earlier starts.
    folder : Path
        Created where it is missing.
    report : Callable[[AccelerationBlock], None] | None, optional
        Called with every block of accelerations.

    Raises
    ------
    RecordingError, SourceError, InputError
        If a file exists or cannot be written.
    """
    files = session_files(recording)
    for file in files:
        read_metadata(file)  # before a folder is made for nothing
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"-o {folder}: {error.strerror}; a folder is needed") from error
    with _table_files(folder, form) as tables:
        _export_samples(files, tables, report)
        _export_results(files, tables)
    return tuple(Exported(table.path, table.rows) for table in tables.open.values())


class _TableFiles:
    """The files of an export, each opened with its first row."""

    def __init__(self, folder: Path, form: Format) -> None:
        self.open: dict[str, TableFile] = {}
        self.form: Format = form
        self._folder = folder
        self._units: dict[tuple[str, str, str, int], TableFile] = {}

    def of_unit(self, block: AccelerationBlock, layout: SensorLayout | None) -> TableFile:
        """Return the file of a unit's samples; a change of its channels starts another file."""
        key = (block.turbine, block.unit, block.layout_id, block.samples.shape[1])
        if key not in self._units:
            plain = f"samples-{_as_name(block.turbine)}-{_as_name(block.unit)}"
            name, number = plain, 1
            while name in self.open:
                name, number = f"{plain}-{number + 1}", number + 1
            schema = samples_schema(block, layout, self.form)
            self._units[key] = self.open[name] = TableFile(self._path(name), schema, self.form)
        return self._units[key]

    def of_results(self, table: ResultTable) -> TableFile:
        """Return the file of one kind of result."""
        if table.name not in self.open:
            self.open[table.name] = TableFile(self._path(table.name), table.schema, self.form)
        return self.open[table.name]

    def _path(self, name: str) -> Path:
        return self._folder / f"{name}.{self.form}"


@contextmanager
def _table_files(folder: Path, form: Format) -> Iterator[_TableFiles]:
    """Open the files of an export; remove all where writing fails or is interrupted.

    Raises
    ------
    InputError
        If a disk is full.
    """
    tables = _TableFiles(folder, form)
    try:
        yield tables
        for table in tables.open.values():
            table.close()
    except BaseException as error:
        for table in tables.open.values():
            table.remove()
        if isinstance(error, OSError):
            reason = error.strerror or error
            raise InputError(f"cannot write to {folder}: {reason}; nothing was left") from error
        raise


def _export_samples(
    files: list[Path],
    tables: _TableFiles,
    report: Callable[[AccelerationBlock], None] | None,
) -> None:
    for block, layout in recorded_samples(files):
        table = tables.of_unit(block, layout)
        table.add(samples_table(block, table.schema))
        if report:
            report(block)


def recorded_samples(
    files: list[Path],
) -> Iterator[tuple[AccelerationBlock, SensorLayout | None]]:
    """Yield each block once, in order of time, with its layout where that is known."""
    layouts: dict[tuple[str, str, str], SensorLayout] = {}  # ids are of one unit alone
    recorded: Iterator[SensorMessage] = (each for file in files for each in sensor_messages(file))
    for message in each_block_once(ReplayedTower(recorded)):
        if isinstance(message, SensorLayout):
            layouts[message.turbine, message.unit, message.layout_id] = message
        elif isinstance(message, AccelerationBlock):
            yield message, layouts.get((message.turbine, message.unit, message.layout_id))


def _export_results(files: list[Path], tables: _TableFiles) -> None:
    wanted = tuple(dict.fromkeys(table.message for table in RESULT_TABLES))
    for message in session_messages(files, wanted):
        for table in tables_of(message):
            if rows := list(table.rows(message)):
                tables.of_results(table).add_rows(rows)


def _as_name(text: str) -> str:
    """Part of a file's name."""
    return re.sub(r"[^\w.-]", "_", text)
