"""A session in processes whose parts are killed one after the other, the source's too.

    [unit]  ──► session: [recorder] [identification] [updating] [viewer]
      ▲ kill -9, another takes its place            ▲ kill -9, started again by the session

Beside it the same blocks undisturbed, in lock-step: without those that nobody measured while the
unit was down.
"""

import json
import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Collection, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.messages import FoundationPosterior, StreamGap, WindowRejected
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.rotation import parts_of
from pipeline.recording.writer import Recorder
from pipeline.run.folder import SUMMARY
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.runtime.snapshots import FOLDER, SnapshotFolder, parsed
from pipeline.scenario import Scenario
from pipeline.sources.sources import replayed
from pipeline.transport.zenoh_bus import free_endpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._fuzz_trial import wait_for_nodes

SOURCE = "source"
SENT = "sent.txt"  # numbers of the blocks that the units have published
PATIENCE = 120.0  # for what other processes do [s]


@dataclass(frozen=True, slots=True)
class KillOutcome:
    """What a session with killed parts left behind."""

    kills: tuple[str, ...]  # in order
    published: int  # blocks that the unit would have given, undisturbed
    missing: int  # of them not in the recording
    unheard: int  # of those, blocks that a unit had published before it was killed
    longest_loss: float  # missing in one piece [s of wall time]
    untold: int  # of those in no gap that the session reports
    repeated: int  # blocks that are in the recording more than once
    told_recorded: int  # as the summary says
    windows: int  # with a posterior in the undisturbed session
    rejected: int  # windows without one, for the unit's gaps
    differing: int  # windows whose posterior is not bit-identical, or is missing
    exit_code: int


def kill_trial(
    folder: Path,
    recording: Path,
    *,
    speed: float,
    kills: Sequence[str],
    seed: int,
    rrd: bool = True,
) -> KillOutcome:
    """A live session of what was recorded, its parts killed (SIGKILL) at random moments; and one
    undisturbed."""
    published = list(_blocks([recording]))
    duration = (published[-1].end_ns - published[0].start_ns) / NANOSECONDS / speed
    generator = random.Random(seed)
    out, endpoint, done = folder / "killed", free_endpoint(), list[str]()
    with live_session(recording, out, endpoint, rrd=rrd) as session:
        wait_for_nodes(endpoint, nodes=6 if rrd else 5)
        with Unit(recording, endpoint, speed, folder / SENT, reserve=kills.count(SOURCE)) as unit:
            for number, name in enumerate(kills):
                moment = (number + generator.uniform(0.6, 1.0)) / (len(kills) + 0.5) * duration
                time.sleep(max(0.0, unit.began + moment - time.monotonic()))
                killed = unit.kill_and_replace() if name == SOURCE else kill_node(session.pid, name)
                done += [name] if killed else []
            last = end_of_last_window(published, replayed(recording).scenario)
            assert wait_until(lambda: last_answer(out, published[0].turbine) >= last)
        session.send_signal(signal.SIGTERM)
        exit_code = session.wait(PATIENCE)
    return _outcome(folder, recording, done, speed, exit_code)


def _outcome(
    folder: Path, recording: Path, done: Sequence[str], speed: float, exit_code: int
) -> KillOutcome:
    published = [block.sequence for block in _blocks([recording])]
    parts = parts_of(folder / "killed" / "session.mcap")
    recorded = [block.sequence for block in _blocks(parts)]
    missing = sorted(set(published) - set(recorded))
    run_session(
        replayed(without(recording, missing, folder / "measured.mcap")),
        SessionOptions(out=folder / "whole", way="lock-step", rrd=False),
    )
    ours, theirs = (_posteriors(folder / name) for name in ("killed", "whole"))
    sent = {int(line) for line in (folder / SENT).read_text().split()}
    return KillOutcome(
        kills=tuple(done),
        published=len(published),
        missing=len(missing),
        unheard=len(sent & set(missing)),
        longest_loss=longest_run(missing) / speed,
        untold=len(set(missing) - told_missing(parts)),
        repeated=len(recorded) - len(set(recorded)),
        told_recorded=json.loads((folder / "killed" / SUMMARY).read_text())["stream"]["recorded"],
        windows=len(theirs),
        rejected=len(_rejected_for_gaps(folder / "whole")),
        differing=len(ours.keys() ^ theirs.keys())
        + sum(
            not np.array_equal(ours[end].draws, theirs[end].draws)
            for end in ours.keys() & theirs.keys()
        ),
        exit_code=exit_code,
    )


def without(recording: Path, missing: Collection[int], path: Path) -> Path:
    """The recording but for some of its blocks."""
    recorder = Recorder(path, metadata=read_metadata(recording), clock=None)
    for message in read_messages(recording):
        if not (isinstance(message, AccelerationBlock) and message.sequence in missing):
            recorder.handle(message)
    recorder.close()
    return path


def told_missing(parts: Sequence[Path]) -> set[int]:
    """Numbers of the blocks that the recorded gaps count."""
    gaps = [gap for part in parts for gap in read_messages(part, (StreamGap,))]
    return {
        gap.first_sequence + number
        for gap in gaps
        if isinstance(gap, StreamGap)
        for number in range(gap.n_blocks)
    }


def longest_run(sequences: Sequence[int]) -> int:
    """The most numbers that follow each other."""
    longest = run = 0
    before = None
    for number in sequences:
        run = run + 1 if before is not None and number == before + 1 else 1
        longest, before = max(longest, run), number
    return longest


def end_of_last_window(published: Sequence[AccelerationBlock], scenario: Scenario) -> int:
    """When the last whole window of undisturbed blocks ends [ns]."""
    first_ns, settings = published[0].start_ns, scenario.oma
    length = (published[-1].end_ns - first_ns) / NANOSECONDS - settings.window_duration
    hops = int(length / settings.hop + 1e-6)
    return first_ns + round((settings.window_duration + hops * settings.hop) * NANOSECONDS)


@contextmanager
def live_session(
    recording: Path, out: Path, endpoint: str, *, rrd: bool
) -> Iterator["subprocess.Popen[bytes]"]:
    """`pilewatch run --source live --processes` under the recording's scenario; what it says goes
    to a file beside `out`."""
    scenario = out.with_suffix(".toml")
    scenario.write_text(replayed(recording).scenario.text)
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--processes"]
    command += ["--scenario", str(scenario), "--listen", endpoint, "--out", str(out)]
    with out.with_suffix(".log").open("wb") as log:
        session = subprocess.Popen(
            command + ([] if rrd else ["--no-rrd"]), stdout=subprocess.DEVNULL, stderr=log
        )
        try:
            yield session
        finally:
            session.kill()
            session.wait()


class Unit:
    """The acquisition unit's process, and others in reserve that have come up and only wait: how
    long Python takes to start is no matter of the pipeline's."""

    def __init__(
        self, recording: Path, endpoint: str, speed: float, log: Path, *, reserve: int
    ) -> None:
        arguments = [str(recording), endpoint, repr(speed), str(log)]
        command = [sys.executable, "-m", "tests.benchmarks._unit", *arguments]
        self._processes = [
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
            for _ in range(1 + reserve)
        ]
        for process in self._processes:
            _said(process)  # it is up
        self.began = self._begin("")

    def _begin(self, moment: str) -> float:
        """Let the first one that is left begin; gives when the measuring began [s]."""
        process = self._processes[0]
        assert process.stdin is not None
        process.stdin.write(f"{moment}\n")
        process.stdin.flush()
        return float(_said(process))

    def __enter__(self) -> "Unit":
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()

    def kill_and_replace(self) -> bool:
        """Kill it and let one in reserve go on."""
        killed = self._processes.pop(0)
        killed.kill()
        killed.wait()
        self._begin(repr(self.began))
        return True


def _said(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    return process.stdout.readline()


def kill_node(parent: int, name: str) -> bool:
    """Kill the child of a session that runs this node, as soon as it is up."""

    def killed() -> bool:
        for pid in _children(parent):
            words = Path(f"/proc/{pid}/cmdline").read_bytes().split(b"\0")
            if b"node" in words and words[words.index(b"node") + 1] == name.encode():
                os.kill(pid, signal.SIGKILL)
                return True
        return False

    return wait_until(killed)


def _children(parent: int) -> list[int]:
    found: list[int] = []
    for task in Path(f"/proc/{parent}/task").iterdir():
        found += [int(pid) for pid in (task / "children").read_text().split()]
    return found


def wait_until(condition: Callable[[], bool]) -> bool:
    """Whether it becomes so in time."""
    deadline = time.monotonic() + PATIENCE
    while not (so := condition()) and time.monotonic() < deadline:
        time.sleep(0.2)
    return so


def last_answer(out: Path, turbine: str) -> int:
    """End of the last window that the updating has answered, by its snapshot [ns]."""
    path = SnapshotFolder(out / FOLDER).file_of(turbine)
    if not path.exists():
        return 0
    kept = parsed(path.read_bytes(), turbine, str(path)).messages
    posteriors = [each.time_ns for each in kept if isinstance(each, FoundationPosterior)]
    rejections = [each.end_ns for each in kept if isinstance(each, WindowRejected)]
    return max(posteriors + rejections, default=0)


def _blocks(paths: Sequence[Path]) -> Iterator[AccelerationBlock]:
    for path in paths:
        for message in read_messages(path, (AccelerationBlock,)):
            assert isinstance(message, AccelerationBlock)
            yield message


def _posteriors(out: Path) -> dict[int, FoundationPosterior]:
    """By time; of several with one time the last."""
    return {
        message.time_ns: message
        for path in parts_of(out / "session.mcap")
        for message in read_messages(path, (FoundationPosterior,))
        if isinstance(message, FoundationPosterior)
    }


def _rejected_for_gaps(out: Path) -> set[int]:
    return {
        message.end_ns
        for path in parts_of(out / "session.mcap")
        for message in read_messages(path, (WindowRejected,))
        if isinstance(message, WindowRejected) and message.code == "gap"
    }
