"""The results of an archive in order, as Parquet, whatever order they come in."""

import shutil
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.export.results import RESULT_TABLES, ResultTable, tables_of
from pipeline.export.table_file import TableFile
from pipeline.messages import Message, ModalEstimate

WRITING = ".writing"  # folder of tables that are not whole yet


@dataclass(slots=True, eq=False)
class _Slot:
    """A place in the order."""

    messages: tuple[Message, ...] | None  # None: still to come


class ReprocessingRecord:
    """Gives on messages in the order of their places, each as soon as all before it are there.

    take   what is done with a message

    Holds no more than what waits for the oldest result that is missing.
    """

    def __init__(self, take: Callable[[Message], None]) -> None:
        self._take = take
        self._slots: deque[_Slot] = deque()
        self._awaited: dict[str, _Slot] = {}
        self.windows = 0  # estimates given on

    def add(self, message: Message) -> None:
        """The next place is this message's."""
        self._slots.append(_Slot((message,)))
        self._give()

    def wait_for(self, key: str) -> None:
        """The next place is that of a result that is to come."""
        slot = self._awaited[key] = _Slot(None)
        self._slots.append(slot)

    def settle(self, key: str, messages: tuple[Message, ...]) -> None:
        """The result has come."""
        self._awaited.pop(key).messages = messages
        self._give()

    def _give(self) -> None:
        while self._slots and self._slots[0].messages is not None:
            for message in self._slots.popleft().messages or ():
                self.windows += isinstance(message, ModalEstimate)
                self._take(message)


class ArchiveTables:
    """One Parquet file a kind of result, each seen only when all are whole.

    folder   where they come to; those of an earlier run are replaced
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._writing = folder / WRITING
        shutil.rmtree(self._writing, ignore_errors=True)
        self._writing.mkdir()
        self._files: dict[str, TableFile] = {}

    def add(self, message: Message) -> None:
        """The rows that the message has in any table."""
        for table in tables_of(message):
            if rows := list(table.rows(message)):
                self._file(table).add_rows(rows)

    def _file(self, table: ResultTable) -> TableFile:
        """A kind of result's file, made when its first rows come."""
        if table.name not in self._files:
            path = self._writing / f"{table.name}.parquet"
            self._files[table.name] = TableFile(path, table.schema, "parquet")
        return self._files[table.name]

    def finished(self) -> tuple[Path, ...]:
        """Close all and give them their names; a kind without rows has no file."""
        for file in self._files.values():
            file.close()
        for table in RESULT_TABLES:
            (self._folder / f"{table.name}.parquet").unlink(missing_ok=True)
        written = [file.path for file in self._files.values()]
        paths = [path.replace(self._folder / path.name) for path in written]
        self._writing.rmdir()
        return tuple(sorted(paths))
