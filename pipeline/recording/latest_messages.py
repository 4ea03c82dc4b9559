"""The latest of what a folder's recordings hold, that of the one being written included.

    session-20240601T…Z.mcap   session.mcap   session.part2.mcap.active
                     ◄──────────────── horizon ───────────────►│ newest sample

Read to continue from, not as a document: a chunk that is damaged or not whole yet is passed over.
"""

import logging
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from pathlib import Path

from mcap.opcode import Opcode

from pipeline.messages import Message, ModalEstimate
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import (
    MCAP_DAMAGE,
    McapChannels,
    RecordedMessage,
    chunk_payloads,
    complete_records,
    open_recording,
    record_at,
    record_offsets,
)
from pipeline.recording.rotation import RESULTS
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.streams import STREAMS, time_of
from pipeline.transport.codec import decode
from pipeline.transport.errors import CodecError
from sensors.acquisition.blocks import AccelerationBlock

logger = logging.getLogger(__name__)

MOST_PARTS = 48  # that are looked through for estimates: two days of an hour each


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
    """What was recorded last, in the order of recording: of each turbine, from where its units'
    blocks since then amount to `horizon` [s] each.

    files           recordings, of which as many are read, from the newest on, as are needed
    message_types   which to give, blocks among them; what holds for ever (a layout) is given from
                    every file read

    Blocks are counted, their stamps are not looked at: clocks may have been wrong. Empty where
    nothing was recorded.
    """
    kept: list[Message] = []  # the latest first
    covered: dict[tuple[str, str], float] = {}  # turbine, unit → duration of its blocks [s]
    waited: set[tuple[str, str]] = set()  # units of the newest file that has blocks
    for file in _newest_first(files)[:MOST_PARTS]:
        for message in reversed(list(_messages_that_are_whole(file, message_types))):
            unit = (message.turbine, getattr(message, "unit", ""))
            if isinstance(message, AccelerationBlock):
                covered[unit] = covered.get(unit, 0.0) + message.duration
                if covered[unit] - message.duration < horizon:
                    kept.append(message)
            elif time_of(message) is None or not _is_covered(message.turbine, covered, horizon):
                kept.append(message)
        waited = waited or set(covered)
        if waited and all(covered[unit] >= horizon for unit in waited):
            break
    return tuple(reversed(kept)) if covered else ()


def latest_estimates(files: Sequence[Path], count: int) -> tuple[ModalEstimate, ...]:
    """The latest estimates of each turbine, so many at most, in the order of recording."""
    kept: list[ModalEstimate] = []  # the latest first
    counts: Counter[str] = Counter()
    for file in _newest_first(files)[:MOST_PARTS]:
        for message in reversed(list(_messages_that_are_whole(file, (ModalEstimate,)))):
            counts[message.turbine] += 1
            if isinstance(message, ModalEstimate) and counts[message.turbine] <= count:
                kept.append(message)
        if counts and min(counts.values()) >= count:
            break
    return tuple(reversed(kept))


def _is_covered(turbine: str, covered: Mapping[tuple[str, str], float], horizon: float) -> bool:
    own = [duration for (name, _), duration in covered.items() if name == turbine]
    return bool(own) and min(own) >= horizon


def readable_messages(path: Path) -> Iterator[Message]:
    """Every message of a recording that can be read, one in writing included, in its order."""
    types = tuple(stream.message for stream in STREAMS)
    return _messages_that_are_whole(path, types)


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
    channels = McapChannels()
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
            except MCAP_DAMAGE:
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
            except MCAP_DAMAGE:
                logger.warning("%s: passed over the chunk at byte %d", path, offset)
