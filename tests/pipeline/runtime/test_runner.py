"""Nodes that are served, that fail, and that are told to stop."""

import threading
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import count

import numpy as np
import pytest

from pipeline.messages import Message, MessageCount, NodeStatus, StreamEnd, WindowRejected
from pipeline.nodes.node import Node, NodeStatistics
from pipeline.runtime.errors import NodeFailed
from pipeline.runtime.lock_step import run_lock_step
from pipeline.runtime.node_thread import DRAINED_WITHIN, NodeThread, serve
from pipeline.runtime.runner import (
    KEPT_FOR_RECORDER,
    KEPT_FOR_VIEWER,
    _stop,
    run_workers,
)
from pipeline.runtime.source_feed import STOPPED_WITHIN, with_end
from pipeline.transport.bus import Inbox
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout, biaxial_layout
from tests.pipeline.example_messages import block as acceleration_block
from tests.pipeline.example_messages import rejection
from tests.pipeline.example_messages import status as example_status
from tests.pipeline.transport.memory_bus import MemoryBus, MemorySubscription


class Listener:
    """Remembers the numbers of the blocks that it was given."""

    name = "listener"
    inputs: tuple[type, ...] = (AccelerationBlock, StreamEnd)
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.sequences: list[int] = []
        self.ends: list[StreamEnd] = []
        self.closed = False

    def handle(self, message: Message) -> Iterable[Message]:
        if isinstance(message, AccelerationBlock):
            self.sequences.append(message.sequence)
        elif isinstance(message, StreamEnd):
            self.ends.append(message)
        return ()

    def close(self) -> None:
        self.closed = True


class Fragile(Listener):
    """Breaks at the fifth block."""

    name = "fragile"

    def handle(self, message: Message) -> Iterable[Message]:
        super().handle(message)
        if len(self.sequences) == 5:
            raise ZeroDivisionError("the fifth block")
        return ()


def blocks(n_blocks: int) -> Iterator[AccelerationBlock]:
    for sequence in range(n_blocks):
        yield acceleration_block(sequence)


def threaded(bus: MemoryBus, *nodes: Node) -> list[NodeThread]:
    return [NodeThread(node, lambda: bus, "t1") for node in nodes]


def test_the_end_tells_how_many_blocks_there_were() -> None:
    *_, end = with_end(blocks(7))
    assert isinstance(end, StreamEnd)
    assert end.n_blocks == 7
    *_, last = blocks(7)
    assert end.time_ns == last.end_ns


def test_the_end_counts_the_blocks_of_a_units_last_start() -> None:
    """A unit starts again under its name: the books are those of each boot."""
    again = [replace(each, start_ns=each.start_ns + 900 * NANOSECONDS) for each in blocks(15)]
    *_, end = with_end([*blocks(40), *again, again[3], *again[-2:]])
    assert isinstance(end, StreamEnd)
    assert end.n_blocks == 15  # what comes twice counts once


def test_lock_step_gives_every_node_every_block_in_order() -> None:
    listeners = [Listener(), Listener()]
    run_lock_step(blocks(20), listeners, turbine="t1")
    for listener in listeners:
        assert listener.sequences == list(range(20))
        assert listener.closed


def test_lock_step_ends_where_it_is_stopped() -> None:
    """Ctrl-C only ended the waiting for the next sample: a year's replay went on to its end."""
    listener, stopping = Listener(), threading.Event()

    def stop_at_fifth(block: AccelerationBlock) -> None:
        if block.sequence == 4:
            stopping.set()

    run_lock_step(blocks(20), [listener], turbine="t1", report=stop_at_fifth, stopping=stopping)
    assert listener.sequences == list(range(5))
    assert listener.closed


def test_a_source_never_runs_further_ahead_than_it_may() -> None:
    bus, listener = MemoryBus(), Listener()
    ahead = []

    def measured() -> Iterator[AccelerationBlock]:
        for block in blocks(200):
            ahead.append(block.sequence - len(listener.sequences))
            yield block

    run_workers(measured(), threaded(bus, listener), bus, turbine="t1", unacknowledged_blocks=32)
    assert listener.sequences == list(range(200))
    assert [end.n_blocks for end in listener.ends] == [200]
    assert max(ahead) <= 32


@pytest.mark.parametrize("unacknowledged_blocks", [8, None])
def test_a_node_that_fails_ends_the_run_and_the_others_are_closed(
    unacknowledged_blocks: int | None,
) -> None:
    bus, fragile, listener = MemoryBus(), Fragile(), Listener()
    workers = threaded(bus, fragile, listener)
    endless = (acceleration_block(sequence) for sequence in count())
    with pytest.raises(NodeFailed, match="node fragile failed: ZeroDivisionError"):
        run_workers(
            endless, workers, bus, turbine="t1", unacknowledged_blocks=unacknowledged_blocks
        )
    assert fragile.closed
    assert listener.closed


class Slow(NodeThread):
    """Remembers how long it was waited for."""

    waited = 0.0

    def has_ended(self, within: float) -> bool:
        self.waited = max(self.waited, within)
        return super().has_ended(within)


def test_a_run_whose_source_has_ended_waits_for_its_nodes_to_close_their_files() -> None:
    bus = MemoryBus()
    slow = Slow(Listener(), lambda: bus, "t1")
    run_workers(blocks(5), [slow], bus, turbine="t1", unacknowledged_blocks=None)
    assert slow.waited > 100.0
    again, stopping = Slow(Listener(), lambda: bus, "t1"), threading.Event()
    stopping.set()
    run_workers(None, [again], bus, turbine="t1", unacknowledged_blocks=None, stopping=stopping)
    assert again.waited <= STOPPED_WITHIN


def test_a_run_that_is_stopped_handles_what_was_published() -> None:
    bus, listener, stopping = MemoryBus(), Listener(), threading.Event()
    published = []

    def stop_at_fifty(block: AccelerationBlock) -> None:
        published.append(block.sequence)
        if block.sequence == 49:
            stopping.set()

    run_workers(
        blocks(10_000),
        threaded(bus, listener),
        bus,
        turbine="t1",
        unacknowledged_blocks=64,
        report=stop_at_fifty,
        stopping=stopping,
    )
    assert listener.sequences == published
    assert len(published) == 50


class DeafBus(MemoryBus):
    """Delivers statuses alone, as a transport of the wrong version did."""

    def publish(self, message: Message) -> None:
        if isinstance(message, NodeStatus):
            super().publish(message)


@pytest.mark.parametrize("unacknowledged_blocks", [8, None])
def test_a_node_that_hears_nothing_ends_the_run_with_its_name(
    monkeypatch: pytest.MonkeyPatch, unacknowledged_blocks: int | None
) -> None:
    """On main before, such a run never ended."""
    monkeypatch.setattr("pipeline.runtime.source_feed.FIRST_BLOCK_TIMEOUT", 0.5)
    bus, listener = DeafBus(), Listener()
    with pytest.raises(NodeFailed, match=r"listener: the first block was published 0\.5 s ago"):
        run_workers(
            blocks(50),
            threaded(bus, listener),
            bus,
            turbine="t1",
            unacknowledged_blocks=unacknowledged_blocks,
        )
    assert listener.closed


class LateLayouts(MemoryBus):
    """Delivers layouts a third of a second late, as a link does that has just come up."""

    def publish(self, message: Message) -> None:
        if isinstance(message, SensorLayout):
            threading.Timer(0.3, super().publish, [message]).start()
        else:
            super().publish(message)


class InOrder(Listener):
    """Remembers what came when."""

    inputs = (AccelerationBlock, SensorLayout, StreamEnd)

    def __init__(self) -> None:
        super().__init__()
        self.came: list[str] = []

    def handle(self, message: Message) -> Iterable[Message]:
        self.came.append(type(message).__name__)
        return super().handle(message)


def test_the_blocks_wait_until_every_node_has_their_layouts() -> None:
    """Of two units that are joined only the last 64 blocks waited for a layout that came later:
    under load a replay could lose its only window."""
    bus, listener = LateLayouts(), InOrder()
    layouts = [biaxial_layout("l", turbine="t1", unit=u, elevations=(9.0,)) for u in ("a", "b")]
    source = [*layouts, *blocks(5), layouts[0], *list(blocks(8))[5:]]
    run_workers(source, threaded(bus, listener), bus, turbine="t1", unacknowledged_blocks=None)
    assert listener.came[:3] == ["SensorLayout", "SensorLayout", "AccelerationBlock"]
    assert listener.came.count("AccelerationBlock") == 8


def test_a_layout_that_never_arrives_does_not_hold_the_blocks_for_ever(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.runtime.source_feed.LAYOUT_TIMEOUT", 0.2)
    monkeypatch.setattr("pipeline.runtime.source_feed.GIVEN_UP_AFTER", 0.3)
    monkeypatch.setattr("pipeline.runtime.node_thread.STATUS_PERIOD", 0.05)
    bus, listener = WithoutLayouts(), InOrder()
    source = [biaxial_layout("l", turbine="t1", unit="a", elevations=(9.0,)), *blocks(5)]
    run_workers(source, threaded(bus, listener), bus, turbine="t1", unacknowledged_blocks=None)
    assert listener.came.count("AccelerationBlock") == 5


class WithoutLayouts(MemoryBus):
    """Loses them."""

    def publish(self, message: Message) -> None:
        if not isinstance(message, SensorLayout):
            super().publish(message)


class LossyBus(MemoryBus):
    """Loses the last block on its way to one reader, and nothing knows it."""

    def subscribe(
        self, message_types: Sequence[type], inbox: Inbox, *, key: str | None = None
    ) -> MemorySubscription:
        subscription = super().subscribe(message_types, inbox, key=key)
        if message_types == Last.inputs:
            deliver = subscription.deliver
            subscription.deliver = lambda each: None if b"last" in each.payload else deliver(each)  # type: ignore[method-assign]
        return subscription


class Last(Listener):
    """Whom the last block does not reach."""

    name = "last"
    inputs = (AccelerationBlock, StreamEnd, NodeStatus)


def test_a_run_ends_although_a_message_has_never_arrived_and_says_which(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """On main before, it waited for ever: of 72 posteriors a recorder had missed 23."""
    monkeypatch.setattr("pipeline.runtime.source_feed.GIVEN_UP_AFTER", 0.3)
    monkeypatch.setattr("pipeline.runtime.node_thread.STATUS_PERIOD", 0.05)
    bus, listener = LossyBus(), Last()
    measured = [*blocks(4), replace(acceleration_block(4), unit="last")]
    run_workers(measured, threaded(bus, listener), bus, turbine="t1", unacknowledged_blocks=None)
    assert listener.sequences == [0, 1, 2, 3]
    errors = [each.getMessage() for each in caplog.records if each.levelname == "ERROR"]
    assert "last has not received 1 of 5 AccelerationBlock: the transport lost" in errors[0]


def test_a_run_does_not_give_up_while_a_node_computes(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """It reports nothing then: that it waited before, while another one computed, is old."""
    monkeypatch.setattr("pipeline.runtime.source_feed.GIVEN_UP_AFTER", 0.2)
    monkeypatch.setattr("pipeline.runtime.source_feed.REPORTING", 0.1)
    monkeypatch.setattr("pipeline.runtime.node_thread.STATUS_PERIOD", 0.01)

    class First(Listener):
        """Answers when the stream has ended, half a second later."""

        name = "first"

        def handle(self, message: Message) -> Iterable[Message]:
            if isinstance(message, StreamEnd):
                time.sleep(0.5)
                yield rejection(0)

    class Second(Listener):
        """Computes for as long with the answer."""

        name = "second"
        inputs = (WindowRejected,)

        def handle(self, message: Message) -> Iterable[Message]:
            time.sleep(0.5)
            return ()

    bus = MemoryBus()
    workers = threaded(bus, First(), Second())
    run_workers(blocks(3), workers, bus, turbine="t1", unacknowledged_blocks=None)
    assert not [each for each in caplog.records if each.levelname == "ERROR"]


def test_a_live_run_goes_on_until_it_is_stopped() -> None:
    bus, listener, stopping = MemoryBus(), Listener(), threading.Event()

    class Instrument(Listener):
        """Publishes by itself once the listener is ready."""

        name = "instrument"
        inputs = (NodeStatus,)

        def handle(self, message: Message) -> Iterable[Message]:
            if isinstance(message, NodeStatus) and message.node == "listener":
                if message.state == "ready":
                    yield from blocks(10)
                elif message.last_sequence == 9:
                    stopping.set()

    workers = threaded(bus, listener, Instrument())
    run_workers(None, workers, bus, turbine="t1", unacknowledged_blocks=None, stopping=stopping)
    assert listener.sequences == list(range(10))


def test_what_a_node_says_of_itself_adds_up() -> None:
    told: list[NodeStatus] = []

    class Book(Listener):
        name = "book"
        inputs = (NodeStatus,)

        def handle(self, message: Message) -> Iterable[Message]:
            assert isinstance(message, NodeStatus)
            told.append(message)
            return ()

    run_lock_step(blocks(12), [Listener(), Book()], turbine="t1")
    (status,) = (each for each in told if each.node == "listener")
    assert status.state == "stopped"
    assert {each.message: each.count for each in status.received} == {
        "AccelerationBlock": 12,
        "StreamEnd": 1,
    }
    assert status.last_sequence == 11
    assert np.isfinite(status.busy_s)


def test_a_node_that_is_far_behind_ends_within_seconds_when_it_is_asked_to() -> None:
    """A block takes it a second, and a thousand wait."""
    now = [0.0]

    class Slow(Listener):
        def handle(self, message: Message) -> Iterable[Message]:
            now[0] += 1.0
            return super().handle(message)

    bus, node, stopping = MemoryBus(), Slow(), threading.Event()
    for each in blocks(1000):
        bus.publish(each)
    stopping.set()
    serve(node, bus, turbine="t1", stopping=stopping, monotonic=lambda: now[0])
    assert node.closed
    assert len(node.sequences) <= DRAINED_WITHIN + 2


def test_a_node_that_never_answers_does_not_keep_the_run_from_ending() -> None:
    stuck = threading.Event()

    class Stuck(Listener):
        def handle(self, message: Message) -> Iterable[Message]:
            stuck.wait()
            return ()

    bus = MemoryBus()
    bus.publish(acceleration_block(0))
    (thread,) = threaded(bus, Stuck())
    thread.start()
    thread.ask_to_stop()
    assert not thread.has_ended(0.0)
    thread.abandon()
    assert thread.is_alive()
    stuck.set()
    thread.join()


@pytest.mark.parametrize(
    ("received", "lost", "has_blocks"),
    [
        ((), 0, False),
        ((MessageCount("SensorLayout", 3),), 0, False),
        ((MessageCount("AccelerationBlock", 0),), 0, False),
        ((MessageCount("AccelerationBlock", 1),), 0, True),
        ((), 1, True),
    ],
)
def test_a_layout_is_no_first_block(
    received: tuple[MessageCount, ...], lost: int, has_blocks: bool
) -> None:
    status = replace(example_status("recorder"), received=received, lost=lost)
    assert status.has_blocks is has_blocks


class Stopping:
    """A worker that needs some seconds to stop, by a clock that stands while nobody waits."""

    inputs: tuple[type, ...] = ()
    restarts = 0

    def __init__(self, name: str, needs: float, now: list[float]) -> None:
        self.name, self._needs, self._now = name, needs, now
        self.asked = self.ended = self.abandoned = np.nan  # [s]

    def start(self) -> None: ...
    def check(self) -> None: ...

    def ask_to_stop(self) -> None:
        self.asked = self._now[0]

    def has_ended(self, within: float) -> bool:
        end = self.asked + self._needs
        if end > self._now[0] + max(within, 0.0):
            self._now[0] += max(within, 0.0)
            return False
        self._now[0] = max(self._now[0], end)
        self.ended = end
        return True

    def abandon(self) -> None:
        self.abandoned = self._now[0]


def stopped(monkeypatch: pytest.MonkeyPatch, **needs: float) -> dict[str, Stopping]:
    """Stop workers that need so many seconds, in 7."""
    now = [0.0]
    monkeypatch.setattr("pipeline.runtime.runner.time.monotonic", lambda: now[0])
    workers = {name: Stopping(name, seconds, now) for name, seconds in needs.items()}
    _stop(tuple(workers.values()), 7.0)
    return workers


def test_a_node_that_computes_does_not_cost_those_behind_it_their_end(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Windows of four turbines closed as the run was stopped; on main before, the identification
    had all the time, and the viewer was killed with its pictures open."""
    done = stopped(monkeypatch, identification=2.6, updating=9.0, viewer=0.9, recorder=0.4)
    assert [name for name, each in done.items() if each.abandoned > 0] == ["updating"]
    assert done["recorder"].asked >= done["updating"].abandoned >= 7.0 - KEPT_FOR_RECORDER


def test_nodes_stop_in_the_order_of_the_flow_when_they_are_quick(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = stopped(monkeypatch, identification=0.5, updating=0.4, viewer=0.3, recorder=0.2)
    assert [each.asked for each in done.values()] == pytest.approx([0.0, 0.5, 1.1, 0.9])
    assert all(np.isnan(each.abandoned) for each in done.values())


def test_the_recorder_has_time_left_when_the_nodes_before_it_hang(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    done = stopped(monkeypatch, identification=np.inf, recorder=np.inf, viewer=np.inf)
    given = {name: each.abandoned - each.asked for name, each in done.items()}
    late, last = KEPT_FOR_RECORDER, KEPT_FOR_VIEWER
    assert given == pytest.approx(
        {"identification": 7.0 - late, "recorder": late - last, "viewer": last}
    )
    (alone,) = stopped(monkeypatch, recorder=np.inf).values()
    assert alone.abandoned == 7.0
