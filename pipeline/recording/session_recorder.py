"""SessionRecorder: the recording of a session that may run for a year, in parts.

message ──► new? ──► part due to end? ──► next part ──► old samples go ──► room? ──► written
                                                                             │         │
                                                            nor by retention │         │ synced
                                                                             ▼         ▼
                                    closed cleanly, a warning in every status    RecordedUntil
                                           │ looked at every few seconds: room again
                                           ▼
                                      next part
"""

import logging
import shutil
from collections import deque
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
from pipeline.recording.latest_messages import (
    MOST_KNOWN_MESSAGES,
    Repetition,
    latest_payloads,
)
from pipeline.recording.mcap_file import counted_in_summary
from pipeline.recording.reader import recorded_messages
from pipeline.recording.rotation import (
    close_leftovers,
    closed_in_place,
    is_taken,
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
ROOM_TO_GO_ON = 1.1  # of what stays free: a disk at its limit does not start a part every 5 s …
MORE_TO_GO_ON = 10e6  # … and so much more [bytes]
GOES_ON_FOR = 60.0  # a part that ends sooner by a fault makes the next try wait twice as long [s] …
TRIED_AT_LEAST_EVERY = 60.0  # … but no longer than this [s]
MOST_HELD = 500  # results that wait for a recording that has stopped: of 20 turbines some hours
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
    return sum(messages_in(path).values())


def messages_in(path: Path) -> dict[int, bool]:
    """Hashes of the messages that can be read in a recording, and whether each is a block; none
    where it cannot be read to its end."""
    try:
        return {
            hash(each.payload): each.message_type is AccelerationBlock
            for each in recorded_messages(path)
        }
    except RecordingError:
        return {}


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
    session: the part is closed, `warnings` says so and `lost` counts the blocks since. Once there
    is room again recording goes on in a next part, with the latest results of the time between.
    Blocks of that time that a spool sends again are recorded and no longer counted as lost. A file
    that is removed or moved while it is written is noticed before its latest blocks are
    acknowledged; what it held is lost, and recording goes on in a new file at once.
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
        self._arrivals = ArrivalClocks() if live else None
        self._stopped: QualityWarning | None = None
        self._resumed = False
        self._is_removed = False  # whether it stopped since its file had gone
        self._missed: dict[int, None] = {}  # hashes of blocks that could not be recorded
        self._missed_before = 0  # more than are remembered
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
        self._pause = ROOM_CHECKED_EVERY  # between two tries to go on [s]
        self._written: dict[int, bool] = {}  # hashes of this part's messages; whether it is a block
        self._held: deque[tuple[Message, bytes]] = deque(maxlen=MOST_HELD)  # results meanwhile
        self._recorder: Recorder | None = self._started(clock())

    @property
    def path(self) -> Path:
        """Path of the part that is, or was last, written."""
        return part_of(self._path, self._number)

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """That recording has stopped, or that it goes on after a stop."""
        found = () if self._stopped is None else (self._stopped,)
        if not self._resumed or self._recorder is None:
            return found
        missing = (
            f"blocks that are not recorded: {self.lost}" if self.lost else "no block is missing"
        )
        text = f"recording goes on after it had stopped: {missing}"
        return (*found, QualityWarning("recording-resumed", text))

    @property
    def lost(self) -> int:
        """Acceleration blocks that were received and could not be recorded."""
        return self._missed_before + len(self._missed)

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
        self._make_ready()
        if self._is_recorded(message):
            self.duplicate += isinstance(message, AccelerationBlock)
        else:
            self._record(message)
        if isinstance(message, AccelerationBlock) and self._recorder is not None:
            self._acknowledgements.note(message)
        return self._acknowledged(at_once=isinstance(message, StreamEnd))

    def _make_ready(self) -> None:
        """Make room, or go on where there is room again."""
        try:
            if self._recorder is None:
                self._try_again(self._clock())
            else:
                self._make_room(self._recorder)
        except (OSError, RecordingError) as error:  # the latter: no next part can be started
            self._stop(getattr(error, "strerror", None) or str(error))

    def _record(self, message: Message) -> None:
        if isinstance(message, STANDING_MESSAGES):
            self._standing[key_of(message)] = message
        if self._recorder is None:
            self._miss(message)
            return
        payload = self._bytes_of(message)
        if not isinstance(message, (*STANDING_MESSAGES, NodeStatus)):
            number = hash(payload)
            self._written[number] = isinstance(message, AccelerationBlock)
            self._missed.pop(number, None)
        try:
            self._recorder.handle_payload(message, payload)
        except OSError as error:
            self._stop(error.strerror or str(error))
            self._miss(message)

    def _miss(self, message: Message) -> None:
        """Count a block that cannot be recorded now, and keep a result until it can be."""
        if isinstance(message, AccelerationBlock):
            self._count_missed(hash(self._bytes_of(message)))
        elif not isinstance(message, (*STANDING_MESSAGES, NodeStatus)):
            self._held.append((message, self._bytes_of(message)))

    def _count_missed(self, number: int) -> None:
        self._missed[number] = None
        if len(self._missed) > MOST_KNOWN_MESSAGES:
            del self._missed[next(iter(self._missed))]
            self._missed_before += 1

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
        if self._recorder is None:  # it will not be recorded now: it does not become known
            return self._repetition.knows(self._bytes_of(message))
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
        try:
            for message in self._standing.values():
                recorder.handle(message)
        except OSError:
            recorder.remove()
            raise
        return recorder

    def _try_again(self, now_ns: int) -> None:
        """Go on in a next part where there is room by now; looked at every few seconds."""
        if abs(now_ns - self._checked_ns) < self._pause * NANOSECONDS:
            return
        self._checked_ns = now_ns
        missing = round(self._enough_to_go_on) - self._free(self._path.parent)
        if missing > 0:
            thin(self._path, self._settings, now_ns, needed=missing)
            if self._free(self._path.parent) < self._enough_to_go_on:
                return
        self._number = _number_without_a_file(self._path, self._number)
        self._recorder = self._started(now_ns)
        self._resumed = True
        if not self._is_removed:  # else the alarm lasts for a part: this would be too short to see
            self._stopped = None
        logger.warning("recording goes on in %s", self.path)
        self._record_held()

    def _record_held(self) -> None:
        """Record the results of the time in which recording had stopped."""
        held, self._held = self._held, deque(maxlen=MOST_HELD)
        arrived = self._arrived
        for self._arrived in held:
            message, _ = self._arrived
            if not self._is_recorded(message):
                self._record(message)
        self._arrived = arrived

    @property
    def _enough_to_go_on(self) -> float:
        """Free space with which a recording that has stopped goes on [bytes]."""
        return self._settings.free_megabytes * 1e6 * ROOM_TO_GO_ON + MORE_TO_GO_ON

    def _make_room(self, recorder: Recorder) -> None:
        """End the part where it is due, let old samples go, and stop where the disk is full."""
        now_ns = self._clock()
        if self._is_due(recorder, now_ns):
            recorder.close()
            self._number += 1
            self._recorder = self._started(now_ns)
            self._recorded_before += recorder.recorded[AccelerationBlock]
            self._written.clear()
            self._stopped = None
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
                f"stay so; it goes on once {self._enough_to_go_on / 1e6:.0f} MB are free"
            )

    def _stop(self, reason: str) -> None:
        """Close the part with what the disk still takes, and warn of it until it goes on."""
        self._checked_ns = self._clock()
        if self._recorder is None:  # it could not go on: the reason may be another one by now
            self._warn(f"recording to {self.path} does not go on: {reason}")
            return
        recorder, self._recorder = self._recorder, None
        lasted = abs(self._checked_ns - self._began_ns) / NANOSECONDS
        soon = self._resumed and lasted < GOES_ON_FOR
        self._pause = min(2 * self._pause, TRIED_AT_LEAST_EVERY) if soon else ROOM_CHECKED_EVERY
        self._warn(f"recording to {recorder.path} has stopped: {reason}")
        if not self._closed_by_itself(recorder):
            recorder.abandon()
            if recorder.is_in_place:  # else another file may have its name
                self._close_in_place(recorder.path)
        self._is_removed = not recorder.is_in_place
        if self._is_removed:  # the disk has room: no block is to be missed
            self._checked_ns -= round(self._pause * NANOSECONDS)
        self._acknowledgements.forget(synced=self._is_removed)
        self._count_readable(recorder.path)

    def _count_readable(self, path: Path) -> None:
        """Take note of what a part that has stopped holds: what sat in the chunk that the disk
        refused was taken, and is not there."""
        readable = messages_in(path)
        missing = self._written.keys() - readable.keys()
        self._repetition.forget(missing)  # it may be sent again
        for number in missing:
            if self._written[number]:
                self._count_missed(number)
        self._recorded_before += sum(readable.values())
        self._written.clear()

    def _warn(self, text: str) -> None:
        warning = QualityWarning("recording-stopped", text)
        if warning != self._stopped:
            logger.error(text)
        self._stopped = warning

    def _close_in_place(self, path: Path) -> None:
        try:
            closed_in_place(path.with_name(path.name + ACTIVE_SUFFIX))
        except (OSError, RecordingError) as error:
            logger.error("%s can only be salvaged: %s", path, error)

    def _closed_by_itself(self, recorder: Recorder) -> bool:
        try:
            recorder.close()
        except OSError:
            return False
        return True


def _number_without_a_file(path: Path, number: int) -> int:
    """Return the number of a part, or the first after it of which there is no file."""
    while is_taken(path, number):
        number += 1
    return number
