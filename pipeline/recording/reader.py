"""Recordings back into messages."""

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from pipeline.messages import Message
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import (
    MCAP_DAMAGE,
    McapChannels,
    RecordedMessage,
    checked_records,
    complete_records,
    is_closed_properly,
    metadata_section,
    open_recording,
)
from pipeline.recording.salvage import what_is_left, what_to_do
from pipeline.transport.codec import decode
from pipeline.transport.errors import CodecError


def read_messages(path: Path, message_types: Sequence[type] | None = None) -> Iterator[Message]:
    """Return what was recorded, in the order of recording.

    Parameters
    ----------
    path : Path
        Of the recording.
    message_types : sequence of type, optional
        Which to give; None: all.

    Raises
    ------
    RecordingError
        At once where the file is missing, foreign or cut, and on reaching it where a chunk is
        damaged.

    Notes
    -----
    Checksums are verified on the way.
    """
    return _messages(path, _opened_whole(path), message_types)


def recorded_messages(path: Path) -> Iterator[RecordedMessage]:
    """Yield messages as `read_messages`, not yet decoded and with the time of receiving."""
    return _recorded(path, _opened_whole(path))


def decoded(path: Path, recorded: RecordedMessage) -> Message:
    """Return the message itself. Raises RecordingError where it cannot be read."""
    try:
        message: Message = decode(recorded.message_type, recorded.payload)
    except CodecError as error:
        raise RecordingError(
            f"{path} has an unreadable message on {recorded.key} at {recorded.log_time} ns: {error}"
        ) from error
    return message


def read_metadata(path: Path) -> dict[str, dict[str, str]]:
    """Section → name → text, as given to the recorder. Raises RecordingError like
    `read_messages`."""
    with _opened_whole(path) as file:
        try:
            return dict(
                metadata_section(record)
                for record in checked_records(path, file)
                if record.opcode == Opcode.METADATA
            )
        except MCAP_DAMAGE as error:
            raise RecordingError(f"{path} is damaged: its metadata cannot be read") from error


def leading_metadata(path: Path) -> dict[str, dict[str, str]]:
    """Section → name → text as far as they stand before the first chunk, where a recorder writes
    them; the rest of the file is not read.

    Raises
    ------
    RecordingError
        Where the file is missing, no recording, or damaged there.
    """
    sections: dict[str, dict[str, str]] = {}
    with open_recording(path) as file:
        for record in complete_records(file):
            if record.opcode == Opcode.CHUNK:
                break
            if record.opcode == Opcode.METADATA:
                try:
                    name, texts = metadata_section(record)
                except MCAP_DAMAGE as error:
                    raise RecordingError(
                        f"{path} is damaged: its metadata cannot be read"
                    ) from error
                sections[name] = texts
    return sections


def _opened_whole(path: Path) -> BinaryIO:
    file = open_recording(path)
    if not is_closed_properly(file):
        with file:
            left = what_is_left(file)
        how = f"; {what_to_do(path)}" if left.messages else ""
        raise RecordingError(f"{path} was cut off before its end: {left}{how}")
    return file


def _messages(
    path: Path, file: BinaryIO, message_types: Sequence[type] | None
) -> Iterator[Message]:
    for recorded in _recorded(path, file):
        if message_types is None or recorded.message_type in message_types:
            yield decoded(path, recorded)


def _recorded(path: Path, file: BinaryIO) -> Iterator[RecordedMessage]:
    channels = McapChannels()
    with file:
        for record in checked_records(path, file):
            if record.opcode != Opcode.CHUNK:
                continue
            try:
                messages = channels.messages(record)
            except MCAP_DAMAGE as error:
                raise RecordingError(
                    f"{path} is damaged: the chunk at byte {record.offset} fails its checksum; "
                    "the other chunks can be salvaged"
                ) from error
            yield from messages
    if channels.foreign_content:
        raise RecordingError(f"{path} {channels.foreign_content}")
