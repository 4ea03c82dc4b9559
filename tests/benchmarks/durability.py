"""What it costs that nothing is lost, and what a day without a link and power cuts lose.

python -m tests.benchmarks durability [--seconds S] [--rounds N] [--write]

    unit's publish    CPU in real time, against a recorder, with a spool and without, in turns
    main job          CPU of a run, with what syncing, acknowledging and the books take of it
    a day             24 hours without a link (in counted time), power cut on both sides
"""

import argparse
import json
import os
import resource
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.recording import session_recorder
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import replayed
from pipeline.state.books import Books
from pipeline.transport.zenoh_settings import free_endpoint
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._results import keep
from tests.pipeline.example_messages import START_NS, block
from tests.pipeline.power_cut import power_cut
from tests.pipeline.sources.test_durable_publisher import Trial

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"
STARTED = 8.0  # a run is ready after that time [s]


def main(arguments: list[str]) -> None:
    """Measure all three and print them."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks durability")
    parser.add_argument("--seconds", type=int, default=60)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    figures: dict[str, Any] = {"unit": unit_cost(chosen.seconds, chosen.rounds)}
    figures |= {"main job": main_job_cost(chosen.seconds), "a day": day_without_link()}
    print(json.dumps(figures, indent=1))
    if chosen.write:
        keep(
            "durability",
            figures,
            command=f"python -m tests.benchmarks durability --seconds {chosen.seconds} "
            f"--rounds {chosen.rounds} --write",
            depends=["pipeline/sources", "pipeline/recording", "pipeline/state"],
        )


def unit_cost(seconds: int, rounds: int) -> dict[str, float]:
    """CPU of `pilewatch publish` in real time with a spool and without [ms a second]."""
    spent: dict[str, list[float]] = {"--keep": [], "--no-keep": []}
    for turn in range(rounds):
        for kept in sorted(spent, reverse=bool(turn % 2)):
            spent[kept].append(_unit_cpu(seconds, kept))
    with_spool, without = np.array(spent["--keep"]), np.array(spent["--no-keep"])
    return {
        "with [ms/s]": float(np.median(with_spool)),
        "without [ms/s]": float(np.median(without)),
        "ratio": float(np.median(with_spool / without)),
    }


def _unit_cpu(seconds: int, kept: str) -> float:
    """CPU [ms a second], against a shore that has no block yet: what one has before it is sent is
    not kept."""
    with tempfile.TemporaryDirectory() as folder, shore(Path(folder)) as endpoint:
        command = [sys.executable, "-m", "tests.benchmarks._unit_cpu", str(seconds)]
        command += ["publish", "--source", f"replay:{RECORDING}", "--connect", endpoint, kept]
        answer = subprocess.run(
            command,
            env=os.environ | {"STATE_DIRECTORY": folder},
            capture_output=True,
            text=True,
            check=True,
        )
        return float(answer.stdout.split()[-1])


@contextmanager
def shore(folder: Path) -> Iterator[str]:
    """A live run that records; gives where it listens."""
    endpoint = free_endpoint()
    command = [sys.executable, "-m", "pipeline", "run", "--source", "live", "--no-rrd"]
    process = subprocess.Popen(
        [*command, "--out", str(folder / "out"), "--listen", endpoint],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    time.sleep(STARTED)
    try:
        yield endpoint
    finally:
        process.send_signal(signal.SIGTERM)
        process.wait(60)


def main_job_cost(seconds: int) -> dict[str, float]:
    """CPU of a run at speed and in real time, and what of it syncs, acknowledges, keeps books."""
    blocks = [block(number) for number in range(600)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        at_speed, pace = _run_cost(folder / "at-speed", float("inf"), None)
        live, _ = _run_cost(folder / "live", 1.0, seconds)
        ways = [(every, each) for each in (1.0, pace) for every in (1.0, float("inf"))]
        turns = [[_recorder_cost(folder, blocks, *way) for way in ways] for _ in range(11)]
        costs = np.min(turns, axis=0).tolist()
        synced, synced_at_speed = costs[0] - costs[1], costs[2] - costs[3]
    before = resource.getrusage(resource.RUSAGE_SELF)
    books = Books()
    for each in blocks:
        books.handle(each)
    kept = 2 * _cpu_since(before) / len(blocks)  # by the status and by the summary
    return {
        "job at speed [ms/block]": 1e3 * at_speed,
        "job in real time [ms/block]": 1e3 * live,
        "blocks a second at speed": 1 / pace,
        "sync and acknowledge at speed [ms/block]": 1e3 * synced_at_speed,
        "sync and acknowledge in real time [ms/block]": 1e3 * synced,
        "books [ms/block]": 1e3 * kept,
        "ratio at speed": at_speed / (at_speed - synced_at_speed - kept),
        "ratio in real time": live / (live - synced - kept),
    }


def _run_cost(out: Path, speed: float, seconds: int | None) -> tuple[float, float]:
    """CPU of a run and its wall time, each a block [s]; seconds: after which it is ended."""
    stopping = threading.Event()
    if seconds is not None:
        threading.Timer(seconds, stopping.set).start()
    before = resource.getrusage(resource.RUSAGE_SELF)
    options = SessionOptions(out=out, rrd=False, speed=speed)
    started = time.monotonic()
    done = run_session(replayed(RECORDING), options, stopping=stopping)
    blocks = done.summary.run.published
    return _cpu_since(before) / blocks, (time.monotonic() - started) / blocks


def _recorder_cost(
    folder: Path, blocks: list[AccelerationBlock], sync_every: float, pace: float
) -> float:
    """CPU of a recorder a block [s]; pace: wall time from one to the next [s]."""
    now_ns = [START_NS]
    session_recorder.SYNCED_EVERY = sync_every
    path = Path(tempfile.mkdtemp(dir=folder)) / "session.mcap"
    recorder = SessionRecorder(path, metadata={}, clock=lambda: now_ns[0])
    before = resource.getrusage(resource.RUSAGE_SELF)
    for each in blocks:
        recorder.handle(each)
        now_ns[0] += round(pace * NANOSECONDS)
    spent = _cpu_since(before) / len(blocks)
    recorder.close()
    session_recorder.SYNCED_EVERY = 1.0
    return spent


def _cpu_since(before: resource.struct_rusage) -> float:
    now = resource.getrusage(resource.RUSAGE_SELF)
    return now.ru_utime + now.ru_stime - before.ru_utime - before.ru_stime


def day_without_link(hours: float = 24.0) -> dict[str, float]:
    """Blocks lost of a day without a link that ends with a power cut on both sides."""
    seconds = 3600.0 * hours
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        trial = Trial(folder)
        with power_cut(folder) as disk:
            trial.run(20.0)
            trial.link.is_up = False
            trial.run(seconds, speed=40)
            trial.run(5.0)
            trial.cut_power_everywhere(disk)
            trial.link.is_up = True
            trial.run(seconds / 8, speed=8)
            trial.run(30.0)
        missing = set(trial.published) - trial.recorded()
        late = {n for n, when in trial.published.items() if trial.now - when < 2.0}
        return {
            "published": len(trial.published),
            "acknowledged and lost": len(trial.link.acknowledged & missing),
            "unacknowledged and lost [blocks of 1 s]": len(missing - late),
        }
