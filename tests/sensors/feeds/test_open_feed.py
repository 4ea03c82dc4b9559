"""Raw messages of a feed are listened to for as long as is asked."""

import threading
from itertools import count

import pytest

from sensors.feeds import open_feed
from sensors.feeds.protocol import FeedError


@pytest.mark.parametrize("seconds", [1.0, 4.0])
def test_messages_are_captured_until_the_time_is_over(
    monkeypatch: pytest.MonkeyPatch, seconds: float
) -> None:
    """A clock that goes on by a second with every reading; a message a turn."""
    captures: list[open_feed.MessageCapture] = []

    def feed(_: object, capture: open_feed.MessageCapture, *__: object, **___: object) -> None:
        captures.append(capture)

    def turns(*_: object) -> object:
        for number in range(20):
            list(captures[0].read("a/b", b"%d" % number, retained=number == 0))
            yield ()

    clock = count(100.0)
    monkeypatch.setattr(open_feed, "MqttFeed", feed)
    monkeypatch.setattr(open_feed, "batches", turns)
    monkeypatch.setattr(open_feed.time, "monotonic", lambda: next(clock))
    found = open_feed.captured_messages("mqtt://h/a/#", seconds, threading.Event())
    assert [payload for _, payload in found] == [b"%d" % n for n in range(1, int(seconds) + 1)]


def test_a_feed_of_one_format_has_nothing_to_capture() -> None:
    with pytest.raises(FeedError, match="others have one format"):
        open_feed.captured_messages("udp://:5000", 1.0, threading.Event())
