"""What a recording holds, in one look."""

from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

from pipeline.messages import Message, NodeStatus, StreamGap
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import RecordedMessage, is_closed_properly, open_recording
from pipeline.recording.reader import decoded, read_metadata, recorded_messages
from pipeline.recording.salvage import Remains, remaining_metadata
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout

_LOOKED_INTO = (AccelerationBlock, SensorLayout, NodeStatus)  # the others are only counted


@dataclass(frozen=True, slots=True)
class ChannelInfo:
    """One key of the recording."""

    key: str
    message: str
    """Type name."""
    count: int


@dataclass(frozen=True, slots=True)
class UnitInfo:
    """What was recorded of one session of one acquisition unit."""

    turbine: str
    unit: str
    session: str
    sampling_rate: float
    """Sampling rate [Hz]."""
    n_channels: int
    n_blocks: int
    start_ns: int
    """First sample."""
    end_ns: int
    """One sample after the last."""
    gaps: tuple[StreamGap, ...]
    """Between the first and the last block."""
    layout_id: str = ""
    """Of the first block."""
    first_sample: int = 0
    """Since the session's start."""
    next_sample: int = 0
    """One after the last."""
    first_sequence: int = 0
    """Of the blocks."""
    last_sequence: int = 0
    missing: tuple[tuple[int, int], ...] = ()
    """Samples that each gap lacks: the first, and one after the last."""
    in_order: bool = True
    """Whether blocks were recorded in the order of their numbers."""

    @property
    def duration(self) -> float:
        """Time from the first sample to the last, gaps included [s]."""
        return (self.end_ns - self.start_ns) / NANOSECONDS


@dataclass(frozen=True, slots=True)
class RecordingInfo:
    """What a recording holds."""

    path: Path
    size: int
    """Size of the file [bytes]."""
    metadata: dict[str, dict[str, str]]
    channels: tuple[ChannelInfo, ...]
    units: tuple[UnitInfo, ...]
    layouts: tuple[SensorLayout, ...]
    health: tuple[NodeStatus, ...]
    """The last status of every node that was recorded."""
    damage: str = ""
    """What of the file cannot be read, for people; "" nothing is known of any."""

    @property
    def duration(self) -> float:
        """Time from the first sample of any unit to the last of any [s]; 0 without samples."""
        if not self.units:
            return 0.0
        first_ns = min(unit.start_ns for unit in self.units)
        return (max(unit.end_ns for unit in self.units) - first_ns) / NANOSECONDS


@dataclass(frozen=True, slots=True)
class _Span:
    """A block without its samples."""

    sequence: int
    first_sample: int
    next_sample: int
    start_ns: int
    end_ns: int


def recording_info(path: Path) -> RecordingInfo:
    """Channels, durations, gaps, metadata and the nodes' health. Reads the whole file and
    verifies its checksums; raises RecordingError like `read_messages`."""
    metadata = read_metadata(path)
    tally = _Tally()
    for recorded in recorded_messages(path):
        tally.count(recorded)
        if recorded.message_type in _LOOKED_INTO:
            tally.add(decoded(path, recorded))
    return tally.info(path, metadata)


def salvageable_info(path: Path) -> RecordingInfo:
    """Return `recording_info` of the chunks that can be read; `damage` lists the others.

    Raises RecordingError where the file is missing or no recording, has no pilewatch channel, or
    nothing of it is left.
    """
    tally, remains = _Tally(), Remains()
    with open_recording(path) as file:
        metadata = remaining_metadata(file)
        for recorded in remains.messages(file):
            tally.count(recorded)
            if recorded.message_type in _LOOKED_INTO:
                tally.add(remains.decoded(recorded))
        closed = is_closed_properly(file)
    damage = _damage(remains, closed=closed)
    if damage and not tally.spans:
        raise RecordingError(f"{path} {damage}; no samples are left")
    if remains.channels.foreign_content:
        raise RecordingError(f"{path} {remains.channels.foreign_content}")
    if not tally.counts and not metadata:  # a recording of ours begins with its metadata
        raise RecordingError(f"{path} holds no pilewatch channel, and no other")
    return replace(tally.info(path, metadata), damage=damage)


def _damage(remains: Remains, *, closed: bool) -> str:
    """Return what cannot be read, and how much is left; "" where all can."""
    content = remains.counted()
    problems = []
    if not closed:
        problems.append("was cut off before its end")
    if content.damaged_chunks:
        count, total = content.damaged_chunks, content.chunks + content.damaged_chunks
        problems.append(f"has lost {count} of {total} chunks ({remains.lost_bytes} bytes)")
    if content.unreadable_messages:
        problems.append(f"has {content.unreadable_messages} unreadable messages")
    left = f"{content.chunks} chunks are used"
    return "; ".join([" and ".join(problems), left]) if problems else ""


class _Tally:
    """Counts what goes by, samples forgotten."""

    def __init__(self) -> None:
        self.counts: Counter[tuple[str, type]] = Counter()
        self.sessions: dict[tuple[str, str, str], AccelerationBlock] = {}  # the first block
        self.spans: dict[tuple[str, str, str], list[_Span]] = defaultdict(list)
        self.layouts: dict[tuple[str, str, str], SensorLayout] = {}  # by turbine, unit, layout_id
        self.statuses: dict[str, NodeStatus] = {}

    def count(self, recorded: RecordedMessage) -> None:
        self.counts[recorded.key, recorded.message_type] += 1

    def add(self, message: Message | None) -> None:
        match message:
            case AccelerationBlock() as block:
                self._add_block(block)
            case SensorLayout() as layout:
                self.layouts[layout.turbine, layout.unit, layout.layout_id] = layout
            case NodeStatus() as status:
                self.statuses[status.node] = status

    def info(self, path: Path, metadata: dict[str, dict[str, str]]) -> RecordingInfo:
        return RecordingInfo(
            path=path,
            size=path.stat().st_size,
            metadata=metadata,
            channels=tuple(
                ChannelInfo(key, message_type.__name__, count)
                for (key, message_type), count in self.counts.items()
            ),
            units=tuple(
                _unit_info(self.sessions[session], spans) for session, spans in self.spans.items()
            ),
            layouts=tuple(self.layouts.values()),
            health=tuple(self.statuses.values()),
        )

    def _add_block(self, block: AccelerationBlock) -> None:
        session = (block.turbine, block.unit, block.session)
        self.sessions.setdefault(session, block)
        self.spans[session].append(
            _Span(
                block.sequence, block.first_sample, block.next_sample, block.start_ns, block.end_ns
            )
        )


def _unit_info(first: AccelerationBlock, spans: list[_Span]) -> UnitInfo:
    in_order = sorted(spans, key=lambda span: span.sequence)
    return UnitInfo(
        turbine=first.turbine,
        unit=first.unit,
        session=first.session,
        sampling_rate=first.sampling_rate,
        n_channels=first.samples.shape[1],
        n_blocks=len(spans),
        start_ns=in_order[0].start_ns,
        end_ns=in_order[-1].end_ns,
        gaps=tuple(_gaps(first, in_order)),
        layout_id=first.layout_id,
        first_sample=in_order[0].first_sample,
        next_sample=in_order[-1].next_sample,
        first_sequence=in_order[0].sequence,
        last_sequence=in_order[-1].sequence,
        missing=tuple(
            (before.next_sample, after.first_sample) for before, after in _apart(in_order)
        ),
        in_order=spans == in_order,
    )


def _apart(in_order: list[_Span]) -> Iterator[tuple[_Span, _Span]]:
    """Neighbours that samples are missing between."""
    for before, after in pairwise(in_order):
        if after.first_sample > before.next_sample:
            yield before, after


def _gaps(first: AccelerationBlock, in_order: list[_Span]) -> Iterator[StreamGap]:
    for before, after in _apart(in_order):
        yield StreamGap(
            turbine=first.turbine,
            unit=first.unit,
            session=first.session,
            start_ns=before.end_ns,
            end_ns=after.start_ns,
            first_sequence=before.sequence + 1,
            n_blocks=after.sequence - before.sequence - 1,
        )
