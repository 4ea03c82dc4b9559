"""What becomes of a session when the disk takes no more, with the kernel saying so.

A file-size limit (RLIMIT_FSIZE) makes every write beyond it fail, as a full disk does, and needs no
rights and no disk of its own.
"""

import json
import os
import resource
import subprocess
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pipeline.recording.reader import read_messages
from pipeline.recording.rotation import parts_of
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import AccelerationBlock

KILOBYTE = 1000
SAYS_SO = ("recording-stopped", "recording-resumed")
"""The latter where a slow machine leaves time to go on in a next part, which has room again."""


@dataclass(frozen=True, slots=True)
class DiskOutcome:
    """What a session with a full disk left behind."""

    exit_code: int
    published: int  # blocks
    recorded: int  # of them that can be read back
    told_lost: int  # blocks that the session says it could not record
    warned: bool  # whether the summary says that recording stopped, at the end or in between
    same_posterior: bool  # as the session with room


def disk_trial(folder: Path, recording: Path, *, kilobytes: int) -> DiskOutcome:
    """A replay whose files may not exceed a size; and the same with room."""
    options = SessionOptions(out=folder / "room", way="lock-step", rrd=False)
    run_session(replayed(recording), options)
    full = _run(recording, folder / "full", kilobytes * KILOBYTE)
    figures = json.loads((folder / "full" / "summary.json").read_text())
    ours, theirs = (_last_figures(folder / name) for name in ("full", "room"))
    blocks = [
        message
        for path in parts_of(folder / "full" / "session.mcap")
        for message in read_messages(path, (AccelerationBlock,))
    ]
    return DiskOutcome(
        exit_code=full.returncode,
        published=figures["stream"]["published"],
        recorded=len(blocks),
        told_lost=figures["stream"]["published"] - figures["stream"]["recorded"],
        warned=any(doubt["code"] in SAYS_SO for doubt in figures["warnings"]),
        same_posterior=ours == theirs,
    )


def _run(recording: Path, out: Path, limit: int) -> "subprocess.CompletedProcess[str]":
    """A session in threads, its files limited to so many bytes."""
    command = [sys.executable, "-m", "pipeline", "run", "--source", f"replay:{recording}"]
    return subprocess.run(
        [*command, "--out", str(out), "--no-rrd", "--speed", "20"],  # a chunk is closed each second
        preexec_fn=partial(_limit_files, limit),
        env=os.environ | {"PYTHONDONTWRITEBYTECODE": "1"},  # a module cut at the limit stays so
        capture_output=True,
        text=True,
        check=False,
    )


def _limit_files(size: int) -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))


def _last_figures(out: Path) -> object:
    posterior = json.loads((out / "summary.json").read_text())["posterior"]
    return {name: posterior[name] for name in ("k11", "k22", "k12", "windows")}
