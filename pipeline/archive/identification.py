"""The windows of one task, identified: what a worker does with a file.

The graph's own identification node does it, so that an archive is identified as a session is. What
links a window with those before it is left to the history: the names of modes, and whether channels
have changed place.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

from pipeline.archive.access.remote import on_disk
from pipeline.archive.compact import kept_frames
from pipeline.archive.plan import IdentificationTask, Piece
from pipeline.archive.store import StoredFrame, key_of_result
from pipeline.messages import (
    FoundationTruth,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.nodes.identification import IdentificationNode
from pipeline.oma.settings import OmaSettings
from pipeline.recording.salvage import remaining_messages
from pipeline.runtime.source_feed import with_end
from pipeline.sources.recorded_stream import SensorMessage
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.replayed import ReplayedTower
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import one_blas_thread

ARCHIVE_SESSION = "archive"  # what the samples of a chain become, whatever sessions they are of
SCADA_BEFORE = 600.0  # in which the state at a window's beginning was reported [s]
TRACKING = "mode-"  # codes of warnings that come from following modes over windows
WHOLE_FILES = 10**9  # blocks of a task that wait for those before them: those of its files at most
READ = (SensorLayout, AccelerationBlock, ScadaSample, FoundationTruth)


@dataclass(frozen=True, slots=True)
class IdentificationCall:
    """All that identifies a task's windows, wherever it is done."""

    task: IdentificationTask
    settings: OmaSettings
    layouts: tuple[SensorLayout, ...] = ()
    """Of its blocks, from whatever file has them."""
    period: int = 0
    """Number of the turbine's layout period that its windows are updated in."""
    renamed: tuple[tuple[str, str], ...] = ()
    """Channels that the turbine's layout gives another name than the task's files do: both."""

    @property
    def key(self) -> str:
        """Fingerprint of the samples and of what is done with them."""
        renamed = [repr(self.renamed)] if self.renamed else []
        return key_of_result(
            "identification 2", self.task.content, repr(self.settings), repr(self.layouts), *renamed
        )


def identified_frames(call: IdentificationCall) -> tuple[StoredFrame, ...]:
    """Return what `identified` gives, as it is kept."""
    return tuple(kept_frames(identified(call)))


def identified(call: IdentificationCall) -> tuple[Message, ...]:
    """ModalEstimate or WindowRejected of every window, in order; truths of a simulation too.

    Modes have no names. What is damaged in a file is a gap. Raises RecordingError where a file is
    gone.
    """
    node = IdentificationNode(call.settings, compared=False)
    answers: list[Message] = []
    with one_blas_thread():
        for message in chain(call.layouts, with_end(task_messages(call.task))):
            if isinstance(message, FoundationTruth):
                answers.append(message)
            else:
                answers += map(_untracked, node.handle(message))
    node.close()
    wanted = (FoundationTruth, ModalEstimate, WindowRejected)
    names = dict(call.renamed)
    return tuple(_renamed(answer, names) for answer in answers if isinstance(answer, wanted))


def _renamed(answer: Message, names: Mapping[str, str]) -> Message:
    """Return an answer with its channels as the turbine's layout calls them."""
    if not isinstance(answer, ModalEstimate):
        return answer
    return replace(answer, channels=tuple(names.get(each, each) for each in answer.channels))


def _untracked(answer: Message) -> Message:
    """Remove what a tracker of this task alone has reported."""
    if not isinstance(answer, ModalEstimate):
        return answer
    warnings = tuple(each for each in answer.warnings if not each.code.startswith(TRACKING))
    modes = tuple(replace(mode, name="") for mode in answer.modes)
    return replace(answer, modes=modes, warnings=warnings)


def task_messages(task: IdentificationTask) -> Iterator[Message]:
    """Yield what the task's turbine measured in its stretch, as one session from sample 0 on."""
    if task.in_order:
        yield from _as_recorded(task)
        return
    truths = []

    def measured() -> Iterator[SensorMessage]:
        for message in _as_recorded(task):
            if isinstance(message, SensorLayout | AccelerationBlock | ScadaSample):
                yield message
            else:
                truths.append(message)

    yield from ReplayedTower(measured(), latest_blocks=WHOLE_FILES)
    yield from truths


def _as_recorded(task: IdentificationTask) -> Iterator[Message]:
    """The same in the order of recording."""
    if task.before is not None:
        since = task.start_ns - round(SCADA_BEFORE * NANOSECONDS)
        for sample in messages_of(task.before, (ScadaSample,)):
            if _is_of(sample, task.turbine) and since <= message_time(sample) < task.start_ns:
                yield sample
    if not task.pieces:
        everything = messages_of(task.path, READ)
        yield from (each for each in everything if _is_of(each, task.turbine))
    for path in dict.fromkeys(piece.path for piece in task.pieces):
        pieces = [piece for piece in task.pieces if piece.path == path]
        for message in messages_of(path, READ):
            if isinstance(message, AccelerationBlock):
                yield from _wanted(message, task.turbine, pieces)
            elif _is_of(message, task.turbine) and _within(message, task):
                yield message


def messages_of(path: Path, types: tuple[type[Message], ...]) -> Iterator[Message]:
    """Yield what can be read of a file, wherever it lies."""
    with on_disk(path) as file:
        yield from remaining_messages(file, types)


def _is_of(message: Message, turbine: str) -> bool:
    return bool(message.turbine == turbine)


def _within(message: Message, task: IdentificationTask) -> bool:
    """Whether what was reported beside the samples concerns the task."""
    return isinstance(message, SensorLayout) or message_time(message) < task.end_ns


def message_time(message: Message) -> int:
    """Return the time of a ScadaSample or a FoundationTruth [ns]; 0 of what has none."""
    return message.time_ns if isinstance(message, ScadaSample | FoundationTruth) else 0


def _wanted(
    block: AccelerationBlock, turbine: str, pieces: Sequence[Piece]
) -> Iterator[AccelerationBlock]:
    """Yield the samples of a block that belong to the task, counted from its first."""
    for piece in pieces:
        if (block.turbine, block.unit, block.session) == (turbine, piece.unit, piece.session):
            first = max(block.first_sample, piece.first_sample)
            end = min(block.next_sample, piece.end_sample)
            if first < end:
                yield _cut(block, first, end, piece)


def _cut(block: AccelerationBlock, first: int, end: int, piece: Piece) -> AccelerationBlock:
    """Samples `first` to `end` of the block's session."""
    skipped = first - block.first_sample
    return replace(
        block,
        session=ARCHIVE_SESSION,
        sequence=block.sequence + piece.sequence_shift,
        first_sample=first + piece.shift,
        start_ns=block.start_ns + round(skipped / block.sampling_rate * NANOSECONDS),
        samples=block.samples[skipped : end - block.first_sample],
    )
