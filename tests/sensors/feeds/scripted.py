"""A feed that gives what a test has written down, and how tests listen to any feed."""

import asyncio
import threading
import time
from collections.abc import Callable, Sequence

from sensors.feeds.live import LiveFeed, Measured
from sensors.feeds.protocol import Arrival, ArrivalQueue, FeedCounts

PATIENCE = 90.0  # before a test gives up [s]


class ScriptedFeed:
    """Gives its arrivals, then does what `then` says, then waits."""

    def __init__(
        self, arrivals: Sequence[Arrival], then: Callable[[], object] = lambda: None
    ) -> None:
        self.name = "scripted"
        self.counts = FeedCounts()
        self._arrivals, self._then = arrivals, then

    async def run(self, inbox: ArrivalQueue) -> None:
        self.counts.connected = True
        for arrival in self._arrivals:
            self.counts.received += 1
            await inbox.put(arrival)
        while not inbox.empty():
            await asyncio.sleep(0)
        self._then()
        await asyncio.Event().wait()


def measured_until(
    live: LiveFeed,
    done: Callable[[], bool],
    act: Callable[[], object] = lambda: None,
    again: Callable[[], object] = lambda: None,
) -> list[Measured]:
    """What a feed gives.

    done    looked at in between; ends the listening when True
    act     called once, when the feed is connected
    again   called when it is connected for the second time
    """
    stopping = threading.Event()
    acts = [act, again]
    given: list[Measured] = []
    deadline = time.monotonic() + PATIENCE
    for each in live.measured(stopping):
        if each is not None:
            given.append(each)
            continue
        while live.counts.connected and acts and live.counts.connections > 2 - len(acts):
            acts.pop(0)()
        if done():
            stopping.set()
        if time.monotonic() > deadline:
            raise TimeoutError(f"{live.counts}")
    return given
