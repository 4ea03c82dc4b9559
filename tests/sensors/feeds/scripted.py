"""A feed that gives what a test has written down."""

import asyncio
from collections.abc import Callable, Sequence

from sensors.feeds.feed import Arrival, FeedCounts, Inbox


class ScriptedFeed:
    """Gives its arrivals, then does what `then` says, then waits."""

    def __init__(
        self, arrivals: Sequence[Arrival], then: Callable[[], object] = lambda: None
    ) -> None:
        self.name = "scripted"
        self.counts = FeedCounts()
        self._arrivals, self._then = arrivals, then

    async def run(self, inbox: Inbox) -> None:
        self.counts.connected = True
        for arrival in self._arrivals:
            self.counts.received += 1
            await inbox.put(arrival)
        while not inbox.empty():
            await asyncio.sleep(0)
        self._then()
        await asyncio.Event().wait()
