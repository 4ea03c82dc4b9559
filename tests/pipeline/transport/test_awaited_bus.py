"""A bus whose session opens later, or never."""

import threading
from collections.abc import Callable

import pytest

from pipeline.messages import RecordedUntil
from pipeline.transport.awaited_bus import AwaitedBus
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.errors import UnreachableError
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import block
from tests.pipeline.transport.memory_bus import MemoryBus
from tests.pipeline.transport.test_bus import PATIENCE, take

KEPT = 1200  # blocks, as of a link that is cut


class Shore:
    """A bus that opens when it is told to."""

    def __init__(self) -> None:
        self.bus, self.inbox, self.may_open = MemoryBus(), Inbox(), threading.Event()
        self.bus.subscribe([AccelerationBlock], self.inbox)
        self.failure: Exception | None = None

    def open(self, abandoned: threading.Event) -> Bus:
        while not self.may_open.wait(0.01):
            if abandoned.is_set():
                raise UnreachableError("given up")
        if self.failure is not None:
            raise self.failure
        return self.bus


def settled(awaited: AwaitedBus) -> None:
    """Return when what opens the bus has ended."""
    for thread in threading.enumerate():
        if thread.name == "opening":
            thread.join(PATIENCE)
    assert awaited


def test_what_is_published_before_the_session_opens_arrives_in_its_order() -> None:
    shore = Shore()
    awaited = AwaitedBus(shore.open, patience=0.0)
    acknowledged = Inbox()
    subscription = awaited.subscribe([RecordedUntil], acknowledged)
    for sequence in range(KEPT + 3):
        awaited.publish(block(sequence))
    assert len(shore.inbox) == 0
    assert (subscription.lost, subscription.lost_of(RecordedUntil)) == (0, 0)
    shore.may_open.set()
    settled(awaited)
    awaited.publish(block(KEPT + 3))
    heard = take(shore.inbox, KEPT + 1)
    assert [each.sequence for each in heard] == list(range(3, KEPT + 4))
    shore.bus.publish(RecordedUntil("t1", "tower", "s", 3, ()))
    assert len(acknowledged) == 1
    subscription.close()
    shore.bus.publish(RecordedUntil("t1", "tower", "s", 4, ()))
    assert len(acknowledged) == 1
    awaited.close()


def test_what_was_kept_is_sent_at_the_end_too() -> None:
    shore = Shore()
    awaited = AwaitedBus(shore.open, patience=0.0)
    awaited.publish(block(0))
    heard: list[object] = []
    close: Callable[[], None] = shore.bus.close
    shore.bus.close = lambda: (heard.extend(take(shore.inbox, 1)), close())  # type: ignore[assignment,method-assign,func-returns-value]
    shore.may_open.set()
    settled(awaited)
    awaited.close()
    assert len(heard) == 1


def test_a_session_that_never_opens_is_left_and_what_it_cost_is_logged(
    caplog: pytest.LogCaptureFixture,
) -> None:
    awaited = AwaitedBus(Shore().open, patience=0.0)
    for sequence in range(3):
        awaited.publish(block(sequence))
    awaited.close()
    assert caplog.messages == ["no session was opened; 3 messages were not sent"]


@pytest.mark.parametrize("patience", [0.0, PATIENCE])
def test_why_a_session_does_not_open_is_raised_to_who_publishes(patience: float) -> None:
    shore = Shore()
    shore.failure = UnreachableError("no router")
    if patience:
        shore.may_open.set()
        with pytest.raises(UnreachableError, match="no router"):
            AwaitedBus(shore.open, patience=patience)
        return
    awaited = AwaitedBus(shore.open, patience=0.0)
    shore.may_open.set()
    settled(awaited)
    with pytest.raises(UnreachableError, match="no router"):
        awaited.publish(block(0))
    awaited.close()
