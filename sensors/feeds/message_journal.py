"""Messages of a broker on disk, from before they are confirmed until their samples are published.

    record   flag (1 byte)  CRC-32 (4)  length of the topic (2)  of the payload (4)  topic  payload

A broker forgets a message once it is confirmed, and confirmation cannot wait for a block: brokers
have few messages under way (mosquitto: 20). What a feed that is killed had received and not
published is read here when it starts again; what was published is left out by its time
(`position.py`).

Nothing is synced: a killed feed and a reboot lose nothing, a power cut the system's last seconds.

Two files: a new one is begun when everything in the older one is published. Messages that describe
others (names of aliases, rates) are taken over into each new file.
"""

import errno
import logging
import os
import struct
import time
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path

from sensors.bounded_dict import BoundedDict
from sensors.feeds.position import POSITION_OVERLAP, FeedPosition
from sensors.feeds.protocol import ChannelSamples

logger = logging.getLogger(__name__)

SHORTEST_FILE = 2.0  # time that a file is written to [s]
LARGEST_FILE = 2**25  # [bytes]; then a new one is begun whatever is published
MOST_DESCRIPTIONS = 1000
_HEAD = struct.Struct(">BIHI")
_MEASURED, _DESCRIPTION = 0, 1

TopicPayload = tuple[str, bytes]


class MessageJournal:
    """The messages of one feed that are not published yet.

    Parameters
    ----------
    path : Path
        Its newer file; the older one lies beside it.
    position : FeedPosition
        How far the feed is published.
    describes : callable
        Whether messages of a topic describe others.
    clock : callable
        Monotonic time [s].
    """

    def __init__(
        self,
        path: Path,
        position: FeedPosition,
        describes: Callable[[str], bool],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._path, self._position, self._describes = path, position, describes
        self._older = path.with_name(f"{path.name}-older")
        self._clock = clock
        self._descriptions: BoundedDict[str, bytes] = BoundedDict(MOST_DESCRIPTIONS)
        self._file = -1
        self._begun = clock()
        self._kept = self._taken = 0  # messages
        self._older_count = 0  # the last message of the older file
        self._older_ns: int | None = 0  # its newest sample; None: it is not taken yet
        self._newest_ns = 0
        self._known: set[int] = set()  # hashes of the messages in the present file
        self._known_before: set[int] = set()  # …, in the older one

    def resumed(self) -> tuple[list[TopicPayload], list[TopicPayload]]:
        """Return descriptions, and messages that may be unpublished, of a feed that was killed."""
        descriptions: list[TopicPayload] = []
        messages: list[TopicPayload] = []
        for path in (self._older, self._path):
            for flag, topic, payload in _records(path):
                (descriptions if flag == _DESCRIPTION else messages).append((topic, payload))
                if self._describes(topic):
                    self._descriptions.put(topic, payload)
        messages = list(dict.fromkeys(messages))  # both files have them after a kill right here
        self._known = {hash(each) for each in messages}  # `_begin` makes them the older file's
        self._kept = self._older_count = len(messages)
        self._older_ns = None if messages else 0
        self._begin([_record(_MEASURED, *each) for each in messages])
        return descriptions, messages

    def unpublished(self, piece: ChannelSamples) -> ChannelSamples | None:
        """Return what of a piece of a message of before is unpublished; None: nothing."""
        return self._position.unpublished(piece, received_before=True)

    def has(self, topic: str, payload: bytes) -> bool:
        """Whether a message is here: the broker sends again what it knows no confirmation of."""
        known = hash((topic, payload))
        return known in self._known or known in self._known_before

    def keep(self, topic: str, payload: bytes) -> None:
        """Write a message before it is confirmed."""
        if self._is_due():
            self._begin(None)
        if self._describes(topic):
            self._descriptions.put(topic, payload)
        self._kept += 1
        self._known.add(hash((topic, payload)))
        self._write(_record(_MEASURED, topic, payload))

    def taken(self, piece: ChannelSamples | None) -> None:
        """Note a piece of a message, or with None its end, in the order of `keep`."""
        if piece is not None:
            period = 1e9 / piece.sampling_rate if piece.sampling_rate else 0.0
            last_ns = piece.start_ns + round((len(piece.samples) - 1) * period)
            self._newest_ns = max(self._newest_ns, last_ns)
            return
        self._taken += 1
        if self._taken == self._older_count:
            self._older_ns = self._newest_ns

    def close(self) -> None:
        """Close the file; what was not published stays in it."""
        if self._file >= 0:
            os.close(self._file)
        self._file = -1

    def _is_due(self) -> bool:
        """Whether a new file may be begun: nothing in the older one is needed any more."""
        age = self._clock() - self._begun
        if self._file < 0 or age > POSITION_OVERLAP or os.fstat(self._file).st_size > LARGEST_FILE:
            return True
        published = self._older_ns is not None and self._older_ns <= self._position.published_ns
        return age > SHORTEST_FILE and published

    def _begin(self, older: list[bytes] | None) -> None:
        """A new file. `older`: the records of the older one; None: it is the present file."""
        self.close()
        try:
            self._path.parent.mkdir(parents=True, exist_ok=True)
            if older is not None:
                part = self._older.with_name(f"{self._older.name}.part")
                part.write_bytes(b"".join([*self._described(), *older]))
                part.replace(self._older)
            elif self._path.exists():
                self._path.replace(self._older)
                self._older_count = self._kept
                self._older_ns = self._newest_ns if self._taken >= self._kept else None
            self._file = os.open(self._path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC, 0o600)
        except OSError as error:
            logger.error("%s: received messages cannot be kept: %s", self._path, error)
        self._known_before, self._known = self._known, set()
        self._begun = self._clock()
        self._write(b"".join(self._described()))

    def _described(self) -> Iterator[bytes]:
        for topic, payload in self._descriptions.items():
            yield _record(_DESCRIPTION, topic, payload)

    def _write(self, record: bytes) -> None:
        if self._file < 0 or not record:
            return
        end = os.fstat(self._file).st_size
        try:
            if os.write(self._file, record) < len(record):
                raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        except OSError as error:  # a full disk costs this record, not the samples
            logger.error("%s: received messages cannot be kept: %s", self._path, error)
            self._cut_back(end)

    def _cut_back(self, end: int) -> None:
        """Have the file end where a record began that the disk took half of: what follows half a
        record is not read. A new file instead would end the older one, needed or not."""
        try:
            os.ftruncate(self._file, end)
            os.lseek(self._file, end, os.SEEK_SET)
        except OSError:
            self.close()


def _record(flag: int, topic: str, payload: bytes) -> bytes:
    named = topic.encode()[: 2**16 - 1]
    check = zlib.crc32(named + payload)
    return _HEAD.pack(flag, check, len(named), len(payload)) + named + payload


def _records(path: Path) -> Iterator[tuple[int, str, bytes]]:
    """What is whole, up to where a length leads beyond the file; the rest is logged."""
    try:
        content = path.read_bytes()
    except OSError:
        return
    begin = 0
    while begin + _HEAD.size <= len(content):
        flag, check, named, length = _HEAD.unpack_from(content, begin)
        start = begin + _HEAD.size
        end = start + named + length
        if end > len(content) or not named:  # nor has a file's end of zeros a topic
            break
        if zlib.crc32(content[start:end]) == check:
            topic = content[start : start + named].decode("utf-8", "replace")
            yield flag, topic, content[start + named : end]
        else:
            logger.warning("%s, byte %d: its checksum does not hold", path, begin)
        begin = end
    if begin < len(content):
        rest = len(content) - begin
        logger.warning("%s: %d bytes from byte %d on cannot be read", path, rest, begin)
