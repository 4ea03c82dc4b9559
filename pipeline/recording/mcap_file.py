"""An MCAP file record by record: how far it is whole, and what its chunks hold.

File: magic, records of the data section (header, metadata, chunks with their indexes), data end
with a checksum over all before it, summary, footer, magic. A chunk holds schemas, channels and
messages, compressed, with a checksum of its own. Source: https://mcap.dev/spec
"""

import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import BinaryIO

import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, Metadata, Schema
from mcap.records import Message as McapMessage
from mcap.stream_reader import breakup_chunk
from mcap.summary import Summary

from pipeline.recording.errors import RecordingError
from pipeline.streams import STREAMS
from pipeline.transport.codec import full_name

MCAP_MAGIC = b"\x89MCAP0\r\n"
MOST_TOPICS = 5  # of other programs that an error names
_FOOTER = struct.Struct("<QQI")  # start of the summary, of its offsets; checksum
_RECORD_HEAD = struct.Struct("<BQ")  # opcode, length of what follows [bytes]

# What the mcap package raises where bytes are not what they should be.
MCAP_DAMAGE = (
    McapError,
    struct.error,
    zstandard.ZstdError,
    ValueError,  # checksums and text that is not UTF-8 among them
    KeyError,
    OverflowError,
    MemoryError,
)


@dataclass(frozen=True, slots=True)
class Record:
    """One record of the file, not yet taken apart."""

    offset: int
    """Of its first byte in the file."""
    opcode: int
    content: bytes

    def checksum(self, before: int) -> int:
        """CRC-32 of the data section up to the record's end, given that up to its start."""
        head = _RECORD_HEAD.pack(self.opcode, len(self.content))
        return zlib.crc32(self.content, zlib.crc32(head, before))


@dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message of the table of streams as it lies in the file, not yet decoded."""

    message_type: type
    key: str
    log_time: int
    """When it was received [ns since 1970-01-01 UTC]."""
    publish_time: int
    """Its own time [ns since 1970-01-01 UTC]."""
    payload: bytes


def open_recording(path: Path) -> BinaryIO:
    """Return the opened file. Raises RecordingError where it is missing or no recording at all."""
    try:
        file = path.open("rb")
    except IsADirectoryError as error:
        raise RecordingError(
            f"cannot read the recording {path}: it is a folder; give a file in it"
        ) from error
    except OSError as error:
        raise RecordingError(
            f"cannot read the recording {path}: {error.strerror or error}"
        ) from error
    begin = file.read(len(MCAP_MAGIC))
    if begin != MCAP_MAGIC:
        file.close()
        if not begin:
            raise RecordingError(
                f"{path} is empty (0 bytes): nothing was recorded; it can be moved away"
            )
        raise RecordingError(
            f"{path} is not a recording: it does not begin as an MCAP file does; a file of "
            "measurements in another format becomes one by `pilewatch import`"
        )
    return file


def is_closed_properly(file: BinaryIO) -> bool:
    """Whether the file ends as a finished recording does."""
    if file.seek(0, 2) < 2 * len(MCAP_MAGIC):
        return False
    file.seek(-len(MCAP_MAGIC), 2)
    return file.read() == MCAP_MAGIC


def counted_in_summary(path: Path, message_type: type) -> int | None:
    """Messages of one type as a finished recording itself counts them; None where it does not.

    Raises RecordingError where it is no recording at all.
    """
    with open_recording(path) as file:
        summary = summary_of(file)
    if summary is None or summary.statistics is None:
        return None
    name = full_name(message_type.__name__)
    counts = summary.statistics.channel_message_counts
    return sum(
        counts.get(channel.id, 0)
        for channel in summary.channels.values()
        if channel.schema_id in summary.schemas and summary.schemas[channel.schema_id].name == name
    )


def summary_of(file: BinaryIO) -> Summary | None:
    """Return the summary at the end of a file; None where there is none, or it is damaged."""
    if not _summary_holds(file):
        return None
    file.seek(0)
    try:
        return SeekingReader(file).get_summary()
    except MCAP_DAMAGE:
        return None


def _summary_holds(file: BinaryIO) -> bool:
    """Whether the summary's own checksum, if it has one, is that of its bytes, which end four bytes
    before the end of the footer."""
    end = file.seek(0, 2) - len(MCAP_MAGIC)
    if end - _FOOTER.size < len(MCAP_MAGIC):
        return False
    file.seek(end - _FOOTER.size)
    summary_start, _, expected = _FOOTER.unpack(file.read(_FOOTER.size))
    if not len(MCAP_MAGIC) <= summary_start < end:
        return False
    file.seek(summary_start)
    return expected in (0, zlib.crc32(file.read(end - 4 - summary_start)))


def chunk_records(file: BinaryIO, summary: Summary | None) -> Iterator[Record]:
    """Every chunk, in order. Where the file has a summary, its index leads over damaged records;
    else the records are followed up to the first that is not whole."""
    if summary is None or not summary.chunk_indexes:
        yield from (each for each in complete_records(file) if each.opcode == Opcode.CHUNK)
        return
    for index in sorted(summary.chunk_indexes, key=lambda each: each.chunk_start_offset):
        file.seek(index.chunk_start_offset + _RECORD_HEAD.size)
        content = file.read(max(0, index.chunk_length - _RECORD_HEAD.size))
        yield Record(index.chunk_start_offset, Opcode.CHUNK, content)


def complete_records(file: BinaryIO) -> Iterator[Record]:
    """Every record of the data section that is there to its last byte, data end included, up to
    the first that is not."""
    for offset, _ in record_offsets(file):
        yield record_at(file, offset)


def record_offsets(file: BinaryIO) -> Iterator[tuple[int, int]]:
    """Offset and opcode of every complete record, the content of which is not read."""
    size = file.seek(0, 2)
    offset = len(MCAP_MAGIC)
    while offset + _RECORD_HEAD.size <= size:
        file.seek(offset)
        opcode, length = _RECORD_HEAD.unpack(file.read(_RECORD_HEAD.size))
        if offset + _RECORD_HEAD.size + length > size:
            return
        yield offset, opcode
        if opcode == Opcode.DATA_END:
            return
        offset += _RECORD_HEAD.size + length


def incomplete_bytes(file: BinaryIO) -> int:
    """How many bytes at the end of a file are of no complete record; 0 where only its summary is
    cut off, which holds no message."""
    end = len(MCAP_MAGIC)
    for offset, opcode in record_offsets(file):
        if opcode == Opcode.DATA_END:
            return 0
        file.seek(offset + 1)  # behind the opcode
        (length,) = struct.unpack("<Q", file.read(8))
        end = offset + _RECORD_HEAD.size + length
    return max(0, file.seek(0, 2) - end)


def record_at(file: BinaryIO, offset: int) -> Record:
    """Return the complete record that begins there."""
    file.seek(offset)
    opcode, length = _RECORD_HEAD.unpack(file.read(_RECORD_HEAD.size))
    return Record(offset, opcode, file.read(length))


def chunk_payloads(record: Record) -> list[bytes]:
    """Return the messages of one chunk in order, whatever they are, its checksum verified.

    Raises one of DAMAGE.
    """
    chunk = Chunk.read(ReadDataStream(BytesIO(record.content)))
    parts = breakup_chunk(chunk, validate_crc=True)
    return [part.data for part in parts if isinstance(part, McapMessage)]


def checked_records(path: Path, file: BinaryIO) -> Iterator[Record]:
    """Yield every record of the data section of a file that must be whole.

    Parameters
    ----------
    path : Path
        Of the file, for messages.
    file : BinaryIO
        Opened for reading.

    Raises
    ------
    RecordingError
        After the last good record where the file is damaged, and at the end where its checksum does
        not hold.
    """
    checksum = zlib.crc32(MCAP_MAGIC)
    end = len(MCAP_MAGIC)
    for record in complete_records(file):
        if record.opcode == Opcode.DATA_END:
            (expected,) = struct.unpack_from("<I", record.content.ljust(4, b"\0"))
            if expected not in (0, checksum):
                raise RecordingError(f"{path} is damaged: its checksum does not hold")
            return
        yield record
        checksum = record.checksum(checksum)
        end = record.offset + _RECORD_HEAD.size + len(record.content)
    raise RecordingError(f"{path} is damaged: what begins at byte {end} is no whole record")


class McapChannels:
    """The schemas and channels met so far; makes sense of the messages that follow them."""

    def __init__(self) -> None:
        self.foreign: dict[str, str] = {}  # topics of other programs → how they are written
        self.known: set[str] = set()  # topics of ours
        self.n_foreign = 0  # messages of other programs
        self._schemas: dict[int, str] = {}
        self._channels: dict[int, tuple[type | None, str]] = {}

    def learn(self, summary: Summary | None) -> None:
        """Take schemas and channels from a file's summary too: the chunk that introduces them may
        be damaged."""
        if summary is not None:
            self._schemas |= {each.id: each.name for each in summary.schemas.values()}
            for channel in summary.channels.values():
                self._add(channel)

    def messages(self, record: Record) -> list[RecordedMessage]:
        """Return what one chunk holds of the table of streams, in order, its checksum verified.

        Raises one of DAMAGE.
        """
        chunk = Chunk.read(ReadDataStream(BytesIO(record.content)))
        recorded: list[RecordedMessage] = []
        for part in breakup_chunk(chunk, validate_crc=True):
            match part:
                case Schema():
                    self._schemas[part.id] = part.name
                case Channel():
                    self._add(part)
                case McapMessage():
                    recorded.extend(self._message(part))
        return recorded

    def _add(self, channel: Channel) -> None:
        message_type = _MESSAGE_TYPES.get(self._schemas.get(channel.schema_id, ""))
        self._channels[channel.id] = (message_type, channel.topic)
        if message_type is None:
            self.foreign[channel.topic] = self._written_as(channel)
        else:
            self.known.add(channel.topic)

    def _written_as(self, channel: Channel) -> str:
        encoding = channel.message_encoding or "none"
        schema = self._schemas.get(channel.schema_id, "") or "none"
        return f"message encoding {encoding} and schema {schema}"

    @property
    def foreign_content(self) -> str:
        """Why a file is of another program, for people; "" where a channel is ours."""
        if self.known or not self.foreign:
            return ""
        like_ours = [
            f"{topic} with {self.foreign[topic]} (expected: protobuf and {schema})"
            for topic in sorted(self.foreign)
            if (schema := _schema_on(topic))
        ]
        if like_ours:
            return f"cannot be understood: it has {_first_of(like_ours)}"
        return f"holds no pilewatch channel, only {_first_of(sorted(self.foreign))}"

    def _message(self, part: McapMessage) -> Iterator[RecordedMessage]:
        message_type, key = self._channels[part.channel_id]
        if message_type is None:
            self.n_foreign += 1
        else:
            yield RecordedMessage(message_type, key, part.log_time, part.publish_time, part.data)


def metadata_section(record: Record) -> tuple[str, dict[str, str]]:
    """Name and texts of a metadata record. Raises one of DAMAGE."""
    metadata = Metadata.read(ReadDataStream(BytesIO(record.content)))
    return metadata.name, metadata.metadata


def _first_of(texts: Sequence[str]) -> str:
    more = len(texts) - MOST_TOPICS
    return ", ".join(texts[:MOST_TOPICS]) + (f" and {more} more" if more > 0 else "")


def _schema_on(topic: str) -> str | None:
    """Return the schema that pilewatch's messages on a topic have; None where it has none."""
    for stream in STREAMS:
        pattern = re.sub(r"\\{\w+\\}", "[^/]+", re.escape(stream.key))
        if re.fullmatch(pattern, topic):
            return full_name(stream.message.__name__)
    return None


_MESSAGE_TYPES = {full_name(stream.message.__name__): stream.message for stream in STREAMS}
