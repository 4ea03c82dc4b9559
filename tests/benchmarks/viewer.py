"""What the pictures of a session cost: bytes a day, and their share of a replay's time.

    python -m tests.benchmarks viewer [--recording FILE] [--to SECONDS] [--hours N] [--keep]

The recording (recordings/parked.mcap: an hour of eight channels at 40 Hz) is replayed in lock-step
through the whole graph, recorder and a viewer that writes a .rrd among it, so that what the viewer
takes is exactly what the others wait for. Its wall time is that of its own calls. Its CPU time is
that of its calls in the main thread and of all other threads, which are Rerun's own: they
compress and write.

For the size the same messages, results and all, are drawn again and again, shifted by the
recording's length each time, with a status of every node once a second as in real time. The last
repetition is what a session costs once it runs; the first has also the layout and the styles.
"""

import argparse
import tempfile
import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, fields, replace
from pathlib import Path

from pipeline.app import Outputs, build
from pipeline.messages import Message, NodeStatus
from pipeline.nodes.node import Node, NodeStatistics
from pipeline.runtime.lock_step import run_lock_step
from pipeline.sources.recorded_stream import Playback
from pipeline.sources.sources import Source, replayed
from pipeline.viewer.outputs.outputs import RrdFile
from pipeline.viewer.viewer_node import Viewer
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._results import keep

RECORDING = Path("recordings/parked.mcap")
NODES = ("source", "identification", "updating", "recorder", "viewer", "summary", "status")
DAY = 86_400.0  # [s]
MOST_A_DAY = 150e6  # [bytes]
MOST_SHARE = 0.05  # of a replay's wall time [-]


@dataclass(slots=True)
class Timed:
    """A sink that says how long its calls took, and keeps what it was given."""

    sink: Viewer
    wall: float = 0.0  # [s]
    cpu: float = 0.0  # of the calling thread [s]
    taken: list[Message] = field(default_factory=list)

    @property
    def name(self) -> str:
        return self.sink.name

    @property
    def inputs(self) -> tuple[type, ...]:
        return self.sink.inputs

    @property
    def statistics(self) -> NodeStatistics:
        return self.sink.statistics

    def handle(self, message: Message) -> Iterable[Message]:
        self.taken.append(message)
        started, cpu_started = time.perf_counter(), time.thread_time()
        self.sink.handle(message)
        self._count(started, cpu_started)
        return ()

    def close(self) -> None:
        started, cpu_started = time.perf_counter(), time.thread_time()
        self.sink.close()
        self._count(started, cpu_started)

    def _count(self, started: float, cpu_started: float) -> None:
        self.wall += time.perf_counter() - started
        self.cpu += time.thread_time() - cpu_started


@dataclass(frozen=True, slots=True)
class Cost:
    """What the viewer took of one replay [s]."""

    wall: float
    wall_of_all: float
    cpu: float
    cpu_of_all: float


def main(arguments: list[str]) -> None:
    """Print shares and sizes beside their bounds."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks viewer")
    parser.add_argument("--recording", type=Path, default=RECORDING)
    parser.add_argument("--to", type=float, default=float("inf"), help="replay up to here [s]")
    parser.add_argument("--hours", type=int, default=3, help="repetitions of the recording")
    parser.add_argument("--keep", action="store_true", help="write the result")
    options = parser.parse_args(arguments)
    source = replayed(options.recording)
    with tempfile.TemporaryDirectory() as folder:
        cost, taken = replay(source, Path(folder), until=options.to)
        sizes = [
            drawn_size(source, repeated(taken, count), Path(folder) / f"{count}.rrd")
            for count in range(1, options.hours + 1)
        ]
    _print_cost(cost)
    day = _print_sizes(sizes, span_of(taken))
    if options.keep:
        keep(
            "viewer",
            {
                "mb_a_day": round(day / 1e6),
                "wall_percent": round(100 * cost.wall / cost.wall_of_all, 1),
                "cpu_percent": round(100 * cost.cpu / cost.cpu_of_all, 1),
            },
            command="python -m tests.benchmarks viewer",
            depends=("pipeline/viewer",),
        )


def replay(
    source: Source, folder: Path, *, until: float = float("inf")
) -> tuple[Cost, list[Message]]:
    """Run the whole graph in lock-step; what the viewer took of it, and all that it was given."""
    outputs = Outputs(recording=folder / "s.mcap", views=(RrdFile(folder / "s.rrd"),))
    nodes: list[Node] = [plan.make() for plan in build(source.scenario, source.layout, outputs)]
    ((place, viewer),) = (each for each in enumerate(nodes) if isinstance(each[1], Viewer))
    timed = nodes[place] = Timed(viewer)
    source = source.with_playback(Playback(end=until))
    messages = list(source.messages())
    started, cpu, own = time.perf_counter(), time.process_time(), time.thread_time()
    run_lock_step(messages, nodes, turbine=source.layout.turbine)
    wall_of_all, cpu_of_all = time.perf_counter() - started, time.process_time() - cpu
    of_other_threads = cpu_of_all - (time.thread_time() - own)
    return Cost(timed.wall, wall_of_all, timed.cpu + of_other_threads, cpu_of_all), timed.taken


def span_of(messages: Iterable[Message]) -> float:
    """Length of the measurements [s]."""
    blocks = [message for message in messages if isinstance(message, AccelerationBlock)]
    return (blocks[-1].end_ns - blocks[0].start_ns) / NANOSECONDS


def repeated(messages: list[Message], count: int) -> Iterator[Message]:
    """The same messages so many times, one after the other on the sensor clock."""
    span_ns = round(span_of(messages) * NANOSECONDS)
    last = max((getattr(message, "window", -1) for message in messages), default=-1)
    for number in range(count):
        for message in messages:
            if isinstance(message, NodeStatus):
                continue
            later = shifted(message, number * span_ns, windows=number * (last + 1))
            yield later
            if isinstance(later, AccelerationBlock):
                yield from statuses(later)


def shifted(message: Message, by_ns: int, *, windows: int) -> Message:
    """A message of a later time; blocks go on counting their samples."""
    moved = {
        each.name: getattr(message, each.name) + by_ns
        for each in fields(message)  # type: ignore[arg-type]
        if each.name.endswith("_ns")
    }
    if hasattr(message, "window"):
        moved["window"] = message.window + windows
    if isinstance(message, AccelerationBlock):
        samples = round(by_ns / NANOSECONDS * message.sampling_rate)
        moved["first_sample"] = message.first_sample + samples
        moved["sequence"] = message.sequence + samples // len(message.samples)
    return replace(message, **moved)  # type: ignore[type-var]


def statuses(block: AccelerationBlock) -> Iterator[NodeStatus]:
    """Every node says once a second that it runs."""
    for node in NODES:
        yield NodeStatus(block.turbine, node, block.end_ns, "running", block.sequence)


def drawn_size(source: Source, messages: Iterable[Message], path: Path) -> int:
    """Bytes of the .rrd of a session."""
    viewer = Viewer([RrdFile(path)], source.scenario.structure, session="s", strict=True)
    for message in messages:
        viewer.handle(message)
    viewer.close()
    return path.stat().st_size


def _print_cost(cost: Cost) -> None:
    print("                    viewer    whole replay    share    bound")
    for name, own, of_all in (
        ("wall time [s]", cost.wall, cost.wall_of_all),
        ("CPU time [s]", cost.cpu, cost.cpu_of_all),
    ):
        print(f"{name:16s} {own:9.2f} {of_all:15.2f} {own / of_all:8.1%}   <= {MOST_SHARE:.0%}")


def _print_sizes(sizes: list[int], span: float) -> float:
    """Bytes of a day."""
    print("\nmeasured [s]    file [MB]    more than before [MB]")
    for count, (size, before) in enumerate(zip(sizes, [0, *sizes], strict=False), start=1):
        print(f"{count * span:12.0f} {size / 1e6:12.2f} {(size - before) / 1e6:17.2f}")
    steady = sizes[-1] - sizes[-2] if len(sizes) > 1 else sizes[0]
    day = sizes[0] + (DAY / span - 1) * steady
    print(f"a day of one turbine: {day / 1e6:.0f} MB   <= {MOST_A_DAY / 1e6:.0f} MB")
    return day
