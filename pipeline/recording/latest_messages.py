"""The latest of what a folder's recordings hold, that of the one being written included.

    session-20240601T…Z.mcap   session.mcap   session.part2.mcap.active
                     ◄──────────────── horizon ───────────────►│ newest sample

Read to continue from, not as a document: a chunk that is damaged or not whole yet is passed over.
"""

import logging
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

from mcap.opcode import Opcode

from pipeline.messages import Message
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import (
    DAMAGE,
    ChannelTable,
    RecordedMessage,
    chunk_payloads,
    complete_records,
    open_recording,
    record_at,
    record_offsets,
)
from pipeline.recording.rotation import RESULTS
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.streams import time_of
from pipeline.transport.codec import decode
from pipeline.transport.errors import CodecError
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

logger = logging.getLogger(__name__)


def files_of(path: Path) -> tuple[Path, ...]:
    """Every part of one recording that still holds samples, the one being written included."""
    names = (path.name, f"{path.stem}.part*{path.suffix}")
    found = {
        file
        for name in names
        for ending in ("", ACTIVE_SUFFIX)
        for file in path.parent.glob(name + ending)
    }
    return tuple(sorted(file for file in found if f"{RESULTS}." not in file.name))


def latest_messages(
    files: Sequence[Path], message_types: Sequence[type], *, horizon: float
) -> tuple[Message, ...]:
    """What was recorded from `horizon` [s] before the newest sample on, in the order of recording.

    files           recordings, of which as many are read, from the newest on, as are needed
    message_types   which to give; what holds for ever (a layout) is given from every file read

    Empty where nothing was recorded.
    """
    newest_ns: int | None = None
    read: list[list[Message]] = []  # newest file first
    for file in _newest_first(files):
        messages = list(_messages_that_are_whole(file, message_types))
        read.append(messages)
        blocks = [each for each in messages if isinstance(each, AccelerationBlock)]
        if not blocks:
            continue
        newest_ns = newest_ns or max(block.end_ns for block in blocks)
        if min(block.start_ns for block in blocks) <= newest_ns - horizon * NANOSECONDS:
            break
    if newest_ns is None:
        return ()
    since_ns = newest_ns - round(horizon * NANOSECONDS)
    return tuple(
        message
        for messages in reversed(read)
        for message in messages
        if _ends(message) is None or (_ends(message) or 0) > since_ns
    )


def _ends(message: Message) -> int | None:
    return message.end_ns if isinstance(message, AccelerationBlock) else time_of(message)


def _newest_first(files: Sequence[Path]) -> list[Path]:
    """A file that a recorder closes or thins out meanwhile is passed over."""
    changed = {}
    for file in files:
        with suppress(FileNotFoundError):
            changed[file] = file.stat().st_mtime_ns
    return sorted(changed, key=lambda file: changed[file], reverse=True)


def _messages_that_are_whole(path: Path, message_types: Sequence[type]) -> Iterator[Message]:
    for recorded in _recorded(path):
        if recorded.message_type not in message_types:
            continue
        try:
            message: Message = decode(recorded.message_type, recorded.payload)
        except CodecError as error:
            logger.warning("%s: passed over a message on %s: %s", path, recorded.key, error)
            continue
        yield message


def _recorded(path: Path) -> Iterator[RecordedMessage]:
    channels = ChannelTable()
    try:
        file = open_recording(path)
    except RecordingError as error:
        logger.warning("passed over: %s", error)
        return
    with file:
        for record in complete_records(file):
            if record.opcode != Opcode.CHUNK:
                continue
            try:
                yield from channels.messages(record)
            except DAMAGE:
                logger.warning("%s: passed over the chunk at byte %d", path, record.offset)


def payloads_backwards(path: Path) -> Iterator[bytes]:
    """Every message of a recording as it was sent, the last first; nothing of the file is read
    before it is asked for."""
    try:
        file = open_recording(path)
    except RecordingError as error:
        logger.warning("passed over: %s", error)
        return
    with file:
        chunks = [offset for offset, opcode in record_offsets(file) if opcode == Opcode.CHUNK]
        for offset in reversed(chunks):
            try:
                yield from reversed(chunk_payloads(record_at(file, offset)))
            except DAMAGE:
                logger.warning("%s: passed over the chunk at byte %d", path, offset)
