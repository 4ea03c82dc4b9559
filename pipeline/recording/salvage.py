"""What is left of a recording that was cut off or damaged."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from mcap.opcode import Opcode

from pipeline.messages import Message
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import (
    MCAP_DAMAGE,
    McapChannels,
    RecordedMessage,
    chunk_records,
    complete_records,
    incomplete_bytes,
    is_closed_properly,
    metadata_section,
    open_recording,
    summary_of,
)
from pipeline.recording.writer import ACTIVE_SUFFIX, whole_recording
from pipeline.state.phrases import count_noun
from pipeline.transport.codec import decode
from pipeline.transport.errors import CodecError
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

_SALVAGED = ".salvaged.mcap"  # how the name of what was salvaged ends


@dataclass(frozen=True, slots=True)
class SalvagedContent:
    """How much of a file can still be read."""

    chunks: int
    """Complete, with a checksum that holds."""
    damaged_chunks: int
    """There, but not as they were written."""
    messages: int
    unreadable_messages: int
    """In complete chunks, but not what their channel says."""
    duration: float
    """From the first sample of any unit to the last of any [s]."""
    foreign_messages: int = 0
    """Of other programs, which no recording of ours takes."""
    foreign: tuple[str, ...] = ()
    """Topics of other programs."""
    cut_bytes: int = 0
    """Of the incomplete end of a file that was cut off."""
    gone_messages: int = 0
    """That the file's own summary counts and that cannot be read."""

    def __str__(self) -> str:
        if not self.messages:
            return f"nothing of it can be salvaged{self._lost}"
        return f"{self._what}, can be salvaged{self._lost}"

    @property
    def recovered(self) -> str:
        """Return in words what was salvaged."""
        return f"{self._what}{self._lost}"

    @property
    def _what(self) -> str:
        return (
            f"{count_noun(self.chunks, 'complete chunk')} with "
            f"{count_noun(self.messages, 'message')}, "
            f"{self.duration:.1f} s of samples"
        )

    @property
    def _lost(self) -> str:
        """What is not among it, as far as the file shows."""
        parts = []
        if self.damaged_chunks:
            gone = f": {_are(self.gone_messages)} gone" if self.gone_messages else ""
            verb = "is" if self.damaged_chunks == 1 else "are"
            parts.append(f"{self.damaged_chunks} more {verb} damaged{gone}")
        if self.unreadable_messages:
            parts.append(f"{_are(self.unreadable_messages)} unreadable")
        if self.cut_bytes:
            last = "the last byte is incomplete: it is gone"
            if self.cut_bytes > 1:
                last = f"the last {self.cut_bytes} bytes are incomplete: they are gone"
            parts.append(last)
        if self.foreign_messages:
            topics = ", ".join(self.foreign)
            parts.append(f"{_are(self.foreign_messages, ' of other programs')} left out: {topics}")
        return f" ({'; '.join(parts)})" if parts else ""


def _are(messages: int, what: str = "") -> str:
    """Return "1 message is" or "2 messages are"."""
    return f"{count_noun(messages, 'message')}{what} {'is' if messages == 1 else 'are'}"


def salvaged_name(source: Path) -> Path:
    """Return where the remains of a recording go unless another place is given."""
    name = source.name.removesuffix(ACTIVE_SUFFIX)
    return source.parent / f"{name}{_SALVAGED}"


def what_to_do(source: Path) -> str:
    """Return in words the way on with a recording that was cut off: salvage it, or use what was
    salvaged already."""
    salvaged = salvaged_name(source)
    if not salvaged.exists():
        return f"`pilewatch salvage {source}` makes a recording of what is in it"
    return f"{salvaged} was salvaged from it: {how_to_use(source, salvaged)}"


def how_to_use(source: Path, salvaged: Path) -> str:
    """Return in words how a salvaged recording is read, by itself or with its folder."""
    place = source.with_name(source.name.removesuffix(ACTIVE_SUFFIX))
    return (
        f"give that file alone, or, to read the folder, move {source.name} out of it and then "
        f"{salvaged.name} to {place}"
    )


def salvage(source: Path, target: Path) -> SalvagedContent:
    """Write every message of the complete chunks of `source` to a new, whole recording `target`.

    Parameters
    ----------
    source : Path
        A recording that may be cut or damaged; it is left as it is.
    target : Path
        The new recording, with the metadata and all times as they were.

    Raises
    ------
    RecordingError
        If the source is no recording or holds no message that can be read, or the target exists or
        cannot be written; nothing is left of it then.
    """
    if source.is_dir():
        raise RecordingError(
            f"{source} is a folder; give the recording in it that is cut or damaged, such as "
            f"{_damaged_in(source)}"
        )
    with open_recording(source) as file:
        remains = Remains()
        with whole_recording(target, metadata=remaining_metadata(file)) as recorder:
            for recorded in remains.messages(file):
                message = remains.decoded(recorded)
                if message is not None:
                    recorder.record(
                        message, log_time=recorded.log_time, publish_time=recorded.publish_time
                    )
            content = remains.counted()
            if not content.messages:
                raise RecordingError(f"{source}: {content}; no file was written")
    return content


def _damaged_in(folder: Path) -> Path:
    """A recording of a folder that may be meant: the one that a killed run left open, if any."""
    unfinished = sorted(folder.glob(f"*.mcap{ACTIVE_SUFFIX}"))
    closed = [each for each in folder.glob("*.mcap") if not each.name.endswith(_SALVAGED)]
    return (unfinished or sorted(closed) or [folder / "session.mcap"])[-1]


def what_is_left(file: BinaryIO) -> SalvagedContent:
    """Return how much of an unfinished file can be salvaged."""
    remains = Remains()
    for recorded in remains.messages(file):
        remains.decoded(recorded)
    return remains.counted()


class Remains:
    """Goes through the complete chunks of a file and counts what it meets."""

    def __init__(self) -> None:
        self.lost_bytes = 0  # of damaged chunks, as they lie in the file
        self.channels = McapChannels()
        self._chunks = self._damaged = self._messages = self._unreadable = 0
        self._cut_bytes = 0
        self._expected: int | None = None  # messages by the file's summary
        self._starts_ns: list[int] = []
        self._ends_ns: list[int] = []

    def messages(self, file: BinaryIO) -> Iterator[RecordedMessage]:
        """Yield what the complete chunks hold, in order, not yet decoded."""
        summary = summary_of(file)
        self.channels.learn(summary)
        if summary is not None and summary.statistics is not None:
            self._expected = summary.statistics.message_count
        elif not is_closed_properly(file):
            self._cut_bytes = incomplete_bytes(file)
        for record in chunk_records(file, summary):
            try:
                messages = self.channels.messages(record)
            except MCAP_DAMAGE:
                self._damaged += 1
                self.lost_bytes += len(record.content)
                continue
            self._chunks += 1
            yield from messages

    def decoded(self, recorded: RecordedMessage) -> Message | None:
        """Return the message itself; None where it is not what its channel says."""
        try:
            message: Message = decode(recorded.message_type, recorded.payload)
        except CodecError:
            self._unreadable += 1
            return None
        self._messages += 1
        if isinstance(message, AccelerationBlock):
            self._starts_ns.append(message.start_ns)
            self._ends_ns.append(message.end_ns)
        return message

    def counted(self) -> SalvagedContent:
        """Return what has been met until now."""
        met = self._messages + self._unreadable + self.channels.n_foreign
        span_ns = max(self._ends_ns, default=0) - min(self._starts_ns, default=0)
        return SalvagedContent(
            chunks=self._chunks,
            damaged_chunks=self._damaged,
            messages=self._messages,
            unreadable_messages=self._unreadable,
            duration=span_ns / NANOSECONDS,
            foreign_messages=self.channels.n_foreign,
            foreign=tuple(sorted(self.channels.foreign)) if self.channels.n_foreign else (),
            cut_bytes=self._cut_bytes,
            gone_messages=0 if self._expected is None else max(0, self._expected - met),
        )


def remaining_messages(path: Path, message_types: Sequence[type]) -> Iterator[Message]:
    """Yield messages as `read_messages`, with what is damaged left out.

    Raises RecordingError where the file is missing or no recording at all.
    """
    remains = Remains()
    with open_recording(path) as file:
        for recorded in remains.messages(file):
            if recorded.message_type in message_types:
                message = remains.decoded(recorded)
                if message is not None:
                    yield message


def remaining_metadata(file: BinaryIO) -> dict[str, dict[str, str]]:
    """Section → name → text, of the sections that can be read."""
    sections: dict[str, dict[str, str]] = {}
    for record in complete_records(file):
        if record.opcode == Opcode.METADATA:
            try:
                name, texts = metadata_section(record)
            except MCAP_DAMAGE:
                continue
            sections[name] = texts
    return sections
