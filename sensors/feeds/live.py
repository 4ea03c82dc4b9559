"""A feed as an iterator: what a source is for everybody else."""

import asyncio
import threading
from collections.abc import Iterator

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.scada import ScadaSample
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.position import FeedPosition
from sensors.feeds.protocol import Arrival, ArrivalQueue, ChannelSamples, Feed, FeedCounts

TICK = 0.1  # how often the clock may be looked at, when nothing comes [s]

Measured = AccelerationBlock | ScadaSample


class LiveFeed:
    """One instrument: its feed, and what puts its channels together.

    Parameters
    ----------
    feed : Feed
        Of the instrument.
    assembler : Assembler or None
        None: the feed gives no accelerations.
    position : FeedPosition, optional
        How far the source was published before.
    """

    def __init__(
        self, feed: Feed, assembler: Assembler | None, position: FeedPosition | None = None
    ) -> None:
        self._feed, self._assembler = feed, assembler
        self._position = position or FeedPosition(None)

    @property
    def name(self) -> str:
        """The feed's."""
        return self._feed.name

    @property
    def counts(self) -> FeedCounts:
        """What was received and what was not."""
        return self._feed.counts

    @property
    def gives_blocks(self) -> bool:
        """Whether it measures accelerations; otherwise it is the controller's."""
        return self._assembler is not None

    @property
    def port(self) -> int:
        """Port that the feed listens on; 0 where it connects to others."""
        return int(getattr(self._feed, "port", 0))

    @property
    def missing_blocks(self) -> int:
        """Blocks that the gaps so far cost."""
        return self._assembler.missing_blocks if self._assembler else 0

    def measured(self, stopping: threading.Event) -> Iterator[Measured | None]:
        """Blocks and SCADA samples as they come, until `stopping` is set; None in between, about
        ten times a second, so that the caller can see to other things.

        Raises FeedError; see Feed.
        """
        for batch in batches(self._feed, stopping):
            for arrival in batch:
                yield from self._taken(arrival)
            self._position.settle()
            yield None
        if self._assembler is not None:
            yield from self._published(self._assembler.finish())
        self._position.save()

    def take_kept(self, start_ns: int, end_ns: int) -> None:
        """Take note of the last block that is kept to be sent again, from before a restart.

        Parameters
        ----------
        start_ns, end_ns : int
            Its samples' times [ns since 1970-01-01 UTC].
        """
        self._position.has_published(start_ns, end_ns)

    @property
    def absent(self) -> float:
        """Measured time before a restart that the source no longer had [s]."""
        return self._position.absent_ns / NANOSECONDS

    def _taken(self, arrival: Arrival) -> Iterator[Measured]:
        if not isinstance(arrival, ChannelSamples):
            yield arrival
        elif self._assembler is not None:
            piece = self._position.unpublished(arrival)
            if piece is not None:
                yield from self._published(self._assembler.push(piece))

    def _published(self, blocks: Iterator[AccelerationBlock]) -> Iterator[AccelerationBlock]:
        """The position moves when the caller comes back for more: then a block is published."""
        for block in blocks:
            period_ns = NANOSECONDS / block.sampling_rate
            self._position.publishing(block.start_ns, block.end_ns, period_ns)
            yield block
            self._position.published(block.start_ns, block.end_ns, period_ns)


def batches(feed: Feed, stopping: threading.Event) -> Iterator[list[Arrival]]:
    """Yield what a feed gives, in order, some at a time, or nothing after a TICK.

    The feed runs in this thread, whenever the next batch is asked for, and is closed at the end.
    """
    inbox = ArrivalQueue()
    with asyncio.Runner() as runner:
        loop = runner.get_loop()  # its own `run` prints every batch, to set a signal's handler
        running = loop.create_task(feed.run(inbox))
        try:
            while not stopping.is_set():
                batch = loop.run_until_complete(_next_batch(inbox))
                if batch:
                    yield batch
                elif running.done():
                    running.result()  # raises what ended it
                    return
                else:
                    yield []
        finally:
            running.cancel()
            loop.run_until_complete(_ended(running))
        yield _waiting(inbox)


async def _next_batch(inbox: ArrivalQueue) -> list[Arrival]:
    try:
        first = await asyncio.wait_for(inbox.get(), TICK)
    except TimeoutError:
        return []
    return [first, *_waiting(inbox)]


def _waiting(inbox: ArrivalQueue) -> list[Arrival]:
    taken = []
    while not inbox.empty():
        taken.append(inbox.get_nowait())
    return taken


async def _ended(running: "asyncio.Task[None]") -> None:
    await asyncio.wait({running})
