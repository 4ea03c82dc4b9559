"""What it costs to send blocks over Zenoh on this machine.

python -m tests.benchmarks transport [--turbines N] [--channels N] [--rate HZ] [--seconds S]

Publisher and subscriber are processes of their own. Live: every turbine gives a block a second.
At once: one turbine's blocks as fast as the subscriber acknowledges them.
"""

import argparse
import multiprocessing
import time
import timeit
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection

import numpy as np

from pipeline.messages import NodeStatus, StreamEnd
from pipeline.runtime.flow_control import Credit
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.codec import decode, encode
from pipeline.transport.zenoh_bus import ZenohBus, free_endpoint, hub, peer_of
from sensors.acquisition.blocks import AccelerationBlock

UNACKNOWLEDGED = 64  # blocks at once
ACKNOWLEDGE_EVERY = 16  # blocks


@dataclass(frozen=True, slots=True)
class Load:
    """What is published."""

    turbines: int
    channels: int
    rate: float  # [Hz]
    seconds: int

    def block(self, turbine: int, second: int, now_ns: int) -> AccelerationBlock:
        """A second of one turbine; it starts now, so that its age can be told on arrival."""
        n_samples = round(self.rate)
        noise = np.random.default_rng(turbine).normal(size=(n_samples, self.channels))
        return AccelerationBlock(
            *(f"t{turbine:03d}", "tower", "session", "layout"),
            sequence=second,
            first_sample=second * n_samples,
            start_ns=now_ns,
            sampling_rate=self.rate,
            samples=noise.astype(np.float32),
        )


@dataclass(frozen=True, slots=True)
class Received:
    """What arrived, and what the subscriber paid for it."""

    blocks: int
    lost: int
    latencies_ms: np.ndarray
    cpu: float  # [s]
    wall: float  # [s]


def main(arguments: list[str]) -> None:
    """Print codec cost, live latency and CPU share, and throughput at once."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks transport")
    parser.add_argument("--turbines", type=int, default=200)
    parser.add_argument("--channels", type=int, default=8)
    parser.add_argument("--rate", type=float, default=40.0, help="sampling rate [Hz]")
    parser.add_argument("--seconds", type=int, default=20)
    options = parser.parse_args(arguments)
    load = Load(options.turbines, options.channels, options.rate, options.seconds)
    print_codec_cost(load)
    print_row("live", *measured(load, publish_live))
    one = replace(load, turbines=1, seconds=3600)
    print_row("at once, an hour", *measured(one, publish_at_once))


def print_codec_cost(load: Load) -> None:
    """Print the size of a block and the time to write and to read it."""
    block = load.block(0, 0, time.time_ns())
    payload = encode(block)
    writing = min(timeit.repeat(lambda: encode(block), number=200, repeat=5)) / 200
    reading = min(timeit.repeat(lambda: decode(AccelerationBlock, payload), number=200, repeat=5))
    print(
        f"codec: a block of {len(payload)} bytes is written in {writing * 1e6:.0f} µs "
        f"and read in {reading / 200 * 1e6:.0f} µs"
    )


def print_row(name: str, published: int, sender_cpu: float, received: Received) -> None:
    """Print one measurement."""
    p50, p99 = np.percentile(received.latencies_ms, [50, 99])
    print(
        f"{name:18} published {published:6d}  received {received.blocks:6d}  "
        f"lost {received.lost}  {received.blocks / received.wall:7.0f} blocks/s  "
        f"latency p50 {p50:.1f} ms  p99 {p99:.1f} ms  "
        f"CPU share sender {sender_cpu / received.wall:.1%}  "
        f"receiver {received.cpu / received.wall:.1%}"
    )


def measured(load: Load, publish: Callable[[Bus, Inbox, Load], int]) -> tuple[int, float, Received]:
    """Blocks published, the publisher's CPU time [s], and what arrived in another process."""
    endpoint = free_endpoint()
    context = multiprocessing.get_context("spawn")
    here, there = context.Pipe()
    receiver = context.Process(target=receive, args=(endpoint, there))
    receiver.start()
    with closing(ZenohBus(hub(endpoint))) as bus:
        inbox = Inbox()
        bus.subscribe([NodeStatus], inbox)
        inbox.get()  # the receiver has subscribed
        cpu = time.process_time()
        published = publish(bus, inbox, load)
        cpu = time.process_time() - cpu
        bus.publish(StreamEnd("t000", "tower", "session", 0, published))
        received = here.recv()
    receiver.join()
    return published, cpu, received


def publish_live(bus: Bus, inbox: Inbox, load: Load) -> int:
    """Every turbine a block a second, spread evenly over the second."""
    started = time.monotonic()
    for number in range(load.turbines * load.seconds):
        second, turbine = divmod(number, load.turbines)
        time.sleep(max(0.0, started + number / load.turbines - time.monotonic()))
        bus.publish(load.block(turbine, second, time.time_ns()))
    return load.turbines * load.seconds


def publish_at_once(bus: Bus, inbox: Inbox, load: Load) -> int:
    """As fast as the receiver acknowledges."""
    credit = Credit(["receiver"], UNACKNOWLEDGED)
    statuses: list[NodeStatus] = []
    block = load.block(0, 0, time.time_ns())
    for second in range(load.seconds):
        while not credit.may_send(second, statuses):
            status = inbox.get()
            assert isinstance(status, NodeStatus)
            statuses = [status]
        bus.publish(replace(block, sequence=second, start_ns=time.time_ns()))
    return load.seconds


def receive(endpoint: str, answer: Connection) -> None:
    """The other process: take blocks until as many have come as were published."""
    with closing(ZenohBus(peer_of(endpoint))) as bus:
        inbox = Inbox(capacity=1_000_000)
        subscription = bus.subscribe([AccelerationBlock, StreamEnd], inbox)
        bus.publish(acknowledgement(-1))
        latencies: list[float] = []
        expected, started, cpu = None, 0.0, 0.0
        while expected is None or len(latencies) + subscription.lost < expected:
            message = inbox.get()
            if isinstance(message, StreamEnd):
                expected = message.n_blocks
            elif isinstance(message, AccelerationBlock):
                if not latencies:
                    started, cpu = time.monotonic(), time.process_time()
                latencies.append((time.time_ns() - message.start_ns) * 1e-6)
                if len(latencies) % ACKNOWLEDGE_EVERY == 0:
                    bus.publish(acknowledgement(message.sequence))
        answer.send(
            Received(
                len(latencies),
                subscription.lost,
                np.array(latencies),
                cpu=time.process_time() - cpu,
                wall=time.monotonic() - started,
            )
        )


def acknowledgement(sequence: int) -> NodeStatus:
    """What the receiver has handled."""
    return NodeStatus("t000", "receiver", time.time_ns(), "running", last_sequence=sequence)
