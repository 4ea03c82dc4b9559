"""What has been finished stays finished: results by the fingerprint of all they were made from.

    FOLDER/ab/abcdef….pw     pilewatch-archive 1\n
                             CRC-32 of the rest       4 bytes, big-endian
                             zlib(frames)             kind, length, bytes; one after the other

The key of a result is a fingerprint of content and settings. So it is found again after a restart,
wherever the files have moved, and is never mistaken for that of other content or other settings.
"""

import hashlib
import struct
import zlib
from collections.abc import Iterable, Iterator
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import get_args

from pipeline.messages import Message
from pipeline.transport.codec import decode, encode
from sensors.atomic_write import written_whole

STORE_HEADER = b"pilewatch-archive 1\n"
SUFFIX = ".pw"
QUICK = 1  # zlib's level: numbers hardly shrink

StoredFrame = tuple[str, bytes]  # what it is, its bytes

_BODY = len(STORE_HEADER) + 4  # offset of what is compressed, behind its checksum [bytes]
_FRAME_HEAD = struct.Struct(">BI")  # length of the kind, of the bytes
_TYPES = {each.__name__: each for each in get_args(Message)}


class FinishedResults:
    """A folder of results. Written by one process; a result is there as a whole or not at all."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def get(self, key: str) -> tuple[StoredFrame, ...] | None:
        """Return the result of that key; None where there is none, or it is damaged."""
        try:
            return unpacked(self._path(key).read_bytes())
        except (FileNotFoundError, ValueError):
            return None

    def put(self, key: str, frames: Iterable[StoredFrame]) -> None:
        """Keep a result. Raises OSError where the disk refuses."""
        path = self._path(key)
        path.parent.mkdir(parents=True, exist_ok=True)
        written_whole(path, packed(frames))

    def forget(self, keys: Iterable[str]) -> None:
        """Remove results that nothing needs any more."""
        for key in keys:
            self._path(key).unlink(missing_ok=True)

    def __contains__(self, key: str) -> bool:
        """Return whether a result is there and whole: a damaged one is to be made again."""
        try:
            return is_whole(self._path(key).read_bytes())
        except FileNotFoundError:
            return False

    def _path(self, key: str) -> Path:
        return self._folder / key[:2] / f"{key}{SUFFIX}"


def key_of_result(*parts: str | bytes) -> str:
    """Fingerprint of what a result is made from, this version of pilewatch included."""
    digest = hashlib.blake2b(digest_size=20)
    for part in (_version(), *parts):
        content = part.encode() if isinstance(part, str) else part
        digest.update(struct.pack(">Q", len(content)))
        digest.update(content)
    return digest.hexdigest()


@cache
def _version() -> str:
    return version("pilewatch")


def frames_of(messages: Iterable[Message]) -> tuple[StoredFrame, ...]:
    """Messages as they are kept."""
    return tuple((type(message).__name__, encode(message)) for message in messages)


def messages_in(frames: Iterable[StoredFrame]) -> Iterator[Message]:
    """Yield the messages among the frames, in order. Raises CodecError for a damaged one."""
    for kind, content in frames:
        if kind in _TYPES:
            yield decode(_TYPES[kind], content)


def packed(frames: Iterable[StoredFrame]) -> bytes:
    """Frames as a file's bytes."""
    parts = [
        _FRAME_HEAD.pack(len(kind.encode()), len(content)) + kind.encode() + content
        for kind, content in frames
    ]
    body = zlib.compress(b"".join(parts), QUICK)
    return STORE_HEADER + struct.pack(">I", zlib.crc32(body)) + body


def unpacked(content: bytes) -> tuple[StoredFrame, ...]:
    """The frames of a file's bytes. Raises ValueError where these are damaged or something else."""
    if not is_whole(content):
        raise ValueError("no whole result of an archive")
    return tuple(_frames(zlib.decompress(content[_BODY:])))


def is_whole(content: bytes) -> bool:
    """Return whether a file's bytes have the header and the checksum of what follows."""
    checksum = struct.pack(">I", zlib.crc32(memoryview(content)[_BODY:]))
    return content.startswith(STORE_HEADER) and content[len(STORE_HEADER) : _BODY] == checksum


def _frames(body: bytes) -> Iterator[StoredFrame]:
    place = 0
    while place < len(body):
        kind_length, length = _FRAME_HEAD.unpack_from(body, place)
        place += _FRAME_HEAD.size
        kind = body[place : place + kind_length].decode()
        place += kind_length
        yield kind, body[place : place + length]
        place += length
