"""The latest of what a folder's recordings hold, that of the one being written included.

    session-20240601T…Z.mcap   session.mcap   session.part2.mcap.active
                     ◄──────────────── horizon ───────────────►│ newest sample

Read to continue from, not as a document: a chunk that is damaged or not whole yet is passed over.

A recorder that is started again gets from every publisher what it still keeps, most of which the
recorder before it has written; `Repetition` knows it again:

    recorded   ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒┐ kill
    cache                 ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒ ─► goes on live
    new                                     ▒▒▒▒▒▒

A node that continues from a snapshot publishes its latest messages again, and an untrusted sender
may replay what it has received. A message is the same where every byte of it is.
"""

import logging
from collections import Counter, deque
from collections.abc import Iterable, Iterator, Mapping, Sequence, Set
from contextlib import suppress
from itertools import islice
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
MOST_KNOWN_MESSAGES = 2**20  # messages of all keys: what 800 turbines' publishers keep; some 100 MB
READ_BACK = 2**18  # messages: of 200 turbines twenty minutes, more than publishers keep


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
    """What was recorded last, in the order of recording.

    Parameters
    ----------
    files : sequence of Path
        Recordings, of which as many are read, from the newest on, as are needed.
    message_types : sequence of type
        Which to give, blocks among them; what holds for ever (a layout) is given from every file
        read.
    horizon : float
        Of each turbine, messages are given from where its units' blocks since then amount to this
        [s] each.

    Returns
    -------
    tuple of Message
        Empty where nothing was recorded.

    Notes
    -----
    Blocks are counted, their stamps are not looked at: clocks may have been wrong.
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
    """Return the latest estimates of each turbine, so many at most, in the order of recording."""
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


class Repetition:
    """Knows again what was recorded: as much of each key as its publisher may send once more.

    Parameters
    ----------
    recorded : iterable of bytes, optional
        Payloads of the recorder before; see `latest_payloads`.
    """

    def __init__(self, recorded: Iterable[bytes] = ()) -> None:
        # Python's own hash: 64 bits, with a key that no sender can know
        self._earlier = frozenset(hash(payload) for payload in recorded)
        self._latest: dict[str, deque[int]] = {}  # by key
        self._known: set[int] = set()

    def is_known(self, key: str, payload: bytes, *, kept: int) -> bool:
        """Whether these bytes have been recorded; from now on they are known.

        Parameters
        ----------
        key : str
            Of the message.
        payload : bytes
            The message as it was sent.
        kept : int
            How many messages of this key are known again.
        """
        if self.knows(payload):
            return True
        number = hash(payload)
        latest = self._latest.pop(key, None) or deque()
        self._latest[key] = latest  # the key that was silent longest comes first
        latest.append(number)
        self._known.add(number)
        if len(latest) > kept:
            self._known.discard(latest.popleft())
        if len(self._known) > MOST_KNOWN_MESSAGES:
            self._forget_one()
        return False

    def knows(self, payload: bytes) -> bool:
        """Whether these bytes have been recorded; what is not known stays so."""
        number = hash(payload)
        return number in self._known or number in self._earlier

    def forget(self, numbers: Set[int]) -> None:
        """Forget messages that turned out not to be recorded, by the hashes of their bytes."""
        self._known -= numbers
        self._earlier -= numbers
        self._latest = {
            key: deque(number for number in latest if number not in numbers)
            for key, latest in self._latest.items()
        }

    def _forget_one(self) -> None:
        """The oldest of the key that was silent longest."""
        silent = next(iter(self._latest))
        self._known.discard(self._latest[silent].popleft())
        if not self._latest[silent]:
            del self._latest[silent]


def latest_payloads(files: Sequence[Path], count: int = READ_BACK) -> Iterator[bytes]:
    """Return the last so many messages of recordings in order of recording, as they were sent.

    Parameters
    ----------
    files : sequence of Path
        In order of recording; read from the end, and no further than needed.
    count : int, optional
        How many messages.
    """
    backwards = (payload for file in reversed(files) for payload in payloads_backwards(file))
    return reversed(list(islice(backwards, count)))
