"""What every bus promises, and what an inbox does with what arrives."""

import threading
from collections.abc import Iterator
from contextlib import closing
from dataclasses import replace

import pytest

from pipeline.messages import Message, NodeStatus, WindowRejected
from pipeline.streams import key_of, stream_of
from pipeline.transport.bus import Bus, Delivery, Inbox
from pipeline.transport.codec import LARGEST_PAYLOAD, encode
from pipeline.transport.errors import CodecError, TransportError
from pipeline.transport.zenoh_bus import ZenohBus
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.example_messages import LAYOUT, all_same, block, rejection, status
from tests.pipeline.transport.memory_bus import MemoryBus

PATIENCE = 20.0  # for something that comes in milliseconds [s]; only a failure ever waits so long


@pytest.fixture(params=[MemoryBus, ZenohBus])
def bus(request: pytest.FixtureRequest) -> Iterator[Bus]:
    with closing(request.param()) as opened:
        yield opened


def take(inbox: Inbox, n_messages: int) -> list[Message]:
    taken = []
    while len(taken) < n_messages and (message := inbox.get(timeout=PATIENCE)) is not None:
        taken.append(message)
    return taken


def test_messages_arrive_in_the_order_of_publishing(bus: Bus) -> None:
    inbox = Inbox()
    bus.subscribe([AccelerationBlock], inbox)
    published = [block(sequence) for sequence in range(50)]
    for message in published:
        bus.publish(message)
    assert all_same(take(inbox, 50), published)


def test_a_subscriber_gets_what_it_asked_for_of_every_turbine(bus: Bus) -> None:
    inbox = Inbox()
    bus.subscribe([AccelerationBlock, WindowRejected], inbox)
    bus.publish(LAYOUT)
    bus.publish(block(0))
    bus.publish(block(0, turbine="t2"))
    bus.publish(rejection(0))
    kinds = {(type(message).__name__, message.turbine) for message in take(inbox, 3)}
    assert kinds == {
        ("AccelerationBlock", "t1"),
        ("AccelerationBlock", "t2"),
        ("WindowRejected", "t1"),
    }


def test_a_late_subscriber_still_gets_the_layout_and_the_last_blocks(bus: Bus) -> None:
    cached = stream_of(AccelerationBlock).cached
    bus.publish(LAYOUT)
    for sequence in range(cached + 100):
        bus.publish(block(sequence))
    inbox = Inbox()
    bus.subscribe([AccelerationBlock, SensorLayout], inbox)
    received = take(inbox, cached + 1)
    layouts = [message for message in received if isinstance(message, SensorLayout)]
    sequences = [m.sequence for m in received if isinstance(m, AccelerationBlock)]
    assert layouts == [LAYOUT]
    assert sequences == list(range(100, cached + 100))


def test_two_subscribers_get_the_same(bus: Bus) -> None:
    inboxes = [Inbox(), Inbox()]
    for inbox in inboxes:
        bus.subscribe([NodeStatus], inbox)
    bus.publish(status("updating"))
    assert [take(inbox, 1) for inbox in inboxes] == [[status("updating")]] * 2


def test_nothing_arrives_after_a_subscription_is_closed(bus: Bus) -> None:
    closed, still_open = Inbox(), Inbox()
    subscription = bus.subscribe([NodeStatus], closed)
    bus.subscribe([NodeStatus], still_open)
    subscription.close()
    bus.publish(status("updating"))
    assert take(still_open, 1) == [status("updating")]
    assert len(closed) == 0
    assert subscription.lost == 0
    assert subscription.lost_of(NodeStatus) == subscription.recovered_of(NodeStatus) == 0


@pytest.mark.parametrize("turbine", ["", "a/b", "*", "a$b", "@a"])
def test_a_turbine_that_would_change_the_key_is_refused(bus: Bus, turbine: str) -> None:
    with pytest.raises(TransportError, match="cannot be part of a key"):
        bus.publish(block(0, turbine=turbine))


def test_a_message_that_contradicts_itself_is_refused(bus: Bus) -> None:
    with pytest.raises(CodecError, match="sampling_rate"):
        bus.publish(replace(block(0), sampling_rate=0.0))


# ---- the inbox ---------------------------------------------------------------------------------


def delivered(
    message: Message, *, key: str | None = None, payload: bytes | None = None
) -> Delivery:
    return Delivery(type(message), key or key_of(message), payload or encode(message))


def test_a_full_inbox_drops_the_oldest_and_counts() -> None:
    inbox = Inbox(capacity=3)
    for sequence in range(5):
        inbox.put(delivered(block(sequence)))
    assert [message.sequence for message in take(inbox, 3)] == [2, 3, 4]
    assert inbox.dropped == 2
    assert inbox.dropped_of(AccelerationBlock) == 2
    assert inbox.dropped_of(NodeStatus) == 0


def test_what_waits_never_has_more_bytes_than_are_allowed() -> None:
    sizes = [len(delivered(block(sequence)).payload) for sequence in range(3)]
    inbox = Inbox(capacity_bytes=sum(sizes) - 1)
    for sequence in range(3):
        inbox.put(delivered(block(sequence)))
    assert [message.sequence for message in take(inbox, 2)] == [1, 2]
    assert inbox.dropped == 1


def test_a_broken_message_is_counted_and_the_next_one_taken() -> None:
    inbox = Inbox()
    inbox.put(delivered(block(0), payload=b"\xff\xff"))
    inbox.put(delivered(block(1)))
    assert all_same(take(inbox, 1), [block(1)])
    assert inbox.malformed == 1


def test_what_every_nodes_inbox_refuses_is_logged_once(caplog: pytest.LogCaptureFixture) -> None:
    inboxes = [Inbox() for _ in range(4)]
    for _ in range(5):
        for inbox in inboxes:
            inbox.put(delivered(block(0), key="pilewatch/t1/once/acceleration", payload=b"\xff"))
            assert inbox.get(timeout=0) is None
    assert [inbox.malformed for inbox in inboxes] == [5] * 4
    logged = [each.getMessage().partition(" so far")[0] for each in caplog.records]
    assert [text.rpartition("(")[2] for text in logged] == ["1", "2", "4"]


def test_a_message_of_another_turbine_than_its_key_is_not_believed() -> None:
    inbox = Inbox()
    inbox.put(delivered(block(0, turbine="t2"), key="pilewatch/t1/tower/acceleration"))
    assert inbox.get(timeout=0) is None
    assert inbox.malformed == 1


def test_an_empty_inbox_gives_nothing_when_the_time_is_over() -> None:
    assert Inbox().get(timeout=0) is None


def test_closing_an_inbox_wakes_its_reader_and_keeps_what_is_queued() -> None:
    inbox = Inbox()
    inbox.put(delivered(status("updating")))
    taken: list[Message | None] = []
    reader = threading.Thread(target=lambda: taken.extend([inbox.get(), inbox.get()]))
    reader.start()
    inbox.close()
    reader.join(PATIENCE)
    assert taken == [status("updating"), None]


def test_what_is_too_large_or_no_message_is_dropped_counted_and_explained() -> None:
    inbox = Inbox()
    key = key_of(block(0))
    inbox.put(Delivery(AccelerationBlock, key, bytes(LARGEST_PAYLOAD + 1)))
    assert len(inbox) == 0
    assert inbox.malformed == 1
    assert inbox.refusal.startswith(f"on {key}: {LARGEST_PAYLOAD + 1} bytes")
    inbox.put(Delivery(AccelerationBlock, key, b"\xff\xff"))
    inbox.put(Delivery(AccelerationBlock, key, encode(block(1))))
    received = inbox.get(timeout=0)
    assert isinstance(received, AccelerationBlock)
    assert received.sequence == 1
    assert inbox.malformed == 2
    assert "no AccelerationBlock" in inbox.refusal


def test_a_flood_of_large_messages_costs_no_more_memory_than_is_allowed() -> None:
    payload = encode(block(0))
    inbox = Inbox(capacity_bytes=10 * len(payload))
    for sequence in range(25):
        inbox.put(Delivery(AccelerationBlock, key_of(block(0)), encode(block(sequence))))
    assert len(inbox) <= 10
    assert inbox.dropped_of(AccelerationBlock) == 25 - len(inbox)
    last = [message.sequence for _ in range(len(inbox)) if (message := inbox.get(timeout=0))]
    assert last[-1] == 24


def test_a_unit_that_floods_costs_no_other_unit_a_message(monkeypatch) -> None:
    size = len(encode(block(0)))
    monkeypatch.setattr("pipeline.transport.bus.KEY_BYTES", 5.5 * size)
    monkeypatch.setattr("pipeline.transport.bus.PLACES_KEPT", 4)
    inbox = Inbox(capacity_bytes=40 * size)
    sent = [block(n, turbine="honest" if n % 25 == 0 else "flood") for n in range(100)]
    for message in sent:
        inbox.put(Delivery(AccelerationBlock, key_of(message), encode(message)))
    inbox.close()
    heard = take(inbox, 100)
    honest = [message.sequence for message in heard if message.turbine == "honest"]
    assert honest == [0, 25, 50, 75]
    assert [m.sequence for m in heard if m.turbine == "flood"] == [95, 96, 97, 98, 99]
    assert [message.sequence for message in heard] == sorted(message.sequence for message in heard)
    assert inbox.dropped_of(AccelerationBlock) == 100 - len(heard)
    assert len(inbox) == 0


def test_keys_beyond_those_that_are_listened_to_are_dropped_and_counted(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.transport.bus.MOST_KEYS", 3)
    inbox = Inbox()
    for sequence in range(2):
        for number in range(5):
            message = block(sequence, turbine=f"t{number}")
            inbox.put(Delivery(AccelerationBlock, key_of(message), encode(message)))
    inbox.close()
    heard = [message.turbine for message in take(inbox, 10)]
    assert heard == ["t0", "t1", "t2", "t0", "t1", "t2"]
    assert inbox.malformed == 4
    assert inbox.refusal == (
        "on pilewatch/t4/tower/acceleration: another key than the 3 that are listened to"
    )


def test_what_is_malformed_takes_no_place_among_the_keys(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.transport.bus.MOST_KEYS", 1)
    inbox = Inbox()
    inbox.put(Delivery(AccelerationBlock, "pilewatch/t9/tower/acceleration", b"nonsense"))
    inbox.put(Delivery(AccelerationBlock, key_of(block(0)), encode(block(0))))
    assert [message.turbine for message in take(inbox, 1)] == ["t1"]
