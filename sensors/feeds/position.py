"""How far a source has been published, on disk: where a feed goes on after a kill or a reboot.

    {"published_ns": 1700000000000000000, "period_ns": 25000000.0, "sequences": {"XX.TWR": 4711}}

A sequence is kept when all its samples are published, not when it arrives: what a killed feed had
received and not published is asked for again. What is asked for again and was published already is
left out by its time, sample by sample.

The file is synced, which takes too long for every block of a feed that catches up. Beside it
`….mark` has each block before and after it is published; nothing syncs it, and a kill leaves it
whole. Of the two the one with more blocks holds: after a power cut that may be the file.
"""

import json
import logging
import os
import secrets
import struct
import time
import zlib
from collections import defaultdict, deque
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from hashlib import sha256
from pathlib import Path

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.protocol import ChannelSamples

logger = logging.getLogger(__name__)

SAVED_EVERY = 0.2  # [s]: at the pace of measuring every block, while catching up some
# Blocks, since when, until when, start and end of the next, period [ns], CRC-32.
_MARK = struct.Struct(">Q4qdI")
POSITION_OVERLAP = 600.0  # farther back no record reaches: an older stamp is of another clock [s]


def position_file(folder: Path, source: str) -> Path:
    """Return the position file of a source's URL in a folder of states."""
    return folder / f"feed-{sha256(source.encode()).hexdigest()[:16]}.json"


class FeedPosition:
    """What of one source is published.

    Parameters
    ----------
    path : Path or None
        Its file; None: nothing is remembered.
    clock : callable
        Monotonic time [s], for the pace of saving.
    """

    def __init__(self, path: Path | None, clock: Callable[[], float] = time.monotonic) -> None:
        self.path, self._clock = path, clock
        self._blocks = 0
        self._since_ns = 0  # start of what is published by the source's present clock
        self.resumed_ns, self._period_ns = 0, 0.0
        self.sequences: dict[str, int] = {}
        self._take_file()
        self._next_ns = (0, 0)  # start and end of the block that was being published at a kill
        self._take_mark()
        self._resumed_period_ns, self._resumed_since_ns = self._period_ns, self._since_ns
        self._published_ns = self.resumed_ns
        self._pending: dict[str, deque[tuple[int, int]]] = defaultdict(deque)
        self._saved = clock()
        self._unsaved = False
        self._beyond: set[str] = set()  # channels that have passed what was published
        self.absent_ns = 0  # measured time that the source no longer had after the restart

    @property
    def remembers(self) -> bool:
        """Whether there is a file."""
        return self.path is not None

    @property
    def published_ns(self) -> int:
        """End of what is published [ns since 1970-01-01 UTC]; 0: nothing."""
        return self._published_ns

    def received(self, key: str, sequence: int, end_ns: int) -> None:
        """Note a record of a station; it counts when its samples are published."""
        if self.remembers:
            self._pending[key].append((sequence, end_ns))

    def has_published(self, start_ns: int, end_ns: int) -> bool:
        """Take the block that was being published at a kill as published, where it is this one.

        Parameters
        ----------
        start_ns, end_ns : int
            Of the last block that is kept to be sent again [ns since 1970-01-01 UTC].
        """
        if not end_ns or (start_ns, end_ns) != self._next_ns:
            return False
        self.resumed_ns = self._published_ns = end_ns
        self._next_ns = (0, 0)
        return True

    def publishing(self, start_ns: int, end_ns: int, period_ns: float) -> None:
        """Note a block that is published next [ns since 1970-01-01 UTC]."""
        self._write_mark(start_ns, end_ns, period_ns)

    def published(self, start_ns: int, end_ns: int, period_ns: float) -> None:
        """Note a block [ns since 1970-01-01 UTC]; the first one shows what is missing."""
        if not self.remembers:
            return
        self._blocks += 1
        if self.resumed_ns and self._published_ns == self.resumed_ns:
            absent = start_ns - self.resumed_ns
            self.absent_ns = absent if absent > 1.5 * period_ns else 0
        if start_ns < self._published_ns - period_ns or not self._since_ns:  # or a clock set back
            self._since_ns = start_ns
        self._published_ns, self._period_ns = end_ns, period_ns
        self._unsaved = True
        self._write_mark(0, 0, period_ns)
        for key, records in self._pending.items():
            while records and records[0][1] <= end_ns + period_ns / 2:
                self.sequences[key] = records.popleft()[0]
        if self._clock() - self._saved >= SAVED_EVERY:
            self.save()

    def settle(self) -> None:
        """Write what is not on disk yet, once nothing more comes: a later kill counts nothing."""
        if self._unsaved and self._clock() - self._saved >= SAVED_EVERY:
            self.save()

    def save(self) -> None:
        """Write the file; a disk that is full costs the position, not the samples."""
        if self.path is None or not self._published_ns:
            return
        self._saved, self._unsaved = self._clock(), False
        content = {
            "published_ns": self._published_ns,
            "period_ns": self._period_ns,
            "sequences": self.sequences,
            "blocks": self._blocks,
            "since_ns": self._since_ns,
        }
        part = self.path.with_name(f".{secrets.token_hex(6)}.part")
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            with part.open("w") as file:
                json.dump(content, file)
                file.flush()
                os.fsync(file.fileno())
            part.replace(self.path)
        except OSError as error:
            logger.error("%s: the feed's position cannot be written: %s", self.path, error)
        finally:
            with suppress(OSError):
                part.unlink(missing_ok=True)

    def unpublished(
        self, piece: ChannelSamples, *, received_before: bool = False
    ) -> ChannelSamples | None:
        """Return what of a piece was not published before the restart; None if nothing was not.

        Parameters
        ----------
        piece : ChannelSamples
            In the order of its stream.
        received_before : bool
            Whether it came before the restart: then it may be as old as what is published.
        """
        if not self.resumed_ns or piece.stream in self._beyond:
            return piece
        early_ns = self.resumed_ns - piece.start_ns
        overlap_ns = POSITION_OVERLAP * NANOSECONDS
        if received_before:
            overlap_ns = max(overlap_ns, self.resumed_ns - self._resumed_since_ns)
        if early_ns <= self._resumed_period_ns / 2 or early_ns > overlap_ns:
            self._beyond.add(piece.stream)
            return piece
        period_ns = NANOSECONDS / piece.sampling_rate if piece.sampling_rate else 0.0
        cut = round(early_ns / period_ns) if period_ns else len(piece.samples)
        if cut >= len(piece.samples):
            return None
        self._beyond.add(piece.stream)
        start_ns = piece.start_ns + round(cut * period_ns)
        return replace(piece, samples=piece.samples[cut:], start_ns=start_ns, follows=None)

    @property
    def _mark_path(self) -> Path | None:
        return None if self.path is None else self.path.with_suffix(".mark")

    def _take_file(self) -> None:
        """Go on where the file says; a damaged one says nothing."""
        if self.path is None:
            return
        try:
            content = json.loads(self.path.read_bytes())
            sequences = {str(key): int(each) for key, each in content["sequences"].items()}
            published_ns, blocks = int(content["published_ns"]), int(content.get("blocks", 0))
            period_ns, since_ns = content.get("period_ns", 0.0), int(content.get("since_ns", 0))
            self._period_ns = float(period_ns)
        except FileNotFoundError:
            return
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            logger.warning("%s is no feed's position; the feed starts afresh: %s", self.path, error)
            return
        self.resumed_ns, self.sequences = published_ns, sequences
        self._blocks, self._since_ns = blocks, since_ns

    def _take_mark(self) -> None:
        """Go on at the mark, where it is newer than the file."""
        try:
            packed = b"" if self._mark_path is None else self._mark_path.read_bytes()
            blocks, since_ns, published_ns, *following, period_ns, check = _MARK.unpack(packed)
        except (OSError, struct.error):
            return
        if zlib.crc32(packed[:-4]) != check or blocks < self._blocks:
            return
        self._blocks, self._since_ns = blocks, since_ns
        self.resumed_ns, self._period_ns = published_ns, period_ns
        self._next_ns = (following[0], following[1])

    def _write_mark(self, start_ns: int, end_ns: int, period_ns: float) -> None:
        path = self._mark_path
        if path is None:
            return
        place = (self._blocks, self._since_ns, self._published_ns, start_ns, end_ns, period_ns)
        packed = _MARK.pack(*place, 0)[:-4]
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            mark = os.open(path, os.O_WRONLY | os.O_CREAT, 0o600)  # the old one stays until then
            try:
                os.write(mark, packed + zlib.crc32(packed).to_bytes(4))
            finally:
                os.close(mark)
        except OSError as error:  # the file, every SAVED_EVERY, has to do
            logger.debug("%s cannot be written: %s", path, error)
