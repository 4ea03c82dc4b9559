"""How far a source has been published, on disk: where a feed goes on after a kill or a reboot.

    {"published_ns": 1700000000000000000, "period_ns": 25000000.0, "sequences": {"XX.TWR": 4711}}

A sequence is kept when all its samples are published, not when it arrives: what a killed feed had
received and not published is asked for again. What is asked for again and was published already is
left out by its time, sample by sample.
"""

import json
import logging
import os
import secrets
import time
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
        self.resumed_ns, self._period_ns, self.sequences = _read(path)
        self._resumed_period_ns = self._period_ns
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

    def published(self, start_ns: int, end_ns: int, period_ns: float) -> None:
        """Note a block [ns since 1970-01-01 UTC]; the first one shows what is missing."""
        if not self.remembers:
            return
        if self.resumed_ns and self._published_ns == self.resumed_ns:
            absent = start_ns - self.resumed_ns
            self.absent_ns = absent if absent > 1.5 * period_ns else 0
        self._published_ns, self._period_ns = end_ns, period_ns
        self._unsaved = True
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

    def unpublished(self, piece: ChannelSamples) -> ChannelSamples | None:
        """Return what of a piece was not published before the restart; None if nothing was not."""
        if not self.resumed_ns or piece.stream in self._beyond:
            return piece
        early_ns = self.resumed_ns - piece.start_ns
        if early_ns <= self._resumed_period_ns / 2 or early_ns > POSITION_OVERLAP * NANOSECONDS:
            self._beyond.add(piece.stream)
            return piece
        period_ns = NANOSECONDS / piece.sampling_rate if piece.sampling_rate else 0.0
        cut = round(early_ns / period_ns) if period_ns else len(piece.samples)
        if cut >= len(piece.samples):
            return None
        self._beyond.add(piece.stream)
        start_ns = piece.start_ns + round(cut * period_ns)
        return replace(piece, samples=piece.samples[cut:], start_ns=start_ns, follows=None)


def _read(path: Path | None) -> tuple[int, float, dict[str, int]]:
    """Published time and sampling period [ns], and sequences; nothing of a damaged file."""
    if path is None:
        return 0, 0.0, {}
    try:
        content = json.loads(path.read_bytes())
        sequences = {str(key): int(each) for key, each in content["sequences"].items()}
        return int(content["published_ns"]), float(content.get("period_ns", 0.0)), sequences
    except FileNotFoundError:
        return 0, 0.0, {}
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        logger.warning("%s is no feed's position; the feed starts afresh: %s", path, error)
        return 0, 0.0, {}
