"""What is to go out waits on disk until it was taken, in order, whatever happens meanwhile."""

import json
import threading
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from pipeline.monitoring.alarms.channels import DeliveryFailed
from pipeline.monitoring.alarms.outbox import Delivery, Outbox

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

    def send(self, telling: Mapping[str, Any]) -> None:
        self.attempts += 1
        if self.attempts <= self.failures:
            raise DeliveryFailed("away")
        self.taken.append(telling["number"])
        if len(self.taken) == self._until:
            self.all_taken.set()


def test_everything_is_sent_in_order_once_the_outside_is_back(tmp_path: Path) -> None:
    outbox, channel = Outbox(tmp_path), Flaky(failures=4, until=3)
    delivery = Delivery(channel, outbox, PAUSE)
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


def test_what_was_not_taken_waits_for_the_next_session(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path)
    for number in range(3):
        outbox.put({"number": number})
    away = Delivery(Flaky(failures=99, until=1), outbox, PAUSE)
    away.start()
    away.stop(20)
    assert away.problem == "away"
    assert len(outbox.waiting()) == 3

    again, back = Outbox(tmp_path), Flaky(failures=0, until=4)
    again.put({"number": 3})
    delivery = Delivery(back, again, PAUSE)
    delivery.start()
    assert back.all_taken.wait(20)
    delivery.stop(20)

    assert back.taken == [0, 1, 2, 3]


def test_the_oldest_go_where_too_many_wait(tmp_path: Path) -> None:
    outbox = Outbox(tmp_path, most=2)
    for number in range(5):
        outbox.put({"number": number})

    left = [json.loads(path.read_bytes())["number"] for path in outbox.waiting()]
    assert left == [3, 4]
    assert outbox.dropped == 3


def test_a_file_that_is_no_telling_stops_nothing(tmp_path: Path) -> None:
    outbox, channel = Outbox(tmp_path), Flaky(failures=0, until=1)
    (tmp_path / "000000000000.json").write_text("{")
    outbox.put({"number": 1})
    delivery = Delivery(channel, outbox, PAUSE)
    delivery.start()
    delivery.stop(20)

    assert channel.taken == [1]
    assert outbox.waiting() == []
