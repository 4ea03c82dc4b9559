"""`pilewatch audit`: the books of a folder, from its files alone."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.offline.stopped_runs import stopped_runs
from pipeline.recording.errors import RecordingError
from pipeline.recording.latest_messages import files_of, readable_messages
from pipeline.recording.reader import decoded, read_metadata, recorded_messages
from pipeline.recording.rotation import RESULTS, SESSION_FILE, repeats_part
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.runtime.snapshots import ANSWERS, FOLDER, parsed
from pipeline.scenario import scenario_from_metadata
from pipeline.state.books import REPORTED_WITHIN, Books
from pipeline.state.phrases import count_noun
from pipeline.updating.checkpoint import CheckpointError
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from sensors.json_values import Json

NO_END_NS = 2**63 - 1  # no end of a period [ns]
StreamOfUnit = tuple[str, str, str]  # turbine, unit, session


@dataclass(frozen=True, slots=True)
class AuditPeriod:
    """The part of a folder's time that is looked at, by the units' clocks."""

    since_ns: int = 0
    """Blocks and windows that end later are counted [ns since 1970-01-01 UTC]."""
    until_ns: int = NO_END_NS
    """Blocks and windows that end later are not [ns since 1970-01-01 UTC]."""

    def __post_init__(self) -> None:
        if not self.since_ns < self.until_ns:
            raise InputError("--since is not before --until; the period between them is empty")

    @property
    def whole(self) -> bool:
        """Whether it leaves nothing out."""
        return self == AuditPeriod()

    def messages(self, messages: Iterable[Message]) -> Iterator[Message]:
        """Yield the messages of the period, and all statuses.

        Of each unit the block before the first and some after the last are among them, so that a
        gap over an edge counts whole and is none of which blocks may still come; see
        `is_outside`. The end of a stream is left out: its count of blocks is of all of them.
        """
        before: dict[StreamOfUnit, AccelerationBlock] = {}
        after: dict[StreamOfUnit, list[int]] = {}
        for message in messages:
            match message:
                case AccelerationBlock():
                    yield from self._blocks(message, before, after)
                case StreamGap():
                    if message.end_ns > self.since_ns and message.start_ns < self.until_ns:
                        yield message
                case StreamEnd():
                    continue
                case ModalEstimate() | WindowRejected():
                    if self._has(message.end_ns):
                        yield message
                case FoundationPosterior():
                    if self._has(message.time_ns):
                        yield message
                case _:
                    yield message

    def is_outside(self, message: Message) -> bool:
        """Whether it is one of the blocks beside the period that `messages` gives too."""
        return isinstance(message, AccelerationBlock) and not self._has(message.end_ns)

    def _has(self, end_ns: int) -> bool:
        return self.since_ns < end_ns <= self.until_ns

    def _blocks(
        self,
        block: AccelerationBlock,
        before: dict[StreamOfUnit, AccelerationBlock],
        after: dict[StreamOfUnit, list[int]],
    ) -> Iterator[AccelerationBlock]:
        unit = (block.turbine, block.unit, block.session)
        if block.end_ns <= self.since_ns:
            before[unit] = block
            return
        if not self._has(block.end_ns):
            numbers = after.setdefault(unit, [])
            follows = not numbers or block.sequence == numbers[-1] + 1
            if not follows or len(numbers) >= REPORTED_WITHIN:
                return
            numbers.append(block.sequence)
        if unit in before:
            yield before.pop(unit)
        yield block


@dataclass(frozen=True, slots=True)
class Audit:
    """What the files of a folder prove."""

    folder: Path
    books: Books
    unrecorded: tuple[str, ...]
    """Results that a run had while its recording had stopped, in words."""
    damaged: tuple[str, ...]
    """Files that cannot be read to their end, in words."""
    n_files: int
    n_open: int
    """Of them not closed: their run goes on or was killed."""
    whole: bool = True
    """Whether all of the folder's time was looked at, not a period."""

    @property
    def violations(self) -> tuple[str, ...]:
        """Sentences on books that do not balance, on damaged files and on results that are not
        recorded; none: all is proven."""
        return (*self.damaged, *self.books.violations(), *self.unrecorded)

    @property
    def line(self) -> str:
        """The result in one line."""
        found = len(self.violations)
        verdict = "the books balance" if not found else count_noun(found, "violation")
        files = count_noun(self.n_files, "file")
        if not found and self.books.is_empty:
            where = "" if self.whole else " in this period"
            return f"{self.folder}: nothing was recorded{where}; {files}"
        left = f" ({self.n_open} not closed: its run goes on or was killed)" if self.n_open else ""
        return f"{self.folder}: {verdict}; {files}{left}, {self.books.line}"

    def as_json(self) -> Json:
        """Return all figures; names are stable."""
        return {
            "folder": str(self.folder),
            "files": self.n_files,
            "files_not_closed": self.n_open,
            "damaged": list(self.damaged),
            "not_recorded": list(self.unrecorded),
            **self.books.as_json(),
            "balanced": not self.violations,
        }


def audit(folder: Path, period: AuditPeriod | None = None) -> Audit:
    """Read all recordings and snapshots of a folder and keep its books.

    Parameters
    ----------
    period : AuditPeriod, optional
        Looks at this part alone; None: at all.

    Raises
    ------
    InputError
        If there is no such folder, it is a file, or it holds no recording.
    """
    if not folder.exists():
        raise InputError(f"{folder} does not exist; give the folder of a run (its --out)")
    if not folder.is_dir():
        raise InputError(f"{folder} is a file; give the folder of a run (its --out)")
    files = recordings_of(folder)
    if not files:
        raise InputError(f"{folder} holds no recording; give the folder of a run (its --out)")
    books = Books(updates=_has_structure(files))
    damaged = list(_damaged_snapshots(folder))
    messages = _all_messages(files, damaged)
    period = period or AuditPeriod()
    if period.whole:
        for message in messages:
            books.handle(message)
        unrecorded = tuple(_not_recorded(folder, files, books))
    else:
        for message in period.messages(messages):
            books.handle(message, outside=period.is_outside(message))
        unrecorded = ()
    n_open = sum(file.name.endswith(ACTIVE_SUFFIX) for file in files)
    return Audit(folder, books, unrecorded, tuple(damaged), len(files), n_open, period.whole)


def _not_recorded(folder: Path, files: Iterable[Path], books: Books) -> Iterator[str]:
    """Enter the blocks that runs received while recording had stopped; yield what else is missing.

    Where samples have gone with their age, blocks cannot be compared.
    """
    has_all_samples = not any(RESULTS in file.name for file in files)
    for run in stopped_runs(folder):
        if has_all_samples:
            for session, n_blocks in run.received.items():
                books.enter_received(session, n_blocks)
        yield from run.unrecorded_windows(books)


def _all_messages(files: list[Path], damaged: list[str]) -> Iterator[Message]:
    """Yield the messages of all files; one that cannot be read to its end is noted."""
    for file in files:
        try:
            yield from _messages(file)
        except RecordingError as error:
            damaged.append(str(error))


def _messages(file: Path) -> Iterator[Message]:
    """Yield a closed part's messages, checksums verified; of one in writing what is there."""
    if file.name.endswith(ACTIVE_SUFFIX):
        yield from readable_messages(file)
        return
    for recorded in recorded_messages(file):
        yield decoded(file, recorded)


def recordings_of(folder: Path) -> list[Path]:
    """Every recording of the runs in a folder, in the order of writing; a part whose samples have
    gone is there by its results."""
    stem = Path(SESSION_FILE).stem
    found = {*folder.glob(f"{stem}*.mcap"), *files_of(folder / SESSION_FILE)}
    once = [file for file in found if not repeats_part(file)]
    return sorted(once, key=lambda file: (file.stat().st_mtime_ns, RESULTS in file.name))


def _has_structure(files: list[Path]) -> bool:
    """Whether the runs had an updating; True where it is not known."""
    for file in reversed(files):
        try:
            return scenario_from_metadata(read_metadata(file)["scenario"], "").has_structure
        except (InputError, KeyError):
            continue
    return True


def _damaged_snapshots(folder: Path) -> Iterator[str]:
    for path in sorted((*folder.glob(f"{FOLDER}/*"), *folder.glob(f"{ANSWERS}/*"))):
        if path.suffix == ".checkpoint":
            try:
                parsed(path.read_bytes(), None, str(path))
            except CheckpointError as error:
                yield str(error)
