"""Two runs are started on one folder at random moments, some are killed: who writes where?

python -m tests.benchmarks double_starts [--trials N] [--seed S] [--write]

    first   |────── owns ──────|          killed in every third trial
    second        |refused|     or  |── owns ──|
    third                              |── owns ──|    after both

Each run is a process of its own that replays two short windows, whose modes stand for themselves:
what is asked is who writes. An audit hook of its interpreter
keeps every file that it opens for writing, renames or removes in the folder, with the time. A write
is foreign where its run does not own the folder: it was refused, or another one writes before and
after it.
"""

import argparse
import json
import os
import random
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pipeline.offline.audit import audit
from pipeline.recording.reader import read_messages
from pipeline.recording.writer import whole_recording
from pipeline.run.options import SessionOptions
from pipeline.run.ownership import LOCK
from pipeline.run.run import run_session
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from tests.benchmarks._results import keep
from tests.pipeline.histories import identify_by_digests

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"
SCENARIO = """
title = "Two short windows"
seed = 1
[turbine]
id = "iea15mw"
description = "none"
[oma]
window_duration = 60.0
hop = 60.0
"""
BLOCKS = 140  # of a second each
LATEST = 0.4  # after the first run, that the second is started [s]
REFUSED = 2  # exit code of a run that may not start


@dataclass(frozen=True, slots=True)
class Run:
    """What one process did."""

    exit_code: int
    """Negative: the signal that ended it."""
    writes: tuple[float, ...]
    """When it wrote into the folder, by the machine's monotonic clock [s]."""

    @property
    def refused(self) -> bool:
        """Whether it was not allowed to start."""
        return self.exit_code == REFUSED


def main(arguments: list[str]) -> None:
    """Run the trials and print what they found."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks double_starts")
    parser.add_argument("--trials", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory() as name:
        figures = trials(Path(name), range(chosen.seed, chosen.seed + chosen.trials))
    print(json.dumps(figures, indent=1))
    if chosen.write:
        keep(
            "double-starts",
            figures,
            command=f"python -m tests.benchmarks double_starts --trials {chosen.trials} "
            f"--seed {chosen.seed} --write",
            seeds=(chosen.seed, chosen.seed + chosen.trials - 1),
            depends=["pipeline/run", "pipeline/recording"],
        )


def trials(folder: Path, seeds: Sequence[int]) -> dict[str, Any]:
    """What all trials found together."""
    source = short_recording(folder / "short.mcap")
    counts = dict.fromkeys(("refused", "killed", "foreign writes", "books that do not balance"), 0)
    for seed in seeds:
        out = folder / str(seed)
        out.mkdir()
        runs = trial(source, out, seed)
        counts["refused"] += sum(run.refused for run in runs)
        counts["killed"] += sum(run.exit_code < 0 for run in runs)
        counts["foreign writes"] += foreign_writes(runs)
        counts["books that do not balance"] += bool(audit(out).violations)
    return {"trials": len(seeds), **counts}


def short_recording(path: Path) -> Path:
    """The first windows of the shipped recording, identified without a structure."""
    scenario = {"name": "short", "seed": "1", "duration": f"{BLOCKS}", "toml": SCENARIO}
    with whole_recording(path, metadata={"scenario": scenario}) as recorder:
        for message in read_messages(RECORDING):
            if isinstance(message, AccelerationBlock) and message.sequence >= BLOCKS:
                break
            recorder.handle(message)
    return path


def trial(source: Path, out: Path, seed: int) -> list[Run]:
    """Three runs on one folder, the second started while the first may still run."""
    moments = random.Random(seed)
    first = started(source, out)
    time.sleep(moments.uniform(0.0, LATEST))
    if seed % 3 == 0:
        os.kill(first[0], signal.SIGKILL)
    second = started(source, out)
    runs = [ended(each) for each in (first, second)]
    return [*runs, ended(started(source, out))]


def started(source: Path, out: Path) -> tuple[int, int]:
    """Process of a run, and where it writes what it did."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        os.close(reading)
        os._exit(_run(source, out, writing))
    os.close(writing)
    return child, reading


def _run(source: Path, out: Path, log: int) -> int:
    def note(event: str, arguments: tuple[Any, ...]) -> None:
        if event == "open":
            changes = bool(arguments[2] & (os.O_WRONLY | os.O_RDWR | os.O_CREAT))
        else:
            changes = event in ("os.rename", "os.remove", "os.truncate", "os.mkdir")
        path = arguments[0] if changes else None
        place = Path(path) if isinstance(path, str | os.PathLike) else out
        if place.is_relative_to(out) and place not in (out, out / LOCK):
            os.write(log, f"{time.monotonic()}\n".encode())

    identify_by_digests(setattr)
    sys.addaudithook(note)
    try:
        run_session(replayed(source), SessionOptions(out=out, way="lock-step", rrd=False))
    except InputError:
        return REFUSED
    return 0


def ended(process: tuple[int, int]) -> Run:
    """What a process did, once it has ended."""
    child, reading = process
    with os.fdopen(reading) as log:
        writes = tuple(float(line) for line in log)
    _, status = os.waitpid(child, 0)
    return Run(os.waitstatus_to_exitcode(status), writes)


def foreign_writes(runs: Sequence[Run]) -> int:
    """Writes of runs that were refused, and those between the first and last of another's."""
    count = 0
    for run in runs:
        others = [other for other in runs if other is not run and not other.refused]
        for time_s in run.writes:
            inside = [o for o in others if o.writes and o.writes[0] < time_s < o.writes[-1]]
            count += run.refused or bool(inside)
    return count
