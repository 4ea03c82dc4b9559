"""`pilewatch audit`: the books of a folder, from its files alone."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from pipeline.messages import Message
from pipeline.recording.errors import RecordingError
from pipeline.recording.latest_messages import files_of, readable_messages
from pipeline.recording.reader import decoded, read_metadata, recorded_messages
from pipeline.recording.rotation import RESULTS
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.runtime.snapshots import ANSWERS, FOLDER, parsed
from pipeline.scenario import scenario_from_metadata
from pipeline.sources.session_files import SESSION_FILE
from pipeline.state.books import Books
from pipeline.state.phrases import count_noun
from pipeline.updating.checkpoint import CheckpointError
from sensors.errors import InputError
from sensors.json_values import Json


@dataclass(frozen=True, slots=True)
class Audit:
    """What the files of a folder prove."""

    folder: Path
    books: Books
    damaged: tuple[str, ...]
    """Files that cannot be read to their end, in words."""
    n_files: int
    n_open: int
    """Of them not closed: their run goes on or was killed."""

    @property
    def violations(self) -> tuple[str, ...]:
        """Sentences on books that do not balance and damaged files; none: all is proven."""
        return (*self.damaged, *self.books.violations())

    @property
    def line(self) -> str:
        """The result in one line."""
        found = len(self.violations)
        verdict = "the books balance" if not found else f"{found} violations"
        files = count_noun(self.n_files, "file")
        left = f" ({self.n_open} not closed: its run goes on or was killed)" if self.n_open else ""
        return f"{self.folder}: {verdict}; {files}{left}, {self.books.line}"

    def as_json(self) -> Json:
        """Return all figures; names are stable."""
        return {
            "folder": str(self.folder),
            "files": self.n_files,
            "files_not_closed": self.n_open,
            "damaged": list(self.damaged),
            **self.books.as_json(),
            "balanced": not self.violations,
        }


def audit(folder: Path) -> Audit:
    """Read all recordings and snapshots of a folder and keep its books.

    Raises
    ------
    InputError
        If the folder holds no recording.
    """
    files = recordings_of(folder)
    if not files:
        raise InputError(f"{folder} holds no recording; give the folder of a run (its --out)")
    books = Books(updates=_has_structure(files))
    damaged = list(_damaged_snapshots(folder))
    for file in files:
        try:
            for message in _messages(file):
                books.handle(message)
        except RecordingError as error:
            damaged.append(str(error))
    n_open = sum(file.name.endswith(ACTIVE_SUFFIX) for file in files)
    return Audit(folder, books, tuple(damaged), len(files), n_open)


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
    return sorted(found, key=lambda file: (file.stat().st_mtime_ns, RESULTS in file.name))


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
