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
KEPT_FOR_VIEWER = 1.0  # of that, when the recorder has ended [s]
RECORDER, VIEWER = "recorder", "viewer"


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

    Parameters
    ----------
    source : iterable of Message or None
        None: live, the instruments publish; runs until `stopping` is set.
    workers : sequence of Worker
        In the order of the flow.
    bus : Bus
        That the source is published on.
    turbine : str
        In the source's statuses.
    unacknowledged_blocks : int or None
        Blocks published ahead of the slowest node; None: never wait.
    report : callable, optional
        Called with each block that is published.
    stopping : threading.Event, optional
        Ends the run early, with everything closed.

    Raises
    ------
    NodeFailed
        If a node ends with an exception; the others are closed first.

    Notes
    -----
    A run whose source has ended has time: a viewer that is killed leaves pictures without an end.
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
            _stop(workers, time.monotonic() + patience)
        for worker in workers:
            worker.check()


def _stop(workers: Sequence[Worker], deadline: float) -> None:
    """Stop in the order of the flow: the recorder sees the nodes before it stop.

    They leave it KEPT_FOR_RECORDER. The viewer, whose answers nothing records, stops behind it and
    has at least KEPT_FOR_VIEWER.
    """
    recorder = [each for each in workers if each.name == RECORDER]
    viewer = [each for each in workers if each.name == VIEWER]
    others = [each for each in workers if each.name not in (RECORDER, VIEWER)]
    _stop_in_turn(others, deadline - (KEPT_FOR_RECORDER if recorder else 0.0))
    _stop_in_turn(recorder, deadline - (KEPT_FOR_VIEWER if viewer else 0.0))
    _stop_in_turn(viewer, deadline)


def _stop_in_turn(workers: Sequence[Worker], deadline: float) -> None:
    """Ask one after the other; each has a share of the time before the next one is asked.

    One that computes longer goes on beside those after it: at the end of a window the first nodes
    have seconds of work.
    """
    for asked, worker in enumerate(workers):
        worker.ask_to_stop()
        worker.has_ended((deadline - time.monotonic()) / (len(workers) - asked))
    for worker in workers:
        if not worker.has_ended(deadline - time.monotonic()):
            worker.abandon()
