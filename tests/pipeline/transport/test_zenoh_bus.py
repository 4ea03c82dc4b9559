"""Sessions of their own on one machine: they find each other and lose nothing."""

import multiprocessing
import queue
import random
import socket
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
import zenoh
from zenoh import NTP64

from pipeline.messages import NodeStatus, WindowRejected
from pipeline.streams import stream_of
from pipeline.transport import zenoh_arrivals, zenoh_bus, zenoh_settings
from pipeline.transport.bus import Inbox
from pipeline.transport.errors import TransportError, UnreachableError
from pipeline.transport.zenoh_arrivals import (
    Beginnings,
    Publisher,
    beginning,
    is_recovered,
    lost_at_beginning,
)
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint, hub, peer_of
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import block, rejection, status
from tests.pipeline.transport.test_bus import PATIENCE, take

NODES = ("source", "identification", "updating", "recorder", "viewer")


class Peer(threading.Thread):
    """Publishes fifty messages at once, while links still come up, and listens until it has those
    of every peer."""

    def __init__(self, name: str, settings: ZenohSettings, everybody_done: threading.Barrier):
        super().__init__(name=name)
        self.heard: dict[str, list[int]] = {node: [] for node in NODES}
        self._settings = settings
        self._everybody_done = everybody_done

    def run(self) -> None:
        with closing(ZenohBus(self._settings)) as bus:
            inbox = Inbox()
            bus.subscribe([WindowRejected], inbox)
            for window in range(50):
                bus.publish(rejection(window, turbine=self.name))
            for message in take(inbox, 50 * len(NODES)):
                self.heard[message.turbine].append(message.window)
            self._everybody_done.wait(PATIENCE)


@pytest.mark.parametrize("seed", range(3))
def test_peers_that_start_in_any_order_all_hear_each_other_completely(seed: int) -> None:
    endpoint = free_endpoint()
    order = random.Random(seed).sample(NODES, len(NODES))
    done = threading.Barrier(len(NODES))
    peers = [
        Peer(name, hub(endpoint) if name == "source" else peer_of(endpoint), done) for name in order
    ]
    for peer in peers:
        peer.start()
    for peer in peers:
        peer.join(2 * PATIENCE)
    assert {peer.name: peer.heard for peer in peers} == {
        name: {node: list(range(50)) for node in NODES} for name in NODES
    }


def test_of_too_many_publishers_the_one_silent_longest_goes_and_may_come_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.transport.zenoh_bus.MOST_PUBLISHERS", 3)
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus, closing(ZenohBus(peer_of(endpoint))) as other:
        inbox = Inbox()
        other.subscribe([WindowRejected], inbox)
        turbines = ["t1", "t2", "t3", "t1", "t4", "t2", "t1"]
        for window, turbine in enumerate(turbines):
            bus.publish(rejection(window, turbine=turbine))
            (heard,) = take(inbox, 1)
            assert (heard.turbine, heard.window) == (turbine, window)
        assert [key.split("/")[1] for key in bus._publishers] == ["t4", "t2", "t1"]


def test_the_largest_block_that_may_be_sent_passes_a_link(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seven and a half megabytes: the codec's bound is eight. As between two machines: on one they
    may go through memory that both share, which no link limits."""
    entries = zenoh_settings._entries
    apart = {"transport/shared_memory/enabled": False}
    monkeypatch.setattr(zenoh_settings, "_entries", lambda settings: entries(settings) | apart)
    samples = np.ones((1_900_000, 1), np.float32)
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus, closing(ZenohBus(peer_of(endpoint))) as other:
        inbox = Inbox()
        other.subscribe([AccelerationBlock], inbox)
        bus.publish(replace(block(0), samples=samples))
        (heard,) = take(inbox, 1)
    assert isinstance(heard, AccelerationBlock)
    np.testing.assert_array_equal(heard.samples, samples)


def publish_blocks(endpoint: str, n_blocks: int) -> None:
    """A process of its own: publish, and leave at once."""
    with closing(ZenohBus(peer_of(endpoint))) as bus:
        inbox = Inbox()
        bus.subscribe([NodeStatus], inbox)
        take(inbox, 1)  # somebody listens
        for sequence in range(n_blocks):
            bus.publish(block(sequence))


def test_what_a_process_published_before_it_left_arrives() -> None:
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus:
        inbox = Inbox()
        bus.subscribe([AccelerationBlock], inbox)
        bus.publish(status("recorder", state="ready"))
        process = multiprocessing.get_context("spawn").Process(
            target=publish_blocks, args=(endpoint, 200)
        )
        process.start()
        received = take(inbox, 200)
        process.join(PATIENCE)
    assert process.exitcode == 0
    assert [message.sequence for message in received] == list(range(200))


def test_what_a_link_dropped_of_a_burst_can_be_had_while_its_publisher_leaves() -> None:
    """A slow link drops messages, and the heartbeat that shows it comes half a second later."""
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus:
        leaving_bus = ZenohBus(peer_of(endpoint))
        for sequence in range(200):
            leaving_bus.publish(block(sequence))  # nobody listens: as good as dropped
        leaving = threading.Thread(target=leaving_bus.close)
        leaving.start()
        inbox = Inbox()
        bus.subscribe([AccelerationBlock], inbox)
        received = take(inbox, 200)
        leaving.join(PATIENCE)
    assert [message.sequence for message in received] == list(range(200))


def test_what_arrives_and_what_is_counted_as_lost_is_what_was_published() -> None:
    n_statuses = 20_000  # far more than a link's queue or the cache of one status holds
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as listening, closing(ZenohBus(peer_of(endpoint))) as bus:
        inbox = Inbox(capacity=2 * n_statuses)
        subscription = listening.subscribe([NodeStatus], inbox)
        listening.publish(status("recorder", state="ready"))
        ready = Inbox()
        hearing = bus.subscribe([NodeStatus], ready)
        take(ready, 1)  # the link is up, somebody listens
        hearing.close()
        take(inbox, 1)
        for sequence in range(n_statuses):
            bus.publish(status("source", last_sequence=sequence))
        heard = []
        while (not heard or heard[-1] < n_statuses - 1) and (message := inbox.get(PATIENCE)):
            heard.append(message.last_sequence)
    assert heard == sorted(set(heard))
    assert heard[-1] == n_statuses - 1
    assert n_statuses - len(heard) == subscription.lost == subscription.lost_of(NodeStatus)


def test_a_beginning_beyond_the_cache_is_lost_to_whoever_subscribed_before_it() -> None:
    """
    published   0 1 2 … 99 100 … 199     the publisher keeps the last 100
    subscribed ┘         link up ┘
    """
    endpoint = free_endpoint()
    with closing(ZenohBus(peer_of(endpoint))) as early:  # nobody there yet
        inbox = Inbox()
        subscription = early.subscribe([WindowRejected], inbox)
        with closing(ZenohBus(hub(endpoint))) as bus:
            for window in range(200):
                bus.publish(rejection(window))
            (first,) = take(inbox, 1)
            heard = [first.window, *(each.window for each in take(inbox, 199 - first.window))]
    assert heard == list(range(heard[0], 200))
    assert subscription.lost == subscription.lost_of(WindowRejected) == heard[0]  # 100, as a rule


def test_who_joins_a_publisher_that_runs_has_lost_nothing_of_what_was_before() -> None:
    kept = stream_of(WindowRejected).cached
    endpoint = free_endpoint()
    with closing(ZenohBus(hub(endpoint))) as bus:
        for window in range(200):
            bus.publish(rejection(window))
        with closing(ZenohBus(peer_of(endpoint))) as late:
            inbox = Inbox()
            subscription = late.subscribe([WindowRejected], inbox)
            heard = [each.window for each in take(inbox, kept)]
            bus.publish(rejection(200))
            heard += [each.window for each in take(inbox, 1)]
    assert heard == list(range(200 - kept, 201))
    assert subscription.lost == 0


def sample_of(number: int, *, published: float, began: float | None) -> Any:
    """As much of a sample as says when it was published and by whom."""
    source = SimpleNamespace(source_id=SimpleNamespace(zid="z", eid=1), source_sn=number)
    moment = SimpleNamespace(as_secs_f64=lambda: published)
    said = None if began is None else SimpleNamespace(to_bytes=lambda: beginning(began))
    return SimpleNamespace(
        key_expr="k",
        source_info=source,
        timestamp=SimpleNamespace(get_time_as_ntp64=lambda: moment),
        attachment=said,
    )


@pytest.mark.parametrize(
    ("since", "began", "lost"),
    [
        (10.0, 20.0, 100),  # there before it began: all that is missing
        (10.0, 10.0, 100),
        (170.0, 20.0, 0),  # came when the oldest that is kept was out: nothing
        (110.0, 20.0, 10),  # came ten seconds before that: ten, at one a second
        (20.5, 20.0, 99),  # came half a second too late for the first
        (10.0, None, 0),  # a publisher that does not say when it began
    ],
)
def test_what_is_lost_of_a_beginning_is_what_was_published_since_the_reader_subscribed(
    since: float, began: float | None, lost: int
) -> None:
    kept = [sample_of(n, published=20.0 + n, began=began) for n in range(100, 150)]
    assert lost_at_beginning(kept, since) == lost


@pytest.mark.parametrize(("kept", "answers", "asked"), [(True, 3, 3), (False, 3, 1), (True, 9, 4)])
def test_an_empty_answer_is_not_believed_at_once_where_something_is_kept(
    monkeypatch: pytest.MonkeyPatch, kept: bool, answers: int, asked: int
) -> None:
    """answers: the number of the one that brings something; before it nobody is known to ask."""
    monkeypatch.setattr(zenoh_arrivals, "PAUSES", (0.0, 0.0, 0.0))
    sample = sample_of(4, published=1.0, began=None)
    tries: list[str] = []

    def get(selector: str, **_: object) -> list[Any]:
        tries.append(selector)
        return [SimpleNamespace(ok=sample)] if len(tries) >= answers else []

    begun: queue.SimpleQueue[list[Any]] = queue.SimpleQueue()
    beginnings = Beginnings(cast(zenoh.Session, SimpleNamespace(get=get)))
    publisher = Publisher("z", 1, "k")
    beginnings.ask(publisher, 5, lambda _, earlier: begun.put(list(earlier)), patient=kept)
    earlier = begun.get(timeout=10.0)
    beginnings.close()
    assert len(tries) == asked
    assert earlier == ([sample] if asked == answers else [])


def refusal(settings: ZenohSettings) -> str:
    with pytest.raises(TransportError) as refused:
        ZenohBus(settings)
    message = str(refused.value)
    assert "\n" not in message
    assert ".rs" not in message  # where in Zenoh it went wrong helps nobody here
    return message


def test_a_port_in_use_is_one_clear_line() -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        endpoint = f"tcp/127.0.0.1:{other.getsockname()[1]}"
        assert refusal(hub(endpoint)).startswith(f"cannot listen on {endpoint}: the port is in use")


def test_a_client_without_a_router_is_one_clear_line() -> None:
    endpoint = free_endpoint()
    message = refusal(ZenohSettings(mode="client", connect=(endpoint,)))
    assert message == f"no Zenoh session answers at {endpoint}; a client needs a router"


def waiting_client(folder: Path, endpoint: str) -> ZenohSettings:
    """A client that waits for its router, as a tower unit does."""
    path = folder / "client.json5"
    path.write_text(
        f'{{mode: "client", connect: {{endpoints: ["{endpoint}"], timeout_ms: -1}}}}',
        encoding="utf-8",
    )
    return ZenohSettings(config_file=path)


def test_a_client_that_waits_for_its_router_ends_when_it_is_asked_to(tmp_path: Path) -> None:
    """Zenoh itself waits in the thread that opens, where no signal is handled meanwhile."""
    endpoint, stopping = free_endpoint(), threading.Event()
    ending = threading.Timer(0.3, stopping.set)
    ending.start()
    began = time.monotonic()
    with pytest.raises(UnreachableError, match=f"no Zenoh session answered at {endpoint}"):
        ZenohBus(waiting_client(tmp_path, endpoint), stopping)
    assert time.monotonic() - began < 5.0


def test_an_endpoint_that_is_none_is_one_clear_line() -> None:
    assert "Endpoints must be of the form" in refusal(ZenohSettings(connect=("localhost",)))


def test_a_configuration_with_an_unknown_key_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    path.write_text("{mode: 'peer', lissten: {}}")
    message = refusal(ZenohSettings(config_file=path))
    assert message.startswith(f"{path} is no Zenoh configuration")
    assert "lissten" in message


def test_a_missing_configuration_is_one_clear_line(tmp_path: Path) -> None:
    path = tmp_path / "zenoh.json5"
    assert refusal(ZenohSettings(config_file=path)) == f"there is no Zenoh configuration {path}"


def test_a_configuration_file_is_used_as_it_is(tmp_path: Path) -> None:
    endpoint = free_endpoint()
    path = tmp_path / "zenoh.json5"
    path.write_text(
        "{mode: 'router', scouting: {multicast: {enabled: false}},"
        f" listen: {{endpoints: ['{endpoint}']}}}}"
    )
    client = ZenohSettings(mode="client", connect=(endpoint,))
    with (
        closing(ZenohBus(ZenohSettings(config_file=path))) as router,
        closing(ZenohBus(client)) as bus,
    ):
        inbox = Inbox()
        router.subscribe([NodeStatus], inbox)
        bus.publish(status("source"))
        assert take(inbox, 1) == [status("source")]


def test_what_was_on_its_way_longer_than_a_heartbeat_counts_as_recovered() -> None:
    published = NTP64(1_717_200_000, 250_000_000)
    sample = SimpleNamespace(timestamp=SimpleNamespace(get_time_as_ntp64=lambda: published))
    assert not is_recovered(sample, 1_717_200_000.25)
    assert not is_recovered(sample, 1_717_200_000.7)
    assert is_recovered(sample, 1_717_200_000.8)
    assert not is_recovered(SimpleNamespace(timestamp=None), 1_717_200_000.8)  # of a stranger


def test_it_is_said_where_nobody_answers_at_an_endpoint(monkeypatch: pytest.MonkeyPatch) -> None:
    told: queue.Queue[str] = queue.Queue()
    monkeypatch.setattr(zenoh_bus.logger, "warning", lambda text, *of: told.put(text % of))
    with closing(ZenohBus(hub(used := free_endpoint()))), closing(ZenohBus(peer_of(used))) as bus:
        end = time.monotonic() + PATIENCE
        while not bus.links() and time.monotonic() < end:
            time.sleep(0.01)
        bus._say_if_alone((used,))
        assert told.empty()
    monkeypatch.setattr(zenoh_bus, "ALONE", 0.1)
    with closing(ZenohBus(peer_of(free := free_endpoint()))):
        assert free in told.get(timeout=PATIENCE)
    bus._say_if_alone((used,))  # a timer that the closing was a moment late for
