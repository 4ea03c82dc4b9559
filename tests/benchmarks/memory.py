"""Does what a run keeps in memory grow with time?

python -m tests.benchmarks memory [--hours H] [--write]

    blocks, estimates and posteriors of 4 turbines, in counted time
                               ──► one node in a process of its own
    memory after every ten minutes of measurements; a line through it after half

Reported per hour of a run at 10 ×: ten hours of measurements. Modes and posteriors stand for
themselves (their work is bounded by a window): what is asked is what nodes keep between messages.
"""

import argparse
import gc
import json
import os
import resource
import tempfile
import tracemalloc
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.messages import Message, ModalEstimate, UnitOrigin
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.updating import TurbineUpdating
from pipeline.oma.settings import OmaSettings
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.settings import RecordingSettings
from pipeline.state.run_state import RunState
from pipeline.updating.updater import FoundationUpdater
from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from tests.benchmarks._results import is_old, keep, kept
from tests.pipeline.histories import identify_by_digests
from tests.pipeline.state.test_posterior_json import POSTERIOR
from tests.pipeline.updating.small_tower import LAYOUT, SmallTower, drawn_estimate
from tests.pipeline.updating.test_updater import QUICK, TRUTH
from tests.pipeline.viewer.session import DESCRIPTION

START = 1_700_000_000 * NANOSECONDS
RATE = 10.0  # [Hz]
TURBINES = tuple(f"t{number}" for number in range(4))
WINDOW = 600  # [s]
SAMPLED_EVERY = 600  # [s]
WARM_UP = 0.5  # of the time: what is bounded by a number of blocks fills in three hours
SPEED = 10.0  # hours of measurements an hour
KEPT = 200  # windows that a live run's state keeps of a turbine
Take = Callable[[Message], object]


def main(arguments: list[str]) -> None:
    """Measure every node and print its slopes."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks memory")
    parser.add_argument("--hours", type=float, default=7.0)
    parser.add_argument("--only", choices=[*NODES], nargs="*", default=[*NODES])
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    figures = {name: apart(NODES[name], chosen.hours) for name in chosen.only}
    print(json.dumps(figures, indent=1))
    if chosen.write:
        before = kept("memory")
        keep(
            "memory",
            (before["figures"] if before and not is_old(before) else {})
            | figures,  # piece by piece
            command=f"python -m tests.benchmarks memory --hours {chosen.hours:g} --write",
            depends=["pipeline/nodes", "pipeline/state", "pipeline/recording", "pipeline/viewer"],
        )


def apart(made: Callable[[Path], Take], hours: float) -> dict[str, float]:
    """Slopes of one node, in a process that has nothing else."""
    reading, writing = os.pipe()
    if os.fork() == 0:
        with tempfile.TemporaryDirectory() as folder:
            os.write(writing, json.dumps(slopes(made(Path(folder)), hours)).encode())
        os._exit(0)
    os.close(writing)
    with os.fdopen(reading) as answer:
        found = dict(json.load(answer))
    os.wait()
    return found


def slopes(take: Take, hours: float) -> dict[str, float]:
    """Growth of what Python holds, and of what is resident [MB an hour at 10 ×]."""
    tracemalloc.start()
    held: list[tuple[float, float, float]] = []
    for second in range(round(3600 * hours)):
        for message in messages_of(second):
            take(message)
        if second % SAMPLED_EVERY == SAMPLED_EVERY - 1:
            gc.collect()
            held.append((second / 3600, tracemalloc.get_traced_memory()[0] / 1e6, resident()))
    hour, traced, in_all = np.array(held[round(WARM_UP * len(held)) :]).T
    by_python, of_process = (slope_of(hour, each) for each in (traced, in_all))
    return {
        "python [MB/h]": round(by_python[0], 3),
        "its standard error [MB/h]": round(by_python[1], 3),
        "resident [MB/h]": round(of_process[0], 3),
        "its error [MB/h]": round(of_process[1], 3),
        "python at the end [MB]": round(float(traced[-1]), 2),
    }


def slope_of(hour: FloatArray, held: FloatArray) -> tuple[float, float]:
    """Growth in an hour at 10 × and its standard error by least squares [MB/h]."""
    line, covariance = np.polyfit(hour, held, 1, cov=True)
    return SPEED * float(line[0]), SPEED * float(np.sqrt(covariance[0, 0]))


def resident() -> float:
    """Of this process [MB]."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * resource.getpagesize() / 1e6


def messages_of(second: int) -> Iterator[Message]:
    """What 4 turbines give in a second of a run."""
    rng = np.random.default_rng(second)
    start_ns = START + second * NANOSECONDS
    for turbine in TURBINES:
        samples = rng.standard_normal((round(RATE), 4)).astype(np.float32)
        first = second * round(RATE)
        layout = layout_of(turbine)
        if not second:
            yield layout
        yield AccelerationBlock(
            turbine, "tower", "s", layout.layout_id, second, first, start_ns, RATE, samples
        )
        if second % WINDOW == WINDOW - 1:
            yield from answers_of(turbine, second // WINDOW, rng)


def layout_of(turbine: str) -> Any:
    """Four channels."""
    return biaxial_layout("four", turbine=turbine, unit="tower", elevations=[60.0, 100.0])


def answers_of(turbine: str, window: int, rng: np.random.Generator) -> Iterator[Message]:
    """Estimate and posterior of a window."""
    start_ns = START + window * WINDOW * NANOSECONDS
    times = {"start_ns": start_ns, "end_ns": start_ns + WINDOW * NANOSECONDS}
    origins = (UnitOrigin("tower", "s", 0, window * WINDOW * round(RATE)),)
    drawn = drawn_estimate(TRUTH, rng, window=window)
    modes = tuple(replace(mode, name=f"m{n}") for n, mode in enumerate(drawn.modes))  # as tracked
    yield replace(drawn, modes=modes, turbine=turbine, origins=origins, **times)
    stiffness = DESCRIPTION.nominal * (1 + 0.01 * rng.standard_normal((200, 3)))
    yield replace(
        POSTERIOR,
        turbine=turbine,
        window=window,
        n_windows=window + 1,
        time_ns=times["end_ns"],
        origins=origins,
        draws=np.column_stack([stiffness, np.full(200, 1e-3)]),
    )


def identification(_: Path) -> Take:
    """Windows, tracks, books of admission."""
    identify_by_digests(setattr)
    node = IdentificationNode(OmaSettings(window_duration=WINDOW, hop=WINDOW))
    return lambda message: [*node.handle(message)]


def updating(_: Path) -> Take:
    """The evidence and its posteriors, of one turbine every hour."""
    node = TurbineUpdating(FoundationUpdater(SmallTower(), LAYOUT, QUICK, seed=1))

    def take(message: Message) -> object:
        hourly = isinstance(message, ModalEstimate) and message.window % 6 == 0
        return hourly and message.turbine == TURBINES[0] and [*node.handle(message)]

    return take


def state(_: Path) -> Take:
    """What status, summary and alarms know."""
    run = RunState(kept=KEPT, once=True)
    return lambda message: run.fold(message, START)


def recorder(folder: Path) -> Take:
    """Parts, acknowledgements and the index of the part being written."""
    now_ns = [START]
    settings = RecordingSettings(rotate_megabytes=10.0)
    node = SessionRecorder(
        folder / "session.mcap", metadata={}, clock=lambda: now_ns[0], settings=settings
    )

    def take(message: Message) -> object:
        now_ns[0] += NANOSECONDS // 4
        return [*node.handle(message)]

    return take


def viewer(folder: Path) -> Take:
    """Pictures into a file."""
    node = Viewer([RrdFile(folder / "session.rrd")], DESCRIPTION, session="memory")
    return node.handle


NODES = {each.__name__: each for each in (identification, updating, state, recorder, viewer)}
