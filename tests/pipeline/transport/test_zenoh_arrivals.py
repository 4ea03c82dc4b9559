"""What was published before the first sample that arrived comes before it, once."""

import queue
from types import SimpleNamespace
from typing import Any, cast

import zenoh

from pipeline.transport.zenoh_arrivals import Beginnings, Publisher
from tests.pipeline.transport.test_zenoh_bus import sample_of


def fetched_before(first_number: int, replies: list[Any]) -> list[int]:
    """Numbers that are passed on, where caches answer with these samples."""
    begun: queue.SimpleQueue[list[Any]] = queue.SimpleQueue()
    session = SimpleNamespace(get=lambda *_, **__: [SimpleNamespace(ok=each) for each in replies])
    beginnings = Beginnings(cast(zenoh.Session, session))
    publisher = Publisher("z", 1, "k")
    beginnings.ask(publisher, first_number, lambda _, e: begun.put(list(e)), patient=False)
    earlier = begun.get(timeout=10.0)
    beginnings.close()
    return [sample.source_info.source_sn for sample in earlier]


def sent(number: int) -> Any:
    return sample_of(number, published=100.0 + number, began=100.0)


def test_the_sample_that_arrived_is_not_fetched_a_second_time() -> None:
    """A cache that answers with more than was asked for makes no duplicate."""
    assert fetched_before(4, [sent(number) for number in range(7)]) == [0, 1, 2, 3]


def test_answers_of_several_caches_come_in_order_and_once() -> None:
    replies = [sent(2), sent(0), sent(1), sent(2), sent(0)]
    assert fetched_before(3, replies) == [0, 1, 2]


def test_what_another_publisher_sent_is_left_to_its_own_beginning() -> None:
    stranger = sent(1)
    stranger.source_info.source_id.zid = "another"
    assert fetched_before(3, [sent(0), stranger, sent(2)]) == [0, 2]


def test_a_cache_that_answers_with_an_error_leaves_the_others_standing() -> None:
    begun: queue.SimpleQueue[list[Any]] = queue.SimpleQueue()
    replies = [SimpleNamespace(ok=None), SimpleNamespace(ok=sent(0))]
    beginnings = Beginnings(cast(zenoh.Session, SimpleNamespace(get=lambda *_, **__: replies)))
    beginnings.ask(Publisher("z", 1, "k"), 1, lambda _, e: begun.put(list(e)), patient=False)
    assert len(begun.get(timeout=10.0)) == 1
    beginnings.close()
