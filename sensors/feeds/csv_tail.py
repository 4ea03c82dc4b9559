"""A CSV file that grows, as controllers and gateways write it: every new row is a SCADA sample.

    scada+csv:/var/log/turbine.csv[?from=end]

The first row names the columns; it may come again. A file that is renamed and started again, or
emptied, is followed: what the old one still got is read first. Rows that are not later than the
last one are counted, not given; so is one whose time leaps, unless those behind it agree.
"""

import asyncio
import csv
import logging
import os
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

from sensors.acquisition.scada import ScadaSample
from sensors.feeds.address import FeedAddress
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.scada import RisingTimes, ScadaReader
from sensors.feeds.protocol import ArrivalQueue, FeedCounts
from sensors.feeds.reconnect import LinkError, kept_connected

logger = logging.getLogger(__name__)

POLL = 0.2  # how often the file is looked at [s]
LONGEST_ROW = 2**16  # [bytes]
READ_AT_ONCE = 2**20  # read at once [bytes]
_SEPARATORS = (";", "\t", ",")  # the first that a header has


class CsvTailFeed:
    """The rows of one growing file.

    Parameters
    ----------
    address : FeedAddress
        Of the file, with its options.
    reader : ScadaReader
        Of the rows.
    once : bool
        Give up where the file is not there at the start.
    """

    def __init__(self, address: FeedAddress, reader: ScadaReader, *, once: bool) -> None:
        self.name = address.text
        self.counts = FeedCounts()
        self._path = Path(address.path)
        self._from_start = address.one_of("from", ("end", "start")) == "start"
        self._rows = Rows(reader, self.counts)
        self._once = once

    async def run(self, inbox: ArrivalQueue) -> None:
        """Raises FeedError where there is no such file and `once` is asked for."""

        async def session() -> None:
            await self._follow(inbox)

        await kept_connected(session, self.name, self.counts, once=self._once)

    async def _follow(self, inbox: ArrivalQueue) -> None:
        """Until the file is gone."""
        try:
            with self._path.open("rb") as file:
                again = self.counts.connect()
                whole = self._from_start or again  # what came while it was away is new
                self._rows.begin(file, from_start=whole)
                while True:
                    replaced = self._is_replaced(file)  # looked at first: then it gets no more
                    await self._take(file, inbox)
                    if replaced:
                        raise LinkError("the file was replaced or removed")
                    await asyncio.sleep(POLL)
        except OSError as error:
            raise LinkError(f"{error.strerror or error}") from error

    async def _take(self, file: BinaryIO, inbox: ArrivalQueue) -> None:
        if os.fstat(file.fileno()).st_size < file.tell():
            self._rows.begin(file, from_start=True)  # it was emptied
        for line in self._rows.lines(file):
            for sample in self._rows.samples(line):
                await inbox.put(sample)
            await asyncio.sleep(0)  # a long file of nonsense holds nothing up

    def _is_replaced(self, file: BinaryIO) -> bool:
        try:
            return os.stat(self._path).st_ino != os.fstat(file.fileno()).st_ino
        except FileNotFoundError:
            return True


class Rows:
    """The rows of a file and of those that follow it."""

    def __init__(self, reader: ScadaReader, counts: FeedCounts) -> None:
        self._reader, self._counts = reader, counts
        self._columns: list[str] = []
        self._separator = ","
        self._times = RisingTimes(counts)
        self._part = b""  # of a row that is being written
        self._overlong = False  # the row's beginning was too long already

    def begin(self, file: BinaryIO, *, from_start: bool) -> None:
        """Go to where the new rows begin.

        Raises LinkError for a file that has no header yet.
        """
        file.seek(0)
        self._part, self._overlong = b"", False
        if from_start:
            return
        header = file.readline(LONGEST_ROW)
        if not header.endswith(b"\n"):
            raise LinkError("no row that names the columns yet")
        self._take_header(header)
        file.seek(0, os.SEEK_END)

    def lines(self, file: BinaryIO) -> Iterator[bytes]:
        """Yield the rows that have been finished since."""
        while chunk := file.read(READ_AT_ONCE):
            *lines, self._part = (self._part + chunk).split(b"\n")
            for line in lines:
                if self._overlong or len(line) > LONGEST_ROW:
                    self._counts.refuse(f"a row of more than {LONGEST_ROW} bytes")
                    self._overlong = False
                elif line.strip():
                    yield line
            if len(self._part) > LONGEST_ROW:
                self._part, self._overlong = b"", True

    def samples(self, line: bytes) -> list[ScadaSample]:
        """Return what a row reports; nothing of a header, and of what is counted instead."""
        if self._is_header(line):
            self._take_header(line)
            return []
        self._counts.received += 1
        try:
            return self._times.taken(self._reader.sample(self._by_column(line)))
        except MessageError as error:
            self._counts.refuse(f"row {line[:40]!r}: {error}")
            return []

    def _is_header(self, line: bytes) -> bool:
        return not self._columns or self._reader.names[0] in self._cells(line)

    def _take_header(self, line: bytes) -> None:
        text = line.decode("utf-8-sig", "replace")
        self._separator = next((each for each in _SEPARATORS if each in text), ",")
        self._columns = self._cells(line)

    def _by_column(self, line: bytes) -> dict[str, str]:
        cells = self._cells(line)
        if len(cells) != len(self._columns):
            raise MessageError(f"{len(cells)} cells under {len(self._columns)} names")
        if self._separator == ";":  # then a comma is a decimal point
            cells = [cell.replace(",", ".") for cell in cells]
        return dict(zip(self._columns, cells, strict=True))

    def _cells(self, line: bytes) -> list[str]:
        text = line.decode("utf-8-sig", "replace").strip("\r\n")
        try:
            return [cell.strip() for cell in next(csv.reader([text], delimiter=self._separator))]
        except (csv.Error, StopIteration):
            return []
