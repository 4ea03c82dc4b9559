"""SeedLink's packets and miniSEED's record lengths.

    version 3   "SL", 6 hexadecimal digits of the sequence, one miniSEED record of any length;
                "SLINFO", 2 letters, 512 bytes
    version 4   "SE", format, subformat, payload length (uint32), sequence (uint64), length of the
                station's name (uint8), the name, the payload; little endian

Version 3 does not give a record's length; miniSEED does: version 2 in blockette 1000, version 3 in
its header. Sources: SeedLink protocol 3.1 and 4.0, SEED manual 2.4, miniSEED 3 (International
Federation of Digital Seismograph Networks).
"""

import struct
from asyncio import StreamReader
from dataclasses import dataclass

from sensors.feeds.reconnect import LinkError

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
