"""SeedLink 3 and 4: miniSEED 2 and 3 records from a seismological data logger or server (extra
`miniseed`).

    seedlink://HOST[:18000]/NET.STA[.LOC.CHA][,…]      * in STA: any letters, in LOC.CHA: one
    seedlinks://HOST[:18500]/…[?ca=FILE]               over TLS

    client                                server
    HELLO                                 two lines of text; what it speaks
    SLPROTO 4.0                           OK                     (version 4 alone)
    STATION STA NET  |  STATION NET_STA   OK
    SELECT LOCCHA    |  SELECT LOC_B_S_S  OK
    DATA [the sequence to go on with]     OK
    END                                   packets, without end
    INFO ID, when nothing comes           a packet of text: the link is alive

Every NET.STA.LOC.CHA is a channel (NET.STA..CHA without a location); samples are a digitiser's
counts, of which the layout's `sensitivity` and `unit` make accelerations. A link that was cut goes
on with the sequence behind the last packet, a feed that was killed with the one behind the last
published packet (`position.py`): the server gives again what it still has. Sequences count
everything of a station (or of a server), asked for or not: losses are known by the gaps in time.

    packet of version 3   "SL", 6 hexadecimal digits of the sequence, one miniSEED record of any
                          length; "SLINFO", 2 letters, 512 bytes
    packet of version 4   "SE", format, subformat, payload length (uint32), sequence (uint64),
                          length of the station's name (uint8), the name, the payload; little endian

Version 3 does not give a record's length; miniSEED does: version 2 in blockette 1000, version 3 in
its header.

Why not obspy's own client: it sleeps half a second whenever nothing is there, in a loop that
nothing else can run beside.

Sources: SeedLink protocol 3.1 and 4.0, SEED manual 2.4, miniSEED 3
(International Federation of Digital Seismograph Networks).
"""

import asyncio
import logging
import os
import re
import ssl
import struct
from asyncio import StreamReader
from collections.abc import AsyncIterator, Iterator
from contextlib import asynccontextmanager
from dataclasses import dataclass
from fnmatch import fnmatchcase

import numpy as np

from sensors.extras import import_extra
from sensors.feeds.address import FeedAddress
from sensors.feeds.payloads.frame import HIGHEST_RATE, LOWEST_RATE
from sensors.feeds.payloads.timestamps import LATEST_NS
from sensors.feeds.position import FeedPosition
from sensors.feeds.protocol import ArrivalQueue, ChannelSamples, FeedCounts, FeedError
from sensors.feeds.reconnect import LinkError, kept_connected

logger = logging.getLogger(__name__)

QUIET_SERVER = 30.0  # after so long without a packet the server is asked whether it lives [s]
ANSWER = 10.0  # for the server's answers [s]
LONGEST_LINE = 1024  # [bytes]

# What is neither of the two is not given to libmseed: version 2 begins with a sequence number, the
# quality, and the names of station, location, channel and network in ASCII.
_HEADER = re.compile(rb"MS\x03|[0-9 ]{6}[DRQM][ \0][A-Z0-9 ]{12}", re.IGNORECASE)
_PROTOCOL_4 = re.compile(rb"SLPROTO:4\.\d")

_STATION = re.compile(
    r"(?P<net>\w{1,2})\.(?P<sta>[\w*?]{1,8})(\.(?P<loc>[\w*]{0,2})\.(?P<cha>[\w*]{3}))?"
)


USUAL_RECORD = 512  # of SeedLink 3, where a record does not give its length [bytes]
HEAD = 64  # of a record, read before its length is known [bytes]
LONGEST_RECORD = 2**20  # [bytes]
MINISEED_3 = b"MS\x03"
_BLOCKETTE_1000 = 1000
_V4_HEAD = struct.Struct("<2sccIQB")


@dataclass(frozen=True, slots=True)
class Packet:
    """One record with its number."""

    sequence: int
    """Of the server or the station."""
    record: bytes
    """miniSEED; b"" if the packet has none."""


async def packet_3(reader: StreamReader) -> Packet:
    """The next packet of SeedLink 3.

    Raises
    ------
    LinkError
        If it is none.
    asyncio.IncompleteReadError
        If the link ends.
    """
    head = await reader.readexactly(8)
    if head.startswith(b"SLINFO"):
        await reader.readexactly(USUAL_RECORD)
        return Packet(-1, b"")
    try:
        sequence = int(head[2:], 16)
    except ValueError:
        sequence = -1
    if not head.startswith(b"SL") or sequence < 0:
        raise LinkError(f"a packet that begins with {head!r}")
    begin = await reader.readexactly(HEAD)
    length = record_length(begin) or USUAL_RECORD
    return Packet(sequence, begin + await reader.readexactly(length - HEAD))


async def packet_4(reader: StreamReader) -> Packet:
    """The next packet of SeedLink 4. Raises as `packet_3`."""
    head = await reader.readexactly(_V4_HEAD.size)
    signature, kind, _, length, sequence, name_length = _V4_HEAD.unpack(head)
    if signature != b"SE" or length > LONGEST_RECORD:
        raise LinkError(f"a packet that begins with {head[:8]!r}")
    await reader.readexactly(name_length)
    payload = await reader.readexactly(length)
    return Packet(sequence, payload if kind in b"23" else b"")


def record_length(begin: bytes) -> int:
    """Length of a miniSEED record by its first HEAD bytes [bytes]; 0 if they do not give it."""
    if begin.startswith(MINISEED_3):
        name, extra, payload = struct.unpack_from("<BHI", begin, 33)
        length = 40 + name + extra + payload
        if length < HEAD or length > LONGEST_RECORD:
            raise LinkError(f"a miniSEED 3 record of {length} bytes")
        return int(length)
    for order in (">", "<"):
        if 1900 <= struct.unpack_from(f"{order}H", begin, 20)[0] <= 2100:
            return _length_by_blockette(begin, order)
    return 0


def _length_by_blockette(begin: bytes, order: str) -> int:
    at = struct.unpack_from(f"{order}H", begin, 46)[0]
    while 48 <= at <= len(begin) - 8:
        kind, following, _, _, exponent = struct.unpack_from(f"{order}HHBBB", begin, at)
        if kind == _BLOCKETTE_1000:
            return 2**exponent if 7 <= exponent <= 20 else 0
        if following <= at:
            return 0
        at = following
    return 0


@dataclass(slots=True)
class Station:
    """One station, and how far it has been read."""

    network: str
    """Code of the network."""
    station: str
    """Code of the station, with * for any letters."""
    selectors: list[str]
    """LOCCHA with ? for any letter; none: everything."""
    sequence: int | None = None
    """Of the last packet; None before the first."""

    @property
    def key(self) -> str:
        """The station as the address names it."""
        return f"{self.network}.{self.station}"

    def matches(self, network: str, station: str) -> bool:
        """Whether a record is of it."""
        return network == self.network and fnmatchcase(station, self.station)

    def commands(self, version: int) -> list[str]:
        """Return what asks for it, before DATA."""
        if version == 3:
            return [
                f"STATION {self.station} {self.network}",
                *(f"SELECT {each}" for each in self.selectors),
            ]
        return [
            f"STATION {self.network}_{self.station}",
            *(f"SELECT {each[:-3]}_{'_'.join(each[-3:])}" for each in self.selectors),
        ]


def stations_of(address: FeedAddress) -> list[Station]:
    """Return the stations that an address names. Raises FeedError for what is none."""
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

    Parameters
    ----------
    address : FeedAddress
        Of the server, with the stations.
    once : bool
        Give up where the server cannot be reached at the start.
    quiet : float, optional
        After so long without a packet the server is asked whether it lives [s].
    position : FeedPosition, optional
        How far it was published before.

    Raises
    ------
    FeedError
        If pymseed is missing, and for stations that are none.
    """

    def __init__(
        self,
        address: FeedAddress,
        *,
        once: bool,
        quiet: float = QUIET_SERVER,
        position: FeedPosition | None = None,
    ) -> None:
        self.name = address.text
        self.counts = FeedCounts()
        self._host, self._port = address.host, address.port
        self._tls = _tls_context(address)
        self._position = position or FeedPosition(None)
        self._stations = stations_of(address)
        for station in self._stations:
            station.sequence = self._position.sequences.get(station.key)
        self._pymseed = import_extra("pymseed", "miniseed", "SeedLink", FeedError)
        self._version = 3
        self._once, self._quiet = once, quiet

    async def run(self, inbox: ArrivalQueue) -> None:
        """Raises FeedError for stations that the server refuses at the start."""

        async def session() -> None:
            await self._session(inbox)

        await kept_connected(session, self.name, self.counts, once=self._once)

    async def _session(self, inbox: ArrivalQueue) -> None:
        async with _connection(self._host, self._port, self._tls) as (reader, writer):
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
        self._version = 4 if _PROTOCOL_4.search(greeting.upper()) else 3
        if self._version == 4:
            await self._ask(reader, writer, "SLPROTO 4.0")
        for station in self._stations:
            for command in station.commands(self._version):
                await self._ask(reader, writer, command)
            await self._ask(reader, writer, f"DATA{self._from(station)}")
        writer.write(b"END\r\n")

    def _from(self, station: Station) -> str:
        """Return the sequence behind the last packet, as the protocol writes it."""
        if station.sequence is None:
            return ""
        if self._version == 4:
            return f" {station.sequence + 1}"
        return f" {_next(station.sequence):06X}"

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
        read = packet_4 if self._version == 4 else packet_3
        while True:
            packet = asyncio.ensure_future(read(reader))
            try:
                while not (await asyncio.wait({packet}, timeout=self._quiet))[0]:
                    if asked:
                        raise LinkError(f"nothing for {2 * self._quiet:g} s")
                    writer.write(b"INFO ID\r\n")
                    asked = True
                found = packet.result()
            except asyncio.IncompleteReadError as error:
                rest = f" with {error.partial[:20]!r}" if error.partial else ""
                raise LinkError(f"the server ended it{rest}") from error
            finally:
                packet.cancel()
            asked = False
            if found.record:
                yield found.sequence, found.record

    def pieces_of(self, sequence: int, record: bytes) -> Iterator[ChannelSamples]:
        """Yield the samples in a packet; one that has none is counted."""
        self.counts.received += 1
        if not _HEADER.match(record):
            self.counts.refuse(f"packet {sequence:06X} is no miniSEED: {record[:20]!r}")
            return
        try:
            read = self._pymseed.MS3Record.parse(record, unpack_data=True)
            network, station, location, channel = self._pymseed.sourceid2nslc(read.sourceid)
        except (self._pymseed.PymseedError, ValueError) as error:
            reason = " ".join(str(error).split())
            self.counts.refuse(f"packet {sequence:06X} is no readable miniSEED: {reason}")
            return
        rate, start_ns = float(read.samprate), int(read.starttime)
        self._note(network, station, sequence, int(read.endtime))
        numbers = read.sampletype in ("i", "f", "d")  # not the text of a log record
        timed = 0 <= start_ns < LATEST_NS
        if read.numsamples and numbers and timed and LOWEST_RATE <= rate <= HIGHEST_RATE:
            name = f"{network}.{station}.{location}.{channel}"
            samples = np.array(read.np_datasamples, dtype=np.float64).reshape(-1, 1)
            yield ChannelSamples(name, (name,), samples, start_ns, rate)

    def _note(self, network: str, name: str, sequence: int, end_ns: int) -> None:
        """Note where the station goes on when the link is cut or the feed is killed."""
        for station in self._stations:
            if station.matches(network, name):
                station.sequence = sequence
                self._position.received(station.key, sequence, end_ns)


def _reason(error: OSError) -> str:
    """Return why a link failed in the system's words, which asyncio mixes with the address."""
    if isinstance(error, ssl.SSLCertVerificationError):
        return f"the certificate is refused: {error.verify_message}"
    if isinstance(error, ssl.SSLError):
        return f"TLS: {error.reason}"
    return os.strerror(error.errno) if error.errno and error.errno > 0 else str(error)


def _next(sequence: int) -> int:
    return (sequence + 1) % 0x1000000


@asynccontextmanager
async def _connection(
    host: str, port: int, tls: ssl.SSLContext | None
) -> AsyncIterator[tuple[asyncio.StreamReader, asyncio.StreamWriter]]:
    """A TCP link. Raises LinkError where it cannot be made, or is cut."""
    try:
        reader, writer = await asyncio.wait_for(
            asyncio.open_connection(host, port, ssl=tls), ANSWER
        )
    except TimeoutError as error:
        raise LinkError(f"no answer within {ANSWER:g} s") from error
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


def _tls_context(address: FeedAddress) -> ssl.SSLContext | None:
    """Return the TLS context; None without TLS. Raises FeedError for an unreadable file."""
    if not address.tls:
        return None
    try:
        return ssl.create_default_context(cafile=address.options.get("ca"))
    except OSError as error:
        raise FeedError(f"{address.text}: ca={address.options.get('ca')}: {error}") from error
