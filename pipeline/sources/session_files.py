"""Which files a recorded session consists of, and what they hold."""

import logging
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    FoundationTruth,
    Message,
    ModalEstimate,
    StreamGap,
    WindowRejected,
)
from pipeline.recording.mcap_file import RecordedMessage
from pipeline.recording.reader import decoded, recorded_messages
from pipeline.recording.rotation import SESSION_FILE, latest_start, session_in
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.sources.recorded_stream import SourceError, recordings_in

logger = logging.getLogger(__name__)

MOST_NAMED = 5  # files that a line names


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
    if others := earlier_sessions(path):
        logger.warning("%s: %s", path, not_included_line(others))
    return files_to_read(path)


def files_to_read(path: Path) -> list[Path]:
    """Return what `session_files` does, without a word on files of other sessions."""
    if not path.is_dir():
        return [path]
    return session_in(path)[0] or recordings_in(path)


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
    wanted = None if message_types is None else frozenset(message_types)
    for file in files:
        for recorded in recorded_messages(file):
            if wanted is not None and recorded.message_type not in wanted:
                continue
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
            case FoundationPosterior() | FoundationEvent() | FoundationTruth() | StreamGap():
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
    files = latest_start(path) or files_to_read(path)
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
