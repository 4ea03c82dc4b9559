"""A link that is away is tried again, at first at once and never later than after half a minute."""

import asyncio

import pytest

from sensors.feeds.protocol import FeedCounts, FeedError
from sensors.feeds.reconnect import LinkError, kept_connected


class EnoughWaits(Exception):  # noqa: N818  # ends the test
    """The link was tried often enough."""


def test_pauses_double_from_half_a_second_to_thirty(monkeypatch: pytest.MonkeyPatch) -> None:
    waits: list[float] = []

    async def waited(seconds: float) -> None:
        waits.append(seconds)
        if len(waits) == 12:
            raise EnoughWaits

    async def away() -> None:
        raise LinkError("no route")

    monkeypatch.setattr("sensors.feeds.reconnect.asyncio.sleep", waited)
    counts = FeedCounts()
    with pytest.raises(EnoughWaits):
        asyncio.run(kept_connected(away, "feed", counts, once=False))
    assert waits == [0.5, 1, 2, 4, 8, 16, 30, 30, 30, 30, 30, 30]
    assert counts.problem == "no route"


def test_a_link_that_is_tried_once_is_given_up_where_its_first_session_cannot_connect() -> None:
    async def away() -> None:
        raise LinkError("no route")

    with pytest.raises(FeedError, match="feed cannot be reached: no route"):
        asyncio.run(asyncio.wait_for(kept_connected(away, "feed", FeedCounts(), once=True), 0.2))


def test_a_link_that_is_made_again_was_there_before() -> None:
    counts = FeedCounts()
    assert [counts.connect() for _ in range(3)] == [False, True, True]
