"""SessionRecorder: the recording of a session that may run for a year, in parts.

message ──► new? ──► part due to end? ──► next part ──► old samples go ──► room? ──► written
                                                                             │         │
                                                            nor by retention │         │ synced
                                                                             ▼         ▼
                                    closed cleanly, a warning in every status    RecordedUntil
"""

import logging
import shutil
from collections.abc import Callable, Iterable
from pathlib import Path

from pipeline.messages import (
    FoundationTruth,
    Message,
    NodeStatus,
    QualityWarning,
    RecordedUntil,
    StreamEnd,
)
from pipeline.nodes.node import NodeStatistics
from pipeline.recording.acknowledgement import Acknowledgements
from pipeline.recording.errors import RecordingError
from pipeline.recording.latest_messages import Repetition, latest_payloads
from pipeline.recording.mcap_file import counted_in_summary
from pipeline.recording.reader import recorded_messages
from pipeline.recording.rotation import (
    close_leftovers,
    closed_in_place,
    next_part,
    part_of,
    parts_of,
    thin,
)
from pipeline.recording.settings import RecordingSettings
from pipeline.recording.writer import ACTIVE_SUFFIX, Metadata, Recorder
from pipeline.streams import key_of, stream_of
from pipeline.transport.arrival_clocks import ArrivalClocks
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout

logger = logging.getLogger(__name__)

ROOM_CHECKED_EVERY = 5.0  # [s]
SYNCED_EVERY = 1.0  # what a power cut costs at most [s]
ACKNOWLEDGED_EVERY = 5.0  # what is on disk [s] …
ACKNOWLEDGED_BLOCKS = 50  # … or after so many blocks
STANDING_MESSAGES = (
    SensorLayout,
    FoundationTruth,
)  # hold until they are sent again; every part has them


def free_bytes(folder: Path) -> int:
    """Room on the disk of a folder."""
    return shutil.disk_usage(folder).free


def blocks_in(path: Path) -> int:
    """Acceleration blocks that can be read in a recording; 0 where there is none."""
    try:
        return sum(each.message_type is AccelerationBlock for each in recorded_messages(path))
    except RecordingError:
        return 0


def stated_blocks(path: Path) -> int:
    """Return the blocks that a finished recording states; else `blocks_in`, which reads it."""
    try:
        counted = counted_in_summary(path, AccelerationBlock)
    except RecordingError:
        return 0
    return blocks_in(path) if counted is None else counted


class SessionRecorder:
    """Records into `path`, then `path`'s next parts; each is a whole recording by itself.

    Parameters
    ----------
    path : Path
        Of the first part. What an earlier recorder left unfinished is closed first, and recording
        goes on in the next part: nothing is overwritten, nor recorded twice.
    metadata : Metadata
        Stored in every part.
    clock : callable
        → time of receiving [ns since 1970-01-01 UTC].
    settings : RecordingSettings, optional
        When a part ends, what is kept, how much room is left on the disk.
    free : callable, optional
        → free bytes on the disk of a folder.
    live : bool, optional
        The units measure now: their stamps are checked against the clock.

    Raises
    ------
    RecordingError
        If no file can be made.

    Notes
    -----
    A disk that is full, and that retention may not or cannot relieve, ends the recording, not the
    session: the part is closed, `warnings` says so and `lost` counts the blocks since.
    """

    name = "recorder"
    inputs: tuple[type, ...] = Recorder.inputs

    def __init__(
        self,
        path: Path,
        *,
        metadata: Metadata,
        clock: Callable[[], int],
        settings: RecordingSettings | None = None,
        free: Callable[[Path], int] = free_bytes,
        live: bool = False,
    ) -> None:
        self.warnings: tuple[QualityWarning, ...] = ()
        self._arrivals = ArrivalClocks() if live else None
        self.lost = 0  # acceleration blocks that were received and could not be recorded
        self.duplicate = 0  # acceleration blocks that had been recorded before
        self._path = path
        self._metadata = metadata
        self._clock = clock
        self._settings = settings or RecordingSettings()
        self._free = free
        self._standing: dict[str, Message] = {}  # by key
        for whole in close_leftovers(path):
            logger.warning("%s was left unfinished; it ends with its last whole chunk now", whole)
        self._number = next_part(path)
        earlier = parts_of(path)
        self._recorded_before = sum(map(stated_blocks, earlier))  # … the part being written
        self._acknowledgements = Acknowledgements()
        self._synced_ns = self._acknowledged_ns = clock()
        self._repetition = Repetition(latest_payloads(earlier))
        self._arrived: tuple[Message | None, bytes] = (None, b"")  # the latest, and its bytes
        self._checked_ns = 0
        self._recorder: Recorder | None = self._started(clock())

    @property
    def path(self) -> Path:
        """Path of the part that is, or was last, written."""
        return part_of(self._path, self._number)

    @property
    def recorded(self) -> int:
        """Acceleration blocks in all parts, those of an earlier recorder too."""
        in_this_part = 0 if self._recorder is None else self._recorder.recorded[AccelerationBlock]
        return self._recorded_before + in_this_part

    @property
    def statistics(self) -> NodeStatistics:
        """Blocks that are in the recording, that came twice, that could not be recorded."""
        return NodeStatistics(
            lost=self.lost,
            duplicate=self.duplicate,
            recorded=self.recorded,
            warnings=(*self.warnings, *(self._arrivals.warnings if self._arrivals else ())),
        )

    def handle_payload(self, message: Message, payload: bytes) -> Iterable[Message]:
        """Record one message as it arrived, unless it has been."""
        self._arrived = message, payload
        return self.handle(message)

    def handle(self, message: Message) -> Iterable[Message]:
        """Record one message, unless it has been. Acknowledges to units what is on disk."""
        if self._arrivals is not None and isinstance(message, AccelerationBlock):
            self._arrivals.note(message, self._clock())
        if self._is_recorded(message):
            self.duplicate += isinstance(message, AccelerationBlock)
        else:
            self._record(message)
        if isinstance(message, AccelerationBlock) and self._recorder is not None:
            self._acknowledgements.note(message)
        return self._acknowledged(at_once=isinstance(message, StreamEnd))

    def _record(self, message: Message) -> None:
        try:
            self._make_room()
            if self._recorder is not None:
                self._recorder.handle_payload(message, self._bytes_of(message))
        except (OSError, RecordingError) as error:  # the latter: no next part can be started
            self._stop(getattr(error, "strerror", None) or str(error))
        if isinstance(message, STANDING_MESSAGES):
            self._standing[key_of(message)] = message
        if self._recorder is None and isinstance(message, AccelerationBlock):
            self.lost += 1

    def _acknowledged(self, *, at_once: bool) -> tuple[RecordedUntil, ...]:
        """Sync where it is due; what that has brought to disk."""
        if self._recorder is None:
            return ()
        now_ns = self._clock()
        if not at_once and abs(now_ns - self._synced_ns) < SYNCED_EVERY * NANOSECONDS:
            return ()
        self._synced_ns = now_ns
        try:
            self._recorder.sync()
        except OSError as error:
            self._stop(error.strerror or str(error))
            return ()
        waiting = self._acknowledgements.sync()
        old = abs(now_ns - self._acknowledged_ns) >= ACKNOWLEDGED_EVERY * NANOSECONDS
        if not (at_once or old or waiting >= ACKNOWLEDGED_BLOCKS):
            return ()
        self._acknowledged_ns = now_ns
        return self._acknowledgements.acknowledged(now_ns)

    def _is_recorded(self, message: Message) -> bool:
        """Whether it has been. What stands until it is sent again may be sent again."""
        if isinstance(message, (*STANDING_MESSAGES, NodeStatus)):
            return False
        kept = stream_of(type(message)).cached
        return self._repetition.is_known(key_of(message), self._bytes_of(message), kept=kept)

    def _bytes_of(self, message: Message) -> bytes:
        """Return what it came in; encoded where that is not known."""
        arrived, payload = self._arrived
        if arrived is message:
            return payload
        self._arrived = message, encode(message)
        return self._arrived[1]

    def close(self) -> None:
        """Finish the part. A second call does nothing."""
        if self._recorder is None:
            return
        try:
            self._recorder.close()
        except OSError as error:
            self._stop(f"{error.strerror or error}")

    def _started(self, now_ns: int) -> Recorder:
        self._began_ns = now_ns
        recorder = Recorder(self.path, metadata=self._metadata, clock=self._clock)
        for message in self._standing.values():
            recorder.handle(message)
        return recorder

    def _make_room(self) -> None:
        """End the part where it is due, let old samples go, and stop where the disk is full."""
        if self._recorder is None:
            return
        now_ns = self._clock()
        if self._is_due(self._recorder, now_ns):
            ended = self._recorder
            ended.close()
            self._number += 1
            self._recorder = self._started(now_ns)
            self._recorded_before += ended.recorded[AccelerationBlock]
            thin(self._path, self._settings, now_ns)
        if abs(now_ns - self._checked_ns) >= ROOM_CHECKED_EVERY * NANOSECONDS:
            self._checked_ns = now_ns
            self._check_room(now_ns)

    def _is_due(self, recorder: Recorder, now_ns: int) -> bool:
        old = abs(now_ns - self._began_ns) >= self._settings.rotate_after * NANOSECONDS
        return old or recorder.size >= self._settings.rotate_megabytes * 1e6

    def _check_room(self, now_ns: int) -> None:
        wanted = round(self._settings.free_megabytes * 1e6)
        missing = wanted - self._free(self._path.parent)
        if missing <= 0:
            return
        thin(self._path, self._settings, now_ns, needed=missing)
        left = self._free(self._path.parent)
        if left < wanted:
            self._stop(
                f"{left / 1e6:.0f} MB are free and {self._settings.free_megabytes:g} MB are to "
                "stay so"
            )

    def _stop(self, reason: str) -> None:
        """Close the part with what the disk still takes, and warn of it from now on."""
        assert self._recorder is not None
        self._acknowledgements.forget()
        recorder, self._recorder = self._recorder, None
        text = f"recording to {recorder.path} has stopped: {reason}"
        self.warnings = (QualityWarning("recording-stopped", text),)
        logger.error(text)
        if not self._closed_by_itself(recorder):
            recorder.abandon()
            try:
                closed_in_place(recorder.path.with_name(recorder.path.name + ACTIVE_SUFFIX))
            except (OSError, RecordingError) as error:
                logger.error("%s can only be salvaged: %s", recorder.path, error)
        # what sat in the chunk that the disk refused was taken, and is not there
        readable = blocks_in(recorder.path)
        self.lost += recorder.recorded[AccelerationBlock] - readable
        self._recorded_before += readable

    def _closed_by_itself(self, recorder: Recorder) -> bool:
        try:
            recorder.close()
        except OSError:
            return False
        return True
