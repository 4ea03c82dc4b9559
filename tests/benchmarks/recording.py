"""How fast recordings are written and read, and how large an hour is.

python -m tests.benchmarks recording [--minutes N] [--turbines N] [--write]

One tower, eight channels at 40 Hz, noise in steps of 2⁻¹⁴ m/s²; a block a second. Then a session's
recorder, with all that it does beside writing (what was recorded before, room on the disk, parts,
fsync), fed with the blocks of many turbines: how long each takes, and which share of a core they
all take in real time.
"""

import argparse
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.recording.info import recording_info
from pipeline.recording.reader import read_messages
from pipeline.recording.salvage import salvage
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.writer import Recorder, RecorderSettings
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.arrays import FloatArray
from tests.benchmarks._results import keep

ADC_STEP = 2.0**-14  # [m/s²]
START_NS = 1_700_000_000 * NANOSECONDS


def main(arguments: list[str]) -> None:
    """Print one row for each age at which a chunk is closed."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks recording")
    parser.add_argument("--minutes", type=int, default=60)
    parser.add_argument("--turbines", type=int, default=200)
    parser.add_argument("--write", action="store_true")
    options = parser.parse_args(arguments)
    blocks = made_up_blocks(60 * options.minutes)
    mb_a_day = {}  # by the age at which a chunk is closed; a live run's is a second
    print("chunk [s]   MB an hour   written   read   info   salvaged   [blocks a CPU second]")
    with tempfile.TemporaryDirectory() as folder:
        for chunk_duration in (1.0, 10.0, 60.0, 600.0):
            path = Path(folder) / f"{chunk_duration:g}.mcap"
            written = speed(blocks, lambda p=path, c=chunk_duration: record(blocks, p, c))
            read = speed(blocks, lambda p=path: list(read_messages(p)))
            info = speed(blocks, lambda p=path: recording_info(p))
            whole = path.read_bytes()
            path.write_bytes(whole[:-100])
            salvaged = speed(blocks, lambda p=path: salvage(p, p.with_suffix(".salvaged")))
            size = len(whole) * 60 / options.minutes * 1e-6
            mb_a_day[f"chunk of {chunk_duration:g} s"] = round(24 * size)
            print(
                f"{chunk_duration:9g}   {size:10.2f}   {written:7.0f}  {read:6.0f} "
                f"{info:6.0f} {salvaged:8.0f}"
            )
        print(told(session_recorder(Path(folder), blocks, options.turbines)))
    if options.write:
        command = f"python -m tests.benchmarks recording --minutes {options.minutes} --write"
        keep("recording", {"mb_a_day": mb_a_day}, command=command, depends=("pipeline/recording",))


@dataclass(frozen=True, slots=True)
class SessionCost:
    """What a session's recorder takes for the blocks of some turbines."""

    turbines: int
    n_blocks: int
    wall: float  # [s]
    cpu: float  # [s]
    times_ms: FloatArray  # of each block, wall [ms]


def session_recorder(
    folder: Path, blocks: Sequence[AccelerationBlock], turbines: int
) -> SessionCost:
    """As many blocks as are given, second by second, a turbine after the other."""
    n_seconds = -(-len(blocks) // turbines)
    sent = [
        replace(blocks[(second * turbines + turbine) % len(blocks)], **names(turbine, second))
        for second in range(n_seconds)
        for turbine in range(turbines)
    ]
    recorder = SessionRecorder(folder / "session.mcap", metadata={}, clock=time.time_ns)
    times = np.empty(len(sent))
    started, cpu = time.perf_counter(), time.process_time()
    for number, block in enumerate(sent):
        before = time.perf_counter()
        recorder.handle(block)
        times[number] = time.perf_counter() - before
    recorder.close()
    wall, cpu = time.perf_counter() - started, time.process_time() - cpu
    return SessionCost(turbines, len(sent), wall, cpu, 1e3 * times)


def names(turbine: int, second: int) -> dict[str, Any]:
    """What makes a block that of a turbine's second."""
    start_ns = START_NS + second * NANOSECONDS
    place = {"sequence": second, "first_sample": 40 * second, "start_ns": start_ns}
    return {"turbine": f"t{turbine:03d}", **place}


def told(cost: SessionCost) -> str:
    """The cost in a line."""
    p50, p99 = np.percentile(cost.times_ms, [50, 99])
    share = cost.cpu / cost.n_blocks * cost.turbines
    return (
        f"session's recorder, {cost.turbines} turbines: {cost.n_blocks / cost.wall:.0f} blocks/s; "
        f"a block p50 {p50:.2f} ms, p99 {p99:.2f} ms, longest {cost.times_ms.max():.1f} ms; "
        f"CPU {cost.cpu / cost.wall:.0%} while writing, {share:.1%} of a core in real time"
    )


def made_up_blocks(count: int) -> list[AccelerationBlock]:
    """Noise of 70 mm/s² rms, quantised."""
    generator = np.random.default_rng(1)
    return [
        AccelerationBlock(
            *("t1", "tower", "session", "layout"),
            sequence=sequence,
            first_sample=40 * sequence,
            start_ns=START_NS + sequence * NANOSECONDS,
            sampling_rate=40.0,
            samples=(
                np.round(generator.normal(scale=0.07, size=(40, 8)) / ADC_STEP) * ADC_STEP
            ).astype(np.float32),
        )
        for sequence in range(count)
    ]


def record(blocks: list[AccelerationBlock], path: Path, chunk_duration: float) -> None:
    """Write the blocks to a file whose chunks are closed at this age [s]."""
    settings = RecorderSettings(chunk_duration=chunk_duration, chunk_bytes=2**24)
    recorder = Recorder(path, metadata={}, clock=None, settings=settings)
    for block in blocks:
        recorder.handle(block)
    recorder.close()


def speed(blocks: list[AccelerationBlock], work: Callable[[], object]) -> float:
    """Blocks that are dealt with in a CPU second."""
    started = time.process_time()
    work()
    return len(blocks) / (time.process_time() - started)
