"""One graph, three ways of running it.

    lock-step    one thread: a message goes through the whole graph before the next one
    threads      every node in a thread, with a bus session of its own
    processes    every node in a process, with a bus session of its own

Every message passes the codec and every node gets its messages in the order of publishing in all
three, so the same scenario gives the same posteriors, bit by bit.

A node that reports "ready" has subscribed. The source starts when every node is ready, keeps at
most so many blocks unacknowledged, and the run is over when every message has been handled.
"""

import logging
import threading
import time
from collections.abc import Iterable, Sequence

from pipeline.messages import Message
from pipeline.runtime.source_feed import (
    STOPPED_WITHIN,
    BlockReport,
    RunEnded,
    SourceFeed,
    Worker,
)
from pipeline.transport.bus import Bus
from sensors.arrays import one_blas_thread

logger = logging.getLogger(__name__)

CLOSED_WITHIN = 120.0  # all nodes, when all is handled and nothing presses: files of a slow machine
KEPT_FOR_RECORDER = 4.0  # of that, when the nodes before it have ended [s]
KEPT_FOR_LAST = 1.0  # of that, for what follows the recorder [s]
RECORDER = "recorder"


def run_workers(
    source: Iterable[Message] | None,
    workers: Sequence[Worker],
    bus: Bus,
    *,
    turbine: str,
    unacknowledged_blocks: int | None,
    report: BlockReport | None = None,
    stopping: threading.Event | None = None,
) -> None:
    """Start the workers, give them the source, and stop them in the order of the flow.

    source                  None: live, the instruments publish; runs until `stopping` is set
    unacknowledged_blocks   blocks published ahead of the slowest node; None: never wait
    stopping                ends the run early, with everything closed

    A run whose source has ended has time: a viewer that is killed leaves pictures without an end.

    Raises NodeFailed when a node ends with an exception; the others are closed first.
    """
    ended = stopping or threading.Event()
    patience = STOPPED_WITHIN
    with one_blas_thread():
        for worker in workers:
            worker.start()
        try:
            feed = SourceFeed(bus, workers, ended)
            feed.wait_until_ready()
            if source is None:
                feed.wait(lambda: False)
            else:
                feed.publish(source, turbine, unacknowledged_blocks, report)
            patience = CLOSED_WITHIN
        except RunEnded:
            logger.info("the session was ended early")
        finally:
            deadline = time.monotonic() + patience
            for worker, kept in zip(workers, _kept_for_others(workers), strict=True):
                worker.stop(deadline - kept - time.monotonic())
        for worker in workers:
            worker.check()


def _kept_for_others(workers: Sequence[Worker]) -> list[float]:
    """Return how much of the time in which all stop each leaves to those behind it [s].

    They stop in the order of the flow: the recorder sees the others stop.
    """
    names = [worker.name for worker in workers]
    recorder = names.index(RECORDER) if RECORDER in names else len(names) - 1
    kept = [KEPT_FOR_RECORDER] * recorder + [KEPT_FOR_LAST] * (len(names) - recorder)
    return [*kept[:-1], 0.0]
