"""Which files a recorded session consists of, and what they hold.

session-20260301T…Z.mcap   session-20260302T…Z.mcap   session.mcap   session.part2.mcap
a replay: not included     live ────────────────────► the same session, started again
"""

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    StreamGap,
    WindowRejected,
)
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import RecordedMessage
from pipeline.recording.reader import decoded, leading_metadata, recorded_messages
from pipeline.recording.rotation import RESULTS, next_part, part_of, results_of
from pipeline.recording.writer import ACTIVE_SUFFIX, Metadata
from pipeline.sources.recorded_stream import SourceError, recordings_in

logger = logging.getLogger(__name__)

SESSION_FILE = "session.mcap"  # the first part of what `pilewatch run` records
FRESH = "fresh"  # in the metadata's section "run": the session was started with --fresh
MOST_NAMED = 5  # files that a line names
_EARLIER = re.compile(  # as `pipeline.run.folder.set_aside` names the files of an earlier start
    rf"{Path(SESSION_FILE).stem}-(?P<date>\d{{8}}T\d{{6}}Z(?:-\d+)?)(?:\.part(?P<part>\d+))?"
    rf"(?:\{RESULTS})?\.mcap"
)
_FROM_FILES = ("replay:", "simulate:")  # how the source of what is no live session begins


@dataclass(frozen=True, slots=True)
class _EarlierFile:
    """A part of a start that a later one has set aside."""

    path: Path
    date: str
    """Of its last change, as its name has it."""
    part: int
    metadata: Metadata

    @property
    def epoch(self) -> int | None:
        """Number of the start; None in older recordings."""
        text = self.metadata.get("run", {}).get("epoch", "")
        return int(text) if text.isdigit() else None


def session_files(path: Path) -> list[Path]:
    """Return the closed parts of a session in order of recording, results where samples have gone.

    Parameters
    ----------
    path : Path
        A file, which is then the only one; a folder: of the session in it with the starts that it
        went on from, or, where there is none, every recording in it.

    Raises
    ------
    SourceError
        For a folder without recordings.

    Notes
    -----
    A live session that is started again in its folder goes on, unless with --fresh; a replay is a
    session of its own. Files of other sessions in the folder are named in one warning.
    """
    if not path.is_dir():
        return [path]
    included, others = session_in(path)
    if others:
        logger.warning("%s: %s", path, not_included_line(others))
    return included or recordings_in(path)


def earlier_sessions(path: Path) -> list[Path]:
    """Return the recordings in a session's folder that are of other sessions, oldest first."""
    return session_in(path)[1] if path.is_dir() else []


def not_included_line(others: Sequence[Path]) -> str:
    """Return in words which recordings of a folder are left out."""
    is_one = len(others) == 1
    what = "1 earlier recording is" if is_one else f"{len(others)} earlier recordings are"
    return f"{what} not included: {_names(others)} (give {'the' if is_one else 'a'} file alone)"


def _names(files: Sequence[Path]) -> str:
    return ", ".join(file.name for file in files[:MOST_NAMED]) + (
        ", …" if len(files) > MOST_NAMED else ""
    )


def session_in(folder: Path) -> tuple[list[Path], list[Path]]:
    """Files of the session in a folder, its earlier starts included; those of other sessions.

    Both in order of recording; both empty where no session was recorded.
    """
    latest = _latest_start(folder)
    starts = _earlier_starts(folder, latest)
    if latest:
        starts.append(latest)
    if not starts:
        return [], []
    first = len(starts) - 1
    while first > 0 and _goes_on(starts[first][0]) and _is_live(starts[first - 1][0]):
        first -= 1
    included = [file for start in starts[first:] for file in start]
    return included, [file for start in starts[:first] for file in start]


def _latest_start(path: Path) -> list[Path]:
    first = path / SESSION_FILE
    parts = [part_of(first, number) for number in range(1, next_part(first))]
    return [file for part in parts for file in (part, results_of(part)) if file.exists()]


def _earlier_starts(folder: Path, latest: Sequence[Path]) -> list[list[Path]]:
    """The files of each start that was set aside, oldest first.

    The dates in their names are those of last changes, which samples that have gone renew: the
    starts' own numbers come first. Where the folder's lock was deleted, these begin again.
    """
    found = [
        _EarlierFile(path, match["date"], int(match["part"] or 1), _metadata(path))
        for path in folder.glob("*.mcap")
        if (match := _EARLIER.fullmatch(path.name))
    ]
    places = [(file.epoch, file.part, RESULTS in file.path.name) for file in found]
    numbered = None not in {file.epoch for file in found} and len(set(places)) == len(places)
    if numbered and latest:
        newest = _EarlierFile(latest[0], "", 1, _metadata(latest[0])).epoch
        numbered = newest is not None and all((file.epoch or 0) < newest for file in found)
    if numbered:
        found.sort(key=lambda file: (file.epoch or 0, file.part, file.date))
    else:
        found.sort(key=lambda file: (file.date, file.part))
    starts: list[list[Path]] = []
    before: _EarlierFile | None = None
    for file in found:
        same = before is not None and before.epoch == file.epoch and before.part <= file.part
        if same and (file.part > 1 or RESULTS in file.path.name):
            starts[-1].append(file.path)
        else:
            starts.append([file.path])
        before = file
    return starts


def _metadata(file: Path) -> Metadata:
    """What is known of a recording before it is read; nothing of one that is damaged there."""
    try:
        return leading_metadata(file)
    except RecordingError:
        return {}


def _is_live(file: Path) -> bool:
    source = _metadata(file).get("pilewatch", {}).get("source", "")
    return bool(source) and not source.startswith(_FROM_FILES)


def _goes_on(file: Path) -> bool:
    """Whether its session went on from what the one before it in the folder had left."""
    return _is_live(file) and FRESH not in _metadata(file).get("run", {})


def session_messages(
    files: Sequence[Path], message_types: Sequence[type] | None = None
) -> Iterator[Message]:
    """Yield what a session recorded, in order of recording, each result once.

    A node that is started again gives its latest results again, and identifies windows again
    that it had not noted yet.

    Parameters
    ----------
    files : sequence of Path
        Of the session; see `session_files`.
    message_types : sequence of type, optional
        Which to give; None: all.

    Raises
    ------
    RecordingError
        On reaching a file, as `read_messages` does.
    """
    once = _Once()
    for file in files:
        for recorded in recorded_messages(file):
            if message_types is None or recorded.message_type in message_types:
                message = decoded(file, recorded)
                if once.is_new(recorded, message):
                    yield message


class _Once:
    """Knows results again that have been given: windows by their identity, others by their bytes.

    Grows with the results, some hundred bytes each.
    """

    def __init__(self) -> None:
        self._known: set[tuple[object, ...]] = set()

    def is_new(self, recorded: RecordedMessage, message: Message) -> bool:
        match message:
            case ModalEstimate():
                key: tuple[object, ...] = ("identified", *_window(message))
            case WindowRejected():
                key = (message.code, *_window(message))
                if message.code == "gap" and ("identified", *key[1:]) in self._known:
                    return False  # its samples were no longer there when a node looked again
            case FoundationPosterior() | FoundationEvent() | StreamGap():
                key = (recorded.key, hash(recorded.payload))
            case _:
                return True
        is_new = key not in self._known
        self._known.add(key)
        return is_new


def _window(answer: ModalEstimate | WindowRejected) -> tuple[object, ...]:
    """Its identity; in older recordings its start. See `same_window`."""
    return answer.turbine, answer.origins or answer.start_ns


def one_recording(path: Path) -> Path:
    """Return the recording that a path stands for: itself, or the only one of a session's folder.

    Of a session that was started again it is that of the latest start; a warning names the others.

    Raises
    ------
    SourceError
        For a folder without recordings, or with several.
    """
    if not path.is_dir():
        return path
    files = _latest_start(path) or session_files(path)
    if len(files) > 1:
        raise SourceError(f"{path} has {len(files)} recordings; name one of {_names(files)}")
    included, others = session_in(path)
    if earlier := [*others, *(file for file in included if file not in files)]:
        logger.warning("%s: %s is used, %s", path, files[0].name, not_included_line(earlier))
    return files[0]


def is_of_session(file: Path) -> bool:
    """Whether a recording has the name of a part of what `pilewatch run` records."""
    return file.name.startswith((f"{Path(SESSION_FILE).stem}.", f"{Path(SESSION_FILE).stem}-"))


def unfinished_files(path: Path) -> list[Path]:
    """Return the parts in a session's folder that are still being written."""
    return sorted(path.glob(f"{Path(SESSION_FILE).stem}*{ACTIVE_SUFFIX}")) if path.is_dir() else []
