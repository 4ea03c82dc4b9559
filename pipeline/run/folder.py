"""A session's files; those of an earlier one are set aside under their date, never overwritten."""

import json
import logging
from datetime import UTC, datetime
from pathlib import Path

from pipeline.recording.rotation import SESSION_FILE, close_leftovers
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.runtime.snapshots import ANSWERS
from pipeline.runtime.snapshots import FOLDER as CHECKPOINTS
from pipeline.sources.sources import Source
from sensors.atomic_write import make_folder_durably, written_whole
from sensors.errors import InputError
from sensors.json_values import Json

logger = logging.getLogger(__name__)

RECORDING, PICTURES, SUMMARY = SESSION_FILE, "session.rrd", "summary.json"


def make_folder(out: Path) -> None:
    """Raises InputError where it cannot be made."""
    try:
        make_folder_durably(out)
    except OSError as error:
        raise InputError(f"--out {out}: {error.strerror}; a folder is needed") from error


def prepare_folder(source: Source, out: Path) -> Source:
    """Make the folder and set an earlier session's files in it aside, under their date.

    Parameters
    ----------
    source : Source
        What the session reads.
    out : Path
        The folder.

    Returns
    -------
    Source
        The source, which may be one of the files set aside.

    Raises
    ------
    InputError
        If the folder cannot be made.
    """
    make_folder(out)
    for whole in close_leftovers(out / RECORDING):
        logger.warning("%s was left unfinished; it ends with its last whole chunk now", whole)
    parts = sorted({*out.glob("session.part*.mcap"), *out.glob("session.*results.mcap")})
    for path in (
        out / RECORDING,
        *parts,
        out / f"{RECORDING}{ACTIVE_SUFFIX}",
        out / PICTURES,
        out / SUMMARY,
    ):
        if path.exists():
            moved = set_aside(path)
            logger.info("%s of an earlier session is now %s", path, moved)
            if source.recording is not None and source.recording.resolve() == path.resolve():
                source = source.with_recording(moved)
    return source


def set_checkpoints_aside(out: Path) -> None:
    """Let the updating begin with nothing seen; an earlier session's state is kept."""
    if (out / CHECKPOINTS).exists():
        logger.info("the updating's state is now %s", set_aside(out / CHECKPOINTS))


def set_tracks_aside(out: Path) -> None:
    """Let an identification by itself begin with nothing seen."""
    if (out / ANSWERS).exists():
        logger.info("the identification's answers are now %s", set_aside(out / ANSWERS))


def set_aside(path: Path) -> Path:
    """Rename a file to its name with the time of its last change; gives the new path."""
    changed = datetime.fromtimestamp(path.stat().st_mtime, UTC)
    stem, dot, suffixes = path.name.partition(".")
    for number in range(1, 1000):
        again = "" if number == 1 else f"-{number}"
        moved = path.with_name(f"{stem}-{changed:%Y%m%dT%H%M%SZ}{again}{dot}{suffixes}")
        if not moved.exists():
            path.rename(moved)
            return moved
    raise InputError(f"{path}: a thousand earlier sessions of that second; clear the folder")


def write_summary(path: Path, figures: Json) -> bool:
    """Whether it could be written; a failure is reported, and costs neither the results of the
    session nor the reason for which it may have ended."""
    text = json.dumps(figures, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        written_whole(path, text.encode())
    except OSError as error:
        logger.error("cannot write %s: %s", path, error.strerror)
        return False
    return True
