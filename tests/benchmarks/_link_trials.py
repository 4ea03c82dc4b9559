"""What becomes of blocks when the way from a tower to the shore fails, with real processes.

publisher (this process) ──► [relay or router] ──► receiver (a process of its own)
"""

import multiprocessing
import os
import signal
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess

import numpy as np

from pipeline.messages import NodeStatus, StreamEnd
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint, hub
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._relay import Cut, Relay

PATIENCE = 60.0  # for what another process does [s]
BEFORE, AFTER = 1.0, 1.0  # of undisturbed blocks around a failure [s]


@dataclass(frozen=True, slots=True)
class LinkOutcome:
    """What a failing link did to a stream of blocks."""

    published: int
    received: int  # different ones
    lost: int  # as the subscription itself says
    recovered: int  # that came late, from where they were kept; as the subscription says
    repeated: int  # that came more than once
    disordered: int  # that came after a later one
    put_p999_ms: float  # of the calls of `publish`
    put_longest_ms: float


@dataclass(frozen=True, slots=True)
class Event:
    """Something done to the link at a moment."""

    moment: float  # since the first block [s]
    do: Callable[[], object]


def cut_trial(*, duration: float, rate: float, how: Cut) -> LinkOutcome:
    """A cable that is cut for so long [s] while so many blocks a second are published."""
    endpoint = free_endpoint()
    relay = Relay(endpoint)
    with closing(relay), receiver(hub(endpoint)) as (_, answer):
        settings = ZenohSettings(mode="client", connect=(relay.endpoint,))
        events = [
            Event(BEFORE, lambda: relay.cut(how)),
            Event(BEFORE + duration, relay.mend),
        ]
        return published(settings, rate, BEFORE + duration + AFTER, events, answer)


def frozen_trial(*, duration: float, rate: float) -> LinkOutcome:
    """A subscriber that is stopped (SIGSTOP) for so long [s]."""
    endpoint = free_endpoint()
    with receiver(ZenohSettings(connect=(endpoint,))) as (process, answer):
        pid = process.pid
        assert pid is not None
        events = [
            Event(BEFORE, lambda: os.kill(pid, signal.SIGSTOP)),
            Event(BEFORE + duration, lambda: os.kill(pid, signal.SIGCONT)),
        ]
        return published(hub(endpoint), rate, BEFORE + duration + AFTER, events, answer)


def router_trial(*, away: float, rate: float) -> LinkOutcome:
    """A router between both that is killed (SIGKILL) and back after so long [s]."""
    endpoint = free_endpoint()
    routers = [started_router(endpoint)]
    client = ZenohSettings(mode="client", connect=(endpoint,))

    def kill() -> None:
        routers[-1].kill()
        routers[-1].join()

    events = [
        Event(BEFORE, kill),
        Event(BEFORE + away, lambda: routers.append(started_router(endpoint))),
    ]
    try:
        with receiver(client) as (_, answer):
            return published(client, rate, BEFORE + away + 3 * AFTER, events, answer)
    finally:
        kill()


def started_router(endpoint: str) -> BaseProcess:
    """A router in a process of its own that listens there."""
    here, there = multiprocessing.get_context("spawn").Pipe()
    settings = ZenohSettings(mode="router", listen=(endpoint,))
    process = _context().Process(target=route, args=(settings, there), daemon=True)
    process.start()
    there.close()
    here.recv()
    return process


def route(settings: ZenohSettings, ready: Connection) -> None:
    """The router's process: until it is killed."""
    with closing(ZenohBus(settings)):
        ready.send("up")
        while True:
            time.sleep(PATIENCE)


def _context() -> multiprocessing.context.SpawnContext:
    return multiprocessing.get_context("spawn")


@contextmanager
def receiver(settings: ZenohSettings) -> Iterator[tuple[BaseProcess, Connection]]:
    """A process that takes blocks; its end of a pipe gives what it took."""
    here, there = _context().Pipe()
    process = _context().Process(target=receive, args=(settings, there), daemon=True)
    process.start()
    there.close()
    here.recv()
    try:
        yield process, here
    finally:
        process.kill()
        process.join()


def receive(settings: ZenohSettings, answer: Connection) -> None:
    """Take blocks until as many have come, or are known to be lost, as were published."""
    with closing(ZenohBus(settings)) as bus:
        answer.send("open")
        inbox = Inbox(capacity=1_000_000)
        subscription = bus.subscribe([AccelerationBlock, StreamEnd], inbox)
        bus.publish(NodeStatus("t1", "receiver", time.time_ns(), "ready", -1))
        taken: list[int] = []
        expected: int | None = None
        deadline = time.monotonic() + 10 * PATIENCE
        while (
            expected is None or len(set(taken)) + subscription.lost_of(AccelerationBlock) < expected
        ):
            message = inbox.get(timeout=0.2)
            if isinstance(message, StreamEnd):
                expected, deadline = message.n_blocks, time.monotonic() + PATIENCE / 2
            elif isinstance(message, AccelerationBlock):
                taken.append(message.sequence)
            if time.monotonic() > deadline:
                break
        counts = (subscription.lost_of, subscription.recovered_of)
        answer.send((taken, *(count(AccelerationBlock) for count in counts)))


def published(
    settings: ZenohSettings,
    rate: float,
    duration: float,
    events: Sequence[Event],
    answer: Connection,
) -> LinkOutcome:
    """Publish at a steady rate while the events happen; what arrived of it."""
    with closing(ZenohBus(settings)) as bus:
        statuses = Inbox()
        bus.subscribe([NodeStatus], statuses)
        if statuses.get(PATIENCE) is None:
            raise RuntimeError("the receiver did not become ready")
        puts = steadily(bus, rate, duration, events)
        bus.publish(StreamEnd("t1", "tower", "session-1", 0, len(puts)))
        if not answer.poll(2 * PATIENCE):
            raise RuntimeError("the receiver did not answer")
        taken, lost, recovered = answer.recv()
    return LinkOutcome(
        published=len(puts),
        received=len(set(taken)),
        lost=lost,
        recovered=recovered,
        repeated=len(taken) - len(set(taken)),
        disordered=int(np.sum(np.diff(taken) < 0)),
        put_p999_ms=float(np.percentile(puts, 99.9)) * 1e3,
        put_longest_ms=max(puts) * 1e3,
    )


def steadily(bus: Bus, rate: float, duration: float, events: Sequence[Event]) -> list[float]:
    """Publish blocks evenly; how long each call took [s]."""
    waiting = list(events)
    first = block_of_noise()
    puts = []
    started = time.monotonic()
    for number in range(round(rate * duration)):
        due = started + number / rate
        while waiting and started + waiting[0].moment <= due:
            waiting.pop(0).do()
        time.sleep(max(0.0, due - time.monotonic()))
        block = replace(
            first,
            sequence=number,
            first_sample=number * len(first.samples),
            start_ns=first.start_ns + number * NANOSECONDS,
        )
        before = time.monotonic()
        bus.publish(block)
        puts.append(time.monotonic() - before)
    return puts


def block_of_noise() -> AccelerationBlock:
    """One second of a tower under ambient load, as an ADC gives it."""
    noise = np.random.default_rng(8).normal(scale=0.07, size=(40, 8))
    return AccelerationBlock(
        *("t1", "tower", "session-1", "trial-1"),
        sequence=0,
        first_sample=0,
        start_ns=1_717_200_000 * NANOSECONDS,
        sampling_rate=40.0,
        samples=np.round(noise, 4).astype(np.float32),
    )
