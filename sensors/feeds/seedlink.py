"""SeedLink 3: miniSEED records from a seismological data logger or server (needs obspy, extra
`miniseed`).

    seedlink://HOST[:18000]/NET.STA[.LOC.CHA][,NET.STA…]      * stands for any one letter in LOC.CHA

    client                                server
    HELLO                                 two lines of text
    STATION STA NET                       OK
    SELECT LOCCHA                         OK
    DATA [the sequence to go on with]     OK
    END                                   packets, without end: "SL", 6 hexadecimal digits of the
                                          sequence, 512 bytes of miniSEED
    INFO ID, when nothing comes           a packet of text: the link is alive

Every NET.STA.LOC.CHA is a channel (NET.STA..CHA without a location); samples are a digitiser's
counts, of which the layout's `sensitivity` and `unit` make accelerations. A link that was cut goes
on with the sequence behind the last packet: the server gives again what it still has. Sequences
count everything of a station (or of a server), asked for or not: what is lost is told by the gaps
in time, not by them.

Why not obspy's own client: it sleeps half a second whenever nothing is there, in a loop that
nothing else can run beside. Its reading of records is used.

Source: SeedLink protocol 3.1 (International Federation of Digital Seismograph Networks); SEED
manual 2.4.
"""

import asyncio
import io
import logging
import os
import re
import warnings
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from sensors.feeds.address import FeedAddress
from sensors.feeds.payloads.frame import HIGHEST_RATE, LOWEST_RATE
from sensors.feeds.payloads.timestamps import LATEST_NS
from sensors.feeds.protocol import ChannelSamples, FeedCounts, FeedError, Inbox
from sensors.feeds.reconnect import LinkError, kept_connected

logger = logging.getLogger(__name__)

PACKET_BYTES = 8 + 512
QUIET = 30.0  # after so long without a packet the server is asked whether it lives [s]
ANSWER = 10.0  # for the server's answers [s]
LONGEST_LINE = 1024  # [bytes]

# Sequence number, quality, and the names of station, location, channel and network, in ASCII: what
# is none of this, libmseed complains of on the terminal.
_HEADER = re.compile(rb"[0-9 ]{6}[DRQM][ \0][A-Z0-9 ]{12}", re.IGNORECASE)

_STATION = re.compile(
    r"(?P<net>\w{1,2})\.(?P<sta>\w{1,5})(\.(?P<loc>[\w*]{0,2})\.(?P<cha>[\w*]{3}))?"
)


@dataclass(slots=True)
class Station:
    """One station, and how far it has been read."""

    network: str
    station: str
    selectors: list[str]  # LOCCHA with ? for any letter; none: everything
    sequence: int | None = None  # of the last packet; None before the first


def stations_of(address: FeedAddress) -> list[Station]:
    """The stations that an address names. Raises FeedError for what is none."""
    stations: dict[tuple[str, str], Station] = {}
    for written in address.path.split(","):
        found = _STATION.fullmatch(written)
        if found is None:
            raise FeedError(
                f"{address.text}: {written!r} is no station; NET.STA or NET.STA.LOC.CHA, "
                "e.g. XX.TOWER or XX.TOWER.00.HN*"
            )
        key = found["net"], found["sta"]
        station = stations.setdefault(key, Station(*key, []))
        if found["cha"]:
            station.selectors.append(f"{found['loc']}{found['cha']}".replace("*", "?"))
    return list(stations.values())


class SeedLinkFeed:
    """The records of some stations of one server.

    once   give up where the server cannot be reached at the start
    quiet  after so long without a packet the server is asked whether it lives [s]

    Raises FeedError where obspy is missing, and for stations that are none.
    """

    def __init__(self, address: FeedAddress, *, once: bool, quiet: float = QUIET) -> None:
        self.name = address.text
        self.counts = FeedCounts()
        self._host, self._port = address.host, address.port
        self._stations = stations_of(address)
        self._obspy = _obspy()
        self._once, self._quiet = once, quiet

    async def run(self, inbox: Inbox) -> None:
        """Raises FeedError for stations that the server refuses at the start."""

        async def session() -> None:
            await self._session(inbox)

        await kept_connected(session, self.name, self.counts, once=self._once)

    async def _session(self, inbox: Inbox) -> None:
        async with _connection(self._host, self._port) as (reader, writer):
            await self._negotiate(reader, writer)
            if self.counts.connect():
                logger.warning("%s: connected again", self.name)
            async for sequence, record in self._packets(reader, writer):
                for piece in self.pieces_of(sequence, record):
                    await inbox.put(piece)

    async def _negotiate(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        writer.write(b"HELLO\r\n")
        greeting = await _line(reader)
        await _line(reader)
        if not greeting.upper().startswith(b"SEEDLINK"):
            raise LinkError(f"this is no SeedLink server: it says {greeting[:40]!r}")
        for station in self._stations:
            await self._ask(reader, writer, f"STATION {station.station} {station.network}")
            for selector in station.selectors:
                await self._ask(reader, writer, f"SELECT {selector}")
            following = "" if station.sequence is None else f" {_next(station.sequence):06X}"
            await self._ask(reader, writer, f"DATA{following}")
        writer.write(b"END\r\n")

    async def _ask(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter, command: str
    ) -> None:
        writer.write(f"{command}\r\n".encode())
        answer = await _line(reader)
        if answer.upper().startswith(b"OK"):
            return
        if self.counts.connections:
            raise LinkError(f"the server refuses {command!r}")
        raise FeedError(f"{self.name}: the server refuses {command!r}: {answer.decode('latin1')}")

    async def _packets(
        self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> AsyncIterator[tuple[int, bytes]]:
        """Sequence and record of each packet."""
        asked = False
        while True:
            try:
                packet = await asyncio.wait_for(reader.readexactly(PACKET_BYTES), self._quiet)
            except TimeoutError:
                if asked:
                    raise LinkError(f"nothing for {2 * self._quiet:g} s") from None
                writer.write(b"INFO ID\r\n")
                asked = True
                continue
            except asyncio.IncompleteReadError as error:
                said = f" with {error.partial[:20]!r}" if error.partial else ""
                raise LinkError(f"the server ended it{said}") from error
            asked = False
            head = packet[:8]
            if head.startswith(b"SLINFO"):
                continue
            try:
                sequence = int(head[2:], 16)
            except ValueError:
                sequence = -1
            if not head.startswith(b"SL") or sequence < 0:
                raise LinkError(f"a packet that begins with {head!r}")
            yield sequence, packet[8:]

    def pieces_of(self, sequence: int, record: bytes) -> Iterator[ChannelSamples]:
        """The samples in a packet; one that has none is counted."""
        self.counts.received += 1
        if not _HEADER.match(record):
            self.counts.refuse(f"packet {sequence:06X} is no miniSEED: {record[:20]!r}")
            return
        try:
            traces = self._traces(record)
        except Exception as error:  # noqa: BLE001  # obspy raises bare Exceptions
            reason = " ".join(str(error).split())
            self.counts.refuse(f"packet {sequence:06X} is no readable miniSEED: {reason}")
            return
        for trace in traces:
            stats = trace.stats
            self._note(stats.network, stats.station, sequence)
            timed = 0 <= stats.starttime.ns < LATEST_NS
            numbers = trace.data.dtype.kind in "if"  # not the text of a log record
            if numbers and timed and LOWEST_RATE <= stats.sampling_rate <= HIGHEST_RATE:
                yield ChannelSamples(
                    trace.id,
                    (trace.id,),
                    np.asarray(trace.data, dtype=np.float64).reshape(-1, 1),
                    int(stats.starttime.ns),
                    float(stats.sampling_rate),
                )

    def _traces(self, record: bytes) -> Any:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of records that say nothing of themselves
            return self._obspy.read(io.BytesIO(record), format="MSEED")

    def _note(self, network: str, name: str, sequence: int) -> None:
        """From here the station goes on when the link is cut."""
        for station in self._stations:
            if (station.network, station.station) == (network, name):
                station.sequence = sequence


def _reason(error: OSError) -> str:
    """In few words: asyncio puts the address where the system's words belong."""
    return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)


def _next(sequence: int) -> int:
    return (sequence + 1) % 0x1000000


@asynccontextmanager
async def _connection(
    host: str, port: int
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A TCP link. Raises LinkError where it cannot be made, or is cut."""
    try:
        reader, writer = await asyncio.wait_for(asyncio.open_connection(host, port), ANSWER)
    except TimeoutError as error:
        raise LinkError(f"nobody answers within {ANSWER:g} s") from error
    except OSError as error:
        raise LinkError(_reason(error)) from error
    try:
        yield reader, writer
    except OSError as error:
        raise LinkError(_reason(error)) from error
    finally:
        writer.close()


async def _line(reader: asyncio.StreamReader) -> bytes:
    """One line of the server's answers."""
    try:
        line = await asyncio.wait_for(reader.readuntil(b"\n"), ANSWER)
    except TimeoutError as error:
        raise LinkError(f"no answer within {ANSWER:g} s") from error
    except (asyncio.IncompleteReadError, asyncio.LimitOverrunError) as error:
        raise LinkError("the server ended it before it answered") from error
    return line.strip()[:LONGEST_LINE]


def _obspy() -> Any:
    try:
        return import_module("obspy")
    except ImportError as error:
        raise FeedError(
            "SeedLink needs the extra `miniseed`: pip install 'pilewatch[miniseed]'"
        ) from error
