"""Files that are there as a whole or not at all."""

import os
import secrets
from contextlib import suppress
from pathlib import Path


def written_whole(path: Path, content: bytes) -> None:
    """Write a file that is never seen half written, not even after a power cut.

    Raises OSError, with the file's name, where the disk refuses; what was there before is then
    still there.
    """
    part = path.with_name(f".{secrets.token_hex(6)}.part")
    try:
        with part.open("xb") as file:  # may be read by whom the umask lets
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
        sync_folder(path.parent)
    except OSError as error:  # of writing, it names no file; of opening, the temporary one
        raise OSError(error.errno, error.strerror, str(path)) from error
    finally:
        with suppress(OSError):
            part.unlink(missing_ok=True)


def require_writable(folder: Path) -> None:
    """Make an empty file in a folder and remove it: before long work, not after it.

    Raises OSError where that cannot be: permissions alone do not say it.
    """
    trial = folder / f".{secrets.token_hex(6)}.part"
    trial.open("xb").close()
    trial.unlink()


def sync_folder(folder: Path) -> None:
    """Have the names in a folder survive a power cut. Raises OSError where the disk refuses."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


def make_folder_durably(folder: Path) -> None:
    """Make a folder, and those above it, that survive a power cut. Raises OSError."""
    missing = [each for each in (folder, *folder.parents) if not each.exists()]
    folder.mkdir(parents=True, exist_ok=True)
    for each in missing:
        sync_folder(each.parent)
