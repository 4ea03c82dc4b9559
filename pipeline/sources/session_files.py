"""Which files a recorded session consists of."""

from pathlib import Path

from pipeline.recording.rotation import next_part, part_of, results_of
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.sources.recorded_stream import SourceError, recordings_in

SESSION_FILE = "session.mcap"  # the first part of what `pilewatch run` records


def session_files(path: Path) -> list[Path]:
    """Return the closed parts of a session in order of recording, results where samples have gone.

    Parameters
    ----------
    path : Path
        A file, which is then the only one; a folder: of the session in it, or, where there is
        none, every recording in it.

    Raises
    ------
    SourceError
        For a folder without recordings.
    """
    if not path.is_dir():
        return [path]
    first = path / SESSION_FILE
    parts = [part_of(first, number) for number in range(1, next_part(first))]
    found = [file for part in parts for file in (part, results_of(part)) if file.exists()]
    return found or recordings_in(path)


def one_recording(path: Path) -> Path:
    """Return the recording that a path stands for: itself, or the only one of a session's folder.

    Raises
    ------
    SourceError
        For a folder without recordings, or with several.
    """
    files = session_files(path)
    if len(files) > 1:
        names = ", ".join(file.name for file in files[:5]) + (", …" if len(files) > 5 else "")
        raise SourceError(f"{path} has {len(files)} recordings; name one of {names}")
    return files[0]


def unfinished_files(path: Path) -> list[Path]:
    """Return the parts in a session's folder that are still being written."""
    return sorted(path.glob(f"{Path(SESSION_FILE).stem}*{ACTIVE_SUFFIX}")) if path.is_dir() else []
