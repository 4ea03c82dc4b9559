"""One run owns a folder: a second one is refused, one that was killed is followed.

    out/lock    {"epoch": 3, "process": 4711, "host": "shore", "started": "2026-…", "what": "run"}

The lock is the system's own on the open file: it goes with the last process that holds it, whatever
ended that. Node processes of a run inherit it, so that what a killed run left behind has ended
before the next one begins. The epoch grows with each owner; recordings and snapshots carry it, and
a snapshot of a later epoch is not replaced.
"""

import fcntl
import json
import os
import socket
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from sensors.errors import InputError

LOCK = "lock"  # inside a session's folder
ENDING_PATIENCE = 20.0  # for the processes of a run that was killed to end [s]
PAUSE = 0.1  # between two tries [s]


@dataclass(frozen=True, slots=True)
class Ownership:
    """A folder that this process owns."""

    epoch: int
    """Number of its owners so far, this one included."""
    descriptor: int
    """Of the open lock, which processes that write for this one inherit."""


@contextmanager
def owned(
    out: Path, what: str = "run", *, fresh: bool = False, patience: float = ENDING_PATIENCE
) -> Iterator[Ownership]:
    """Own a folder for as long as the context lasts.

    Parameters
    ----------
    out : Path
        The folder, which exists.
    what : str
        The command that owns it, for people; "node recorder" owns that node's files alone.
    fresh : bool
        Whether it goes on from nothing of what the owners before it left.
    patience : float
        How long processes of an owner that is gone are waited for [s].

    Raises
    ------
    InputError
        If another process owns it; the message names that one.
    """
    path = out / (LOCK if what == "run" else f"{LOCK}-{what.replace(' ', '-').replace('/', '-')}")
    try:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
    except OSError as error:
        raise InputError(f"--out {out}: {path.name} cannot be made: {error.strerror}") from error
    try:
        _lock(descriptor, out, patience)
        epoch = _epoch(_content(descriptor)) + 1
        owner = {
            "epoch": epoch,
            "process": os.getpid(),
            "host": socket.gethostname(),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
            "what": what,
        } | ({"fresh": True} if fresh else {})
        os.ftruncate(descriptor, 0)
        os.pwrite(descriptor, json.dumps(owner).encode() + b"\n", 0)
        os.fsync(descriptor)
        yield Ownership(epoch, descriptor)
    finally:
        os.close(descriptor)


def epoch_of(out: Path) -> int:
    """Return the epoch of the run that owns a folder, for node processes of it; 0 without one."""
    try:
        content = json.loads((out / LOCK).read_text())
        return int(content["epoch"])
    except (OSError, ValueError, KeyError, TypeError):
        return 0


def is_fresh(out: Path) -> bool:
    """Whether the run that owns a folder began with --fresh, for node processes of it."""
    try:
        return bool(json.loads((out / LOCK).read_text()).get("fresh"))
    except (OSError, ValueError, AttributeError):
        return False


def _lock(descriptor: int, out: Path, patience: float) -> None:
    deadline = time.monotonic() + patience
    while True:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            return
        except OSError:
            owner = _content(descriptor)
        if _is_alive(owner) or time.monotonic() > deadline:
            raise InputError(
                f"--out {out} belongs to `pilewatch {owner.get('what', 'run')}`, process "
                f"{owner.get('process', '?')} on {owner.get('host', '?')} since "
                f"{owner.get('started', '?')}; stop that one or choose another folder"
            ) from None
        time.sleep(PAUSE)


def _is_alive(owner: dict[str, object]) -> bool:
    """Whether the process that took the lock runs; True on another machine, where that is not
    known."""
    process = owner.get("process")
    if not isinstance(process, int) or owner.get("host") != socket.gethostname():
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except PermissionError:
        return True
    return True


def _epoch(owner: dict[str, object]) -> int:
    epoch = owner.get("epoch", 0)
    return epoch if isinstance(epoch, int) else 0


def _content(descriptor: int) -> dict[str, object]:
    try:
        content = json.loads(os.pread(descriptor, 4096, 0) or b"{}")
    except ValueError:
        return {}
    return content if isinstance(content, dict) else {}
