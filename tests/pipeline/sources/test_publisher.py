"""A source that only publishes gives its links time before it sends as fast as it can."""

from pipeline.sources.publisher import LINKS_SETTLE, settled
from tests.pipeline.example_messages import block


def test_the_links_are_waited_for_once_when_every_unit_has_sent_its_first_block() -> None:
    first = block(0)
    other = block(0, turbine="t2")
    messages = [first, other, first, other, first]
    done: list[object] = []
    done.extend(settled(messages, done.append))
    assert done == [first, other, LINKS_SETTLE, first, other, first]
