"""An alarm message waits on disk until it is delivered, in order, whatever happens meanwhile."""

import http.client
import threading
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from pipeline.monitoring.alarms.channels import DeliveryFailed
from pipeline.monitoring.alarms.outbox import (
    MOST_REFUSALS,
    REFUSED_DELIVERY,
    DeliveryThread,
    Outbox,
    WaitingMessage,
    decoded_waiting,
)

PAUSE = 0.001  # between attempts [s]


class Flaky:
    """A channel that is away for its first attempts."""

    name = "flaky"

    def __init__(self, failures: int, until: int) -> None:
        self.failures = failures
        self.taken: list[int] = []
        self.attempts = 0
        self.all_taken = threading.Event()
        self._until = until

    def send(self, message: Mapping[str, Any], recipients: tuple[str, ...] = ()) -> None:
        self.attempts += 1
        if self.attempts <= self.failures:
            raise DeliveryFailed("away")
        self.taken.append(message["number"])
        if len(self.taken) == self._until:
            self.all_taken.set()


def test_everything_is_sent_in_order_once_the_outside_is_back(tmp_path: Path) -> None:
    outbox, channel = Outbox(tmp_path), Flaky(failures=4, until=3)
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    for number in range(3):
        outbox.put({"number": number})
        delivery.wake()
    assert channel.all_taken.wait(20)
    delivery.stop(20)

    assert channel.taken == [0, 1, 2]
    assert channel.attempts == 7
    assert outbox.waiting() == []
    assert delivery.problem == ""


def test_a_receiver_that_was_away_for_long_has_its_messages_soon_after_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Pauses double up to the longest: of twenty attempts the last would wait a quarter hour."""
    monkeypatch.setattr("pipeline.monitoring.alarms.outbox.LONGEST_PAUSE", 4 * PAUSE)
    outbox, channel = Outbox(tmp_path), Flaky(failures=20, until=1)
    outbox.put({"number": 0})
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    assert channel.all_taken.wait(20)
    delivery.stop(20)


def test_what_was_not_taken_waits_for_the_next_session(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    for number in range(3):
        outbox.put({"number": number})
    away = DeliveryThread(Flaky(failures=99, until=1), outbox, PAUSE)
    away.start()
    away.stop(20)
    assert away.problem == "away"
    assert len(outbox.waiting()) == 3

    again, back = Outbox(tmp_path), Flaky(failures=0, until=4)
    again.put({"number": 3})
    delivery = DeliveryThread(back, again, PAUSE)
    delivery.start()
    assert back.all_taken.wait(20)
    delivery.stop(20)

    assert back.taken == [0, 1, 2, 3]


def test_messages_of_an_earlier_version_and_of_a_clock_that_was_set_back_keep_their_order(
    tmp_path: Path,
) -> None:
    """They were numbered from 1 on, with twelve digits."""
    (tmp_path / "000000000017.json").write_bytes(WaitingMessage({"number": 0}, 5).encoded())
    for number, clock_ns in enumerate((9_000_000, 4_000, 9_000_000), start=1):
        Outbox(tmp_path, clock=lambda now_ns=clock_ns: now_ns).put({"number": number})

    waiting = [decoded_waiting(each.read_bytes()) for each in Outbox(tmp_path).waiting()]
    assert [each.message["number"] for each in waiting] == [0, 1, 2, 3]
    assert [each.message.get("serial") for each in waiting] == [None, 9000, 9001, 9002]


def test_the_oldest_go_where_too_many_wait(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path, most=2)
    for number in range(5):
        outbox.put({"number": number})

    left = [decoded_waiting(path.read_bytes()).message["number"] for path in outbox.waiting()]
    assert left == [3, 4]
    assert outbox.dropped == 3


def test_a_file_that_is_no_message_stops_nothing(tmp_path: Path) -> None:
    outbox, channel = Outbox(tmp_path), Flaky(failures=0, until=1)
    (tmp_path / "000000000000.json").write_text("{")
    outbox.put({"number": 1})
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    delivery.stop(20)

    assert channel.taken == [1]
    assert outbox.waiting() == []


class Scripted:
    """A channel that raises what it is given, then delivers."""

    name = "scripted"

    def __init__(self, *failures: Exception) -> None:
        self.failures = list(failures)
        self.refused: dict[int, DeliveryFailed] = {}  # by number, however often it is sent
        self.sent: list[tuple[int, tuple[str, ...]]] = []

    def send(self, message: Mapping[str, Any], recipients: tuple[str, ...] = ()) -> None:
        if message["number"] in self.refused:
            raise self.refused[message["number"]]
        if self.failures:
            raise self.failures.pop(0)
        self.sent.append((message["number"], recipients))


def test_no_error_of_a_channel_ends_its_thread(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    channel = Scripted(http.client.BadStatusLine("x"), KeyError("turbine"), RecursionError())
    outbox.put({"number": 1})
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    deadline = time.monotonic() + 20
    while outbox.waiting() and time.monotonic() < deadline:
        delivery.wake()
    alive = delivery.is_alive()
    delivery.stop(20)

    assert alive
    assert channel.sent == [(1, ())]
    assert delivery.state().failed == 3


def test_a_message_that_is_refused_for_itself_holds_up_no_other(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    channel = Scripted()
    channel.refused = {1: DeliveryFailed("400", message_only=True)}
    outbox.put({"number": 1})
    outbox.put({"number": 2})
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    delivery.stop(20)

    assert channel.sent == [(2, ())]
    assert delivery.problem == "400"


def test_only_the_recipients_that_were_refused_are_tried_again(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    outbox.put({"number": 1})
    partly = DeliveryFailed("550", message_only=True, remaining=("b@example.org",))
    refusing = Scripted()
    refusing.refused = {1: partly}
    first = DeliveryThread(refusing, outbox, PAUSE)
    first.start()
    first.stop(20)
    channel = Scripted()
    again = DeliveryThread(channel, Outbox(tmp_path), PAUSE)
    again.start()
    again.stop(20)

    assert channel.sent == [(1, ("b@example.org",))]


def test_a_message_that_is_refused_many_times_is_set_aside_and_reported(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path, clock=lambda: 7000)
    outbox.put({"number": 1})
    channel = Scripted()
    channel.refused = {1: DeliveryFailed("550", message_only=True)}
    delivery = DeliveryThread(channel, outbox, PAUSE)
    delivery.start()
    deadline = time.monotonic() + 20
    while outbox.waiting() and time.monotonic() < deadline:
        delivery.wake()
    delivery.stop(20)

    assert outbox.waiting() == []
    (aside,) = (tmp_path / REFUSED_DELIVERY).iterdir()
    assert aside.name == "0000000000000007.json"
    assert delivery.state().refused == 1
    assert Outbox(tmp_path)._next == 8  # its number is not given again


def test_a_burst_of_messages_uses_up_no_attempts_of_those_that_are_refused(tmp_path: Path) -> None:
    """Of a server that greylists: each new message is tried at once, the others after a pause."""
    outbox = Outbox(tmp_path)
    channel = Scripted()
    channel.refused = {
        number: DeliveryFailed("451", message_only=True) for number in range(MOST_REFUSALS + 3)
    }
    delivery = DeliveryThread(channel, outbox, pause=1000.0)
    delivery.start()
    deadline = time.monotonic() + 20
    for number in channel.refused:
        outbox.put({"number": number})
        delivery.wake()
        while delivery.state().failed <= number and time.monotonic() < deadline:
            delivery.wake()
    delivery.stop(20)

    assert len(outbox.waiting()) == len(channel.refused)
    assert delivery.state().refused == 0
    assert delivery.state().failed == len(channel.refused)
    assert delivery.problem == "451"


def test_the_age_of_what_waits_is_known(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path, clock=lambda: 5 * 10**9)
    outbox.put({"number": 1})

    assert Outbox(tmp_path, clock=lambda: 65 * 10**9).age() == 60.0


def test_a_message_of_an_earlier_version_is_read(tmp_path: Path) -> None:
    waiting = decoded_waiting(b'{"text": "t", "last_ns": 7}')

    assert waiting == WaitingMessage({"text": "t", "last_ns": 7}, 7)


def test_an_outbox_is_as_old_as_its_oldest_message_and_an_empty_one_is_new(tmp_path: Path) -> None:
    now_ns = [5 * 10**9]
    outbox = Outbox(tmp_path, clock=lambda: now_ns[0])
    assert outbox.age() == 0.0
    outbox.put({"number": 1})
    now_ns[0] += 2 * 10**9
    outbox.put({"number": 2})
    assert outbox.age() == 2.0
