"""An identification that was killed goes on where it was, from what has been recorded.

    recording   layout  SCADA  blocks ▒▒▒▒▒▒▒▒▒▒▒▒▒▒▒┐ estimates, rejections
                               │ answered  │ open    │
                               └───────────┴─────────┤ from the first open window's start
    publisher's cache                            ▒▒▒▒▒▒▒▒▒▒▒ ─► goes on live

A publisher keeps so many blocks, however long a window is; the rest of an open window is refilled
from the recording. Windows that were answered are not answered again, but those of their estimates
to which no posterior is recorded are given once more: whoever updates counts none of them twice and
says again what it said of the latest (`pipeline.runtime.snapshots`).

Why nothing is written for this: the recording holds everything already (where there is none, see
`pipeline.runtime.identification_restart`), and what it does not hold
(a second before a kill) is answered again, with the same result. Several units of a turbine are
joined on a clock that begins with the first of their blocks, so their windows may lie elsewhere
after a restart; those of a single unit lie where they did.
"""

import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    QualityWarning,
    StabilisationDiagram,
    StreamGap,
    WindowRejected,
)
from pipeline.nodes.identification import Coat, IdentificationInContext
from pipeline.oma.settings import OmaSettings
from pipeline.oma.tracking import DIES_AFTER
from pipeline.recording.latest_messages import latest_messages
from pipeline.runtime.snapshots import CheckpointFolder, NodeCheckpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample

logger = logging.getLogger(__name__)

MARGIN = 2.0  # samples from so long before the open window, for stamps that scatter [s]
TAKEN_UP = (
    *(SensorLayout, AccelerationBlock, ScadaSample),
    *(ModalEstimate, WindowRejected, FoundationPosterior),
)

WindowAnswer = ModalEstimate | WindowRejected


def recorded_past(files: Sequence[Path], settings: OmaSettings) -> tuple[Message, ...]:
    """What an identification needs of the recordings: an open window, and the modes that may still
    be looked for."""
    horizon = settings.window_duration + (DIES_AFTER + 1) * settings.hop + MARGIN
    return latest_messages(files, TAKEN_UP, horizon=horizon)


@dataclass(frozen=True, slots=True)
class _OpenWindow:
    """Which samples are still needed and which answers have been given [ns]."""

    needed_ns: int = 0  # blocks that end before it are not
    answered_ns: int = -1  # end of the last window that was answered

    @classmethod
    def after(cls, answers: Sequence[WindowAnswer], hop: float) -> "_OpenWindow":
        """hop   from one window's start to the next one's [s]"""
        next_ns = answers[-1].start_ns + round((hop - MARGIN) * NANOSECONDS)
        return cls(next_ns, max(answer.end_ns for answer in answers))

    def is_new(self, answer: Message) -> bool:
        """Whether an answer is of no window that was answered before."""
        if isinstance(answer, StreamGap):  # before the first block that is taken, all is missing
            return answer.end_ns > self.needed_ns
        if isinstance(answer, ModalEstimate | StabilisationDiagram | WindowRejected):
            return answer.end_ns > self.answered_ns
        return True


class ResumedIdentification(Coat[IdentificationInContext]):
    """The identification, which takes up what was recorded when a turbine's first block comes.

    settings   of the identification
    past       messages in the order of recording; none: it begins anew
    """

    name = "identification"
    inputs: tuple[type, ...] = IdentificationInContext.inputs

    def __init__(self, settings: OmaSettings, past: Sequence[Message] = ()) -> None:
        self._settings = settings
        super().__init__(IdentificationInContext(settings))
        self._past = {turbine: _of(turbine, past) for turbine in {m.turbine for m in past}}
        self._open: dict[str, _OpenWindow] = {}  # by turbine
        self._to_recall: dict[str, list[WindowAnswer]] = {}  # when the turbine's session has begun
        self._updated_ns: dict[str, int] = {}  # by turbine: estimates up to it need not be repeated

    def remember(self, turbine: str, past: Sequence[Message], *, updated_ns: int) -> None:
        """What to take up when the turbine's first block comes, if nothing else is known of it.

        updated_ns   estimates that end up to then are not given once more
        """
        if past and turbine not in self._past:
            self._past[turbine] = list(past)
            self._updated_ns[turbine] = updated_ns

    def handle(self, message: Message) -> Iterator[Message]:
        if not isinstance(message, AccelerationBlock):
            yield from self._inner.handle(message)
            return
        if message.turbine in self._past:
            yield from self._taken_up(self._past.pop(message.turbine), message)
        yield from self._pushed(message)

    def _taken_up(self, past: Sequence[Message], block: AccelerationBlock) -> Iterator[Message]:
        """What was recorded before this block, the first that came by itself."""
        answers = _answers_in_session(past, block)
        if answers:
            self._open[block.turbine] = _OpenWindow.after(answers, self._settings.hop)
            self._to_recall[block.turbine] = answers
        for message in past:
            if isinstance(message, SensorLayout | ScadaSample):
                yield from self._inner.handle(message)
        recorded = _blocks_before(past, block)
        for each in recorded:
            yield from self._pushed(each)
        yield from _without_posterior(past, answers, self._updated_ns.pop(block.turbine, 0))
        logger.warning(
            "identification of %s continues after %d recorded windows and %d recorded blocks",
            *(block.turbine, len(answers), len(recorded)),
        )

    def _pushed(self, block: AccelerationBlock) -> Iterator[Message]:
        """The answers to a block that an open window needs."""
        opened = self._open.get(block.turbine, _OpenWindow())
        if block.end_ns <= opened.needed_ns:
            return
        yield from filter(opened.is_new, self._inner.handle(block))
        for answer in self._to_recall.pop(block.turbine, ()):
            self._inner.recall(answer)

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """See `IdentificationInContext.warnings`."""
        return self._inner.warnings


def _of(turbine: str, past: Sequence[Message]) -> list[Message]:
    return [message for message in past if message.turbine == turbine]


def _answers_in_session(past: Sequence[Message], block: AccelerationBlock) -> list[WindowAnswer]:
    """What the identification answered since the session of this block began, a window once.

    The updating may have rejected a window that was identified; the estimate counts.
    """
    began_ns = block.start_ns - round(block.first_sample / block.sampling_rate * NANOSECONDS)
    found: dict[int, WindowAnswer] = {}
    for message in past:
        if not isinstance(message, ModalEstimate | WindowRejected):
            continue
        inside = message.start_ns >= began_ns - MARGIN * NANOSECONDS
        if inside and not isinstance(found.get(message.start_ns), ModalEstimate):
            found[message.start_ns] = message
    return [found[start_ns] for start_ns in sorted(found)]


def _blocks_before(past: Sequence[Message], block: AccelerationBlock) -> list[AccelerationBlock]:
    """The blocks of the units' present sessions that begin before a block, in order of time."""
    recorded = [message for message in past if isinstance(message, AccelerationBlock)]
    sessions = {each.unit: each.session for each in recorded} | {block.unit: block.session}
    wanted = [
        each
        for each in recorded
        if each.session == sessions[each.unit] and each.start_ns < block.start_ns
    ]
    return sorted(wanted, key=lambda each: each.start_ns)


def _without_posterior(
    past: Sequence[Message], answers: Sequence[WindowAnswer], known_ns: int
) -> Iterator[ModalEstimate]:
    """Estimates after the last window that the updating is known to have answered."""
    starts = {each.start_ns for each in answers if isinstance(each, ModalEstimate)}
    updated_ns = max(
        (
            message.time_ns if isinstance(message, FoundationPosterior) else message.end_ns
            for message in past
            if isinstance(message, FoundationPosterior)
            or (isinstance(message, WindowRejected) and message.start_ns in starts)
        ),
        default=0,
    )
    for answer in answers:
        if isinstance(answer, ModalEstimate) and answer.end_ns > max(updated_ns, known_ns):
            yield answer


FOLDER = "tracks"  # inside a session's folder
MOST_WINDOWS = DIES_AFTER + 1  # that are kept of a turbine
MOST_TURBINES = 1000  # that are kept in memory; of strangers' there may be any number


class KeptIdentification(Coat[ResumedIdentification]):
    """An identification whose latest answers lie in a folder, from which it goes on.

    node     that has taken up nothing of the turbines that it is to take up from the folder
    folder   which is made when it is first needed

    A disk that is full costs the names of modes after a restart; `warnings` says so. Handling a
    block raises CheckpointError for a file of its turbine that is none.
    """

    name = "identification"
    inputs: tuple[type, ...] = ResumedIdentification.inputs

    def __init__(self, node: ResumedIdentification, folder: Path) -> None:
        super().__init__(node)
        self._folder = CheckpointFolder(folder, "identification")
        self._kept: dict[str, tuple[WindowAnswer, ...]] = {}  # by turbine, windows in order
        self._doubts: tuple[QualityWarning, ...] = ()

    def handle(self, message: Message) -> Iterator[Message]:
        if isinstance(message, AccelerationBlock) and message.turbine not in self._kept:
            self._recollect(message.turbine)
        for answer in self._inner.handle(message):
            yield answer
            if isinstance(answer, ModalEstimate | WindowRejected):
                self._keep(answer)

    def _recollect(self, turbine: str) -> None:
        found = self._folder.read(turbine)
        answers = () if found is None else found.answers
        kept = tuple(e for e in answers if isinstance(e, ModalEstimate | WindowRejected))
        self._inner.remember(turbine, kept, updated_ns=max([0, *(e.end_ns for e in kept[:-1])]))
        self._kept[turbine] = kept
        if len(self._kept) > MOST_TURBINES:
            del self._kept[next(iter(self._kept))]

    def _keep(self, answer: WindowAnswer) -> None:
        before = (
            _without_covariances(each)
            for each in self._kept.get(answer.turbine, ())
            if each.start_ns != answer.start_ns
        )
        kept = (*before, answer)[-MOST_WINDOWS:]
        self._kept[answer.turbine] = kept
        try:
            self._folder.write(NodeCheckpoint(answer.turbine, answer.end_ns, b"", kept))
        except OSError as error:
            path, reason = self._folder.file_of(answer.turbine), error.strerror or error
            text = f"{path} could not be written ({reason}): modes lose their names by a restart"
            if not self._doubts:
                logger.error(text)
            self._doubts = (QualityWarning("checkpoint-not-written", text),)
        else:
            self._doubts = ()

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """The node's own, and that the disk is full."""
        return (*self._inner.warnings, *self._doubts)


def _without_covariances(answer: WindowAnswer) -> WindowAnswer:
    """An estimate as far as its modes' names need it: a hundredth of its size."""
    if isinstance(answer, WindowRejected):
        return answer
    modes = tuple(
        replace(mode, covariance_factor=mode.covariance_factor[:, :0], n_block_columns=0)
        for mode in answer.modes
    )
    return replace(answer, modes=modes)
