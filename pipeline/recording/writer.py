"""The recorder: a node that writes every message it is given to an MCAP file."""

import errno
import logging
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from io import BufferedWriter
from pathlib import Path

from mcap.well_known import MessageEncoding, SchemaEncoding
from mcap.writer import LIBRARY_IDENTIFIER, Writer

from pipeline.messages import Message
from pipeline.nodes.node import NodeStatistics
from pipeline.recording.errors import RecordingError
from pipeline.streams import STREAMS, key_of, time_of
from pipeline.transport.codec import encode, full_name, self_description
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.atomic_write import sync_folder

logger = logging.getLogger(__name__)

Metadata = Mapping[str, Mapping[str, str]]  # section → name → text

ACTIVE_SUFFIX = ".active"  # of a file that is still being written


@dataclass(frozen=True, slots=True)
class RecorderSettings:
    """How much may be lost in a crash against how well it compresses.

    A crash loses what sits in the open chunk. Chunks of one second cost about a fifth more disk
    than chunks of a minute.
    """

    chunk_duration: float = 1.0
    """A chunk is closed when it is that old [s]."""
    chunk_bytes: int = 2**20
    """… or that large before compression."""


class Recorder:
    """Writes messages to `path`, one MCAP channel for each key.

    Parameters
    ----------
    path : Path
        `path` + ".active" until `close`, so that a finished recording has its whole name; neither
        may exist before.
    metadata : Metadata
        Scenario, seed, version, truth, …: what is needed to run the recording again.
    clock : callable or None
        Gives the time of receiving [ns since 1970-01-01 UTC], which becomes the log time and ages
        the chunks; None for a recording that is computed rather than received: the messages' own
        times then take its place and the same messages give the same file.
    settings : RecorderSettings, optional
        The defaults where left out.

    Raises
    ------
    RecordingError
        If the file cannot be made.

    Notes
    -----
    The publish time is the message's own (`time_of`). The schemas in the file describe every
    message; `read_messages` gives back exactly what was recorded.
    """

    name = "recorder"
    inputs: tuple[type, ...] = tuple(stream.message for stream in STREAMS if stream.recorded)

    def __init__(
        self,
        path: Path,
        *,
        metadata: Metadata,
        clock: Callable[[], int] | None,
        settings: RecorderSettings | None = None,
    ) -> None:
        self.path = path
        self.recorded = dict.fromkeys(self.inputs, 0)  # messages written, by type
        self._clock = clock
        self._settings = settings or RecorderSettings()
        self._channels: dict[str, int] = {}  # key → MCAP channel
        self._schemas: dict[type, int] = {}
        self._counts: dict[str, int] = {}  # key → messages
        self._without_time: list[tuple[Message, bytes]] = []
        self._chunk_opened_ns: int | None = None
        self.is_in_place = True  # as it was when it was synced or closed last
        self._active = _active(path)
        self._file = _created(path, self._active)
        self._writer = Writer(
            self._file, chunk_size=self._settings.chunk_bytes, enable_data_crcs=True
        )
        try:
            self._writer.start(library=f"pilewatch ({LIBRARY_IDENTIFIER})")
            for section, texts in metadata.items():
                self._writer.add_metadata(section, dict(texts))
            self._file.flush()
            self.sync()
            sync_folder(path.parent)
        except OSError as error:
            self.remove()
            raise _refused(path, error) from error

    def handle(self, message: Message) -> Iterable[Message]:
        """Record one message. Gives nothing back."""
        return self.handle_payload(message, encode(message))

    def handle_payload(self, message: Message, payload: bytes) -> Iterable[Message]:
        """Record one message as it arrived. Gives nothing back."""
        own_time = time_of(message)
        if self._clock is not None:
            log_time = self._clock()
            self.record(message, log_time, log_time if own_time is None else own_time, payload)
        elif own_time is None:
            self._without_time.append((message, payload))  # filed under the time of what follows
        else:
            self._write_waiting(own_time)
            self.record(message, own_time, own_time, payload)
        return ()

    @property
    def statistics(self) -> NodeStatistics:
        """Blocks in the file."""
        return NodeStatistics(recorded=self.recorded[AccelerationBlock])

    def close(self) -> None:
        """Finish the file and give it its name. A second call does nothing.

        Raises FileNotFoundError where the file was removed or moved; it ends properly where it is.
        """
        if self._file.closed:
            return
        self._write_waiting(0)
        self._writer.finish()
        self._file.flush()
        os.fsync(self._file.fileno())
        self.is_in_place = self._has_its_name()
        self._file.close()
        self._require_its_name()
        self._active.rename(self.path)
        sync_folder(self.path.parent)

    def sync(self) -> None:
        """Have everything that was recorded survive a power cut: ends the open chunk.

        Raises OSError where the disk refuses, FileNotFoundError where the file was removed or
        moved: what is written then is not in the recording.
        """
        if self._file.closed:
            return
        self._writer.flush()
        self._chunk_opened_ns = None
        os.fsync(self._file.fileno())
        self.is_in_place = self._has_its_name()
        self._require_its_name()

    def _has_its_name(self) -> bool:
        """Whether the open file is the one of its name: none is there, or another, where it was
        removed, renamed or replaced, and all writing to it still succeeds."""
        try:
            named = self._active.stat()
        except FileNotFoundError:
            return False
        return os.path.samestat(named, os.fstat(self._file.fileno()))

    def _require_its_name(self) -> None:
        if not self.is_in_place:
            text = "its file was removed or moved while it was written"
            raise FileNotFoundError(errno.ENOENT, text, str(self._active))

    @property
    def size(self) -> int:
        """Size of what has left the open chunk [bytes]."""
        return 0 if self._file.closed else self._file.tell()

    def abandon(self) -> None:
        """Let go of a file that the disk refuses to take more of; it keeps its ".active"."""
        with suppress(OSError):
            self._file.close()

    def remove(self) -> None:
        """Let go of an unfinished file, and have it gone."""
        self.abandon()
        self._active.unlink(missing_ok=True)

    def _write_waiting(self, time_ns: int) -> None:
        waiting, self._without_time = self._without_time, []
        for message, payload in waiting:
            self.record(message, time_ns, time_ns, payload)

    def record(
        self, message: Message, log_time: int, publish_time: int, payload: bytes | None = None
    ) -> None:
        """Record one message under times that are known [ns since 1970-01-01 UTC]."""
        self._close_old_chunk(log_time)
        key = key_of(message)
        self._writer.add_message(
            self._channel(key, type(message)),
            log_time=log_time,
            publish_time=publish_time,
            data=encode(message) if payload is None else payload,
            sequence=self._sequence(key, message),
        )
        self.recorded[type(message)] += 1
        if self._chunk_opened_ns is None:
            self._chunk_opened_ns = log_time

    def _close_old_chunk(self, now_ns: int) -> None:
        opened_ns = self._chunk_opened_ns
        if opened_ns is None:
            return
        age = abs(now_ns - opened_ns)  # a clock that is set back makes no chunk eternal
        if age >= self._settings.chunk_duration * NANOSECONDS:
            self._writer.flush()
            self._chunk_opened_ns = None

    def _channel(self, key: str, message_type: type) -> int:
        if key not in self._channels:
            self._channels[key] = self._writer.register_channel(
                key, MessageEncoding.Protobuf, self._schema(message_type)
            )
        return self._channels[key]

    def _schema(self, message_type: type) -> int:
        if message_type not in self._schemas:
            name = message_type.__name__
            self._schemas[message_type] = self._writer.register_schema(
                full_name(name), SchemaEncoding.Protobuf, self_description(name)
            )
        return self._schemas[message_type]

    def _sequence(self, key: str, message: Message) -> int:
        """The publisher's own number where it has one, else the count on this key [mod 2³²]."""
        count = self._counts[key] = self._counts.get(key, -1) + 1
        sequence = message.sequence if isinstance(message, AccelerationBlock) else count
        return sequence & 0xFFFF_FFFF


@contextmanager
def whole_recording(
    path: Path, *, metadata: Metadata, settings: RecorderSettings | None = None
) -> Iterator[Recorder]:
    """A recording that is there in the end, or not at all where what is written fails.

    Parameters
    ----------
    path : Path
        Of the recording.
    metadata : Metadata
        Stored in it.
    settings : RecorderSettings, optional
        The defaults where left out.

    Raises
    ------
    RecordingError
        If the file exists or cannot be written.

    Notes
    -----
    Where it is interrupted, what was written can be salvaged.
    """
    recorder = Recorder(path, metadata=metadata, clock=None, settings=settings)
    try:
        yield recorder
        recorder.close()
    except OSError as error:
        recorder.remove()
        raise _refused(path, error) from error
    except Exception:  # a crash is what is looked for
        recorder.remove()
        raise
    except BaseException:  # Ctrl-C
        logger.warning(
            "%s%s holds what was written until now: `pilewatch salvage` makes a recording of it, "
            "or remove it", path, ACTIVE_SUFFIX,
        )  # fmt: skip
        raise


def _refused(path: Path, error: OSError) -> RecordingError:
    return RecordingError(f"cannot record to {path}: {error.strerror or error}; nothing was left")


def _active(path: Path) -> Path:
    if not path.name or path.is_dir():
        raise RecordingError(f"cannot record to {path}: it is a folder; a file is needed")
    return path.with_name(path.name + ACTIVE_SUFFIX)


def _created(path: Path, active: Path) -> BufferedWriter:
    for existing in (path, active):
        if existing.exists():
            raise RecordingError(
                f"{existing} exists already: a recording is never overwritten; "
                "move it or record to another file"
            )
    try:
        return active.open("xb")
    except OSError as error:
        raise RecordingError(
            f"cannot record to {active}: {error.strerror}; the folder must exist and be writable"
        ) from error
