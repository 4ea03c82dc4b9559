"""A farm's blocks into one recorder, in real time, with real processes.

publisher (this process), one unit a turbine ──► [recorder] (a process of its own) ──► MCAP
"""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pipeline.messages import NodeStatus
from pipeline.recording.reader import recorded_messages
from pipeline.recording.rotation import parts_of
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks.transport import Load

PATIENCE = 120.0  # for what another process does [s]


@dataclass(frozen=True, slots=True)
class FarmOutcome:
    """What a recorder made of a farm."""

    published: int  # blocks
    recorded: int  # different ones that can be read back
    lost: int  # as the recorder says
    latency_p50_ms: float  # from a block's publishing to its place in the recording
    latency_p99_ms: float
    latency_longest_ms: float
    last_fifth_p99_ms: float  # of the blocks published last: grows where the recorder falls behind
    busy_share: float  # of the recorder's time spent in recording [-]
    exit_code: int


def farm_trial(folder: Path, load: Load) -> FarmOutcome:
    """Every turbine a block a second."""
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus, recorder(endpoint, folder) as process:
        statuses = Inbox()
        bus.subscribe([NodeStatus], statuses)
        first = status_that_has(statuses, 0)
        publish_evenly(bus, load)
        last = status_that_has(statuses, load.turbines * load.seconds)
        process.send_signal(signal.SIGTERM)
        exit_code = process.wait(PATIENCE)
    found = latencies(folder / "session.mcap")
    in_order = np.array([latency for _, latency in sorted(found.values())])
    p50, p99 = np.percentile(in_order, [50, 99])
    return FarmOutcome(
        published=load.turbines * load.seconds,
        recorded=len(found),
        lost=last.lost,
        latency_p50_ms=float(p50),
        latency_p99_ms=float(p99),
        latency_longest_ms=float(in_order.max()),
        last_fifth_p99_ms=float(np.percentile(in_order[-len(in_order) // 5 :], 99)),
        busy_share=(last.busy_s - first.busy_s) * NANOSECONDS / (last.time_ns - first.time_ns),
        exit_code=exit_code,
    )


@contextmanager
def recorder(endpoint: str, out: Path) -> Iterator["subprocess.Popen[bytes]"]:
    """`pilewatch node recorder` in a process of its own."""
    command = [sys.executable, "-m", "pipeline", "node", "recorder", "--connect", endpoint]
    process = subprocess.Popen([*command, "--scenario", "parked", "--out", str(out)])
    try:
        yield process
    finally:
        process.kill()
        process.wait()


def status_that_has(statuses: Inbox, blocks: int) -> NodeStatus:
    """The first status of a node that has taken, or knows to be lost, so many blocks."""
    deadline = time.monotonic() + PATIENCE
    while time.monotonic() < deadline:
        status = statuses.get(timeout=1.0)
        if isinstance(status, NodeStatus) and blocks <= status.lost + sum(
            each.count for each in status.received if each.message == AccelerationBlock.__name__
        ):
            return status
    raise RuntimeError(f"no node has taken {blocks} blocks")


def publish_evenly(bus: Bus, load: Load) -> None:
    """The turbines one after the other, each of them once a second."""
    started = time.monotonic()
    for number in range(load.turbines * load.seconds):
        second, turbine = divmod(number, load.turbines)
        time.sleep(max(0.0, started + number / load.turbines - time.monotonic()))
        bus.publish(load.block(turbine, second, time.time_ns()))


def latencies(path: Path) -> dict[tuple[str, int], tuple[int, float]]:
    """Turbine's key and moment of publishing → that moment [ns] and how long the block took [ms].

    A block of a `Load` starts when it is published.
    """
    return {
        (each.key, each.publish_time): (
            each.publish_time,
            (each.log_time - each.publish_time) * 1e-6,
        )
        for part in parts_of(path)
        for each in recorded_messages(part)
        if each.message_type is AccelerationBlock
    }
