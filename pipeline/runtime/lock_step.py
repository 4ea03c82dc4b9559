"""A run in one thread: every message through the whole graph before the next; and what nodes count
of themselves, whichever runner serves them."""

import logging
import threading
import time
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager

from pipeline.messages import Message, NodeStatus, QualityWarning, message_counts
from pipeline.nodes.node import Node, NodeStatistics, PayloadNode
from pipeline.runtime.source_feed import BlockReport, with_end
from pipeline.transport.codec import decode, encode
from sensors.acquisition.blocks import AccelerationBlock
from sensors.arrays import one_blas_thread

logger = logging.getLogger(__name__)


class NodeAccount:
    """Counts what a node takes and gives, and how long it is busy.

    Parameters
    ----------
    node : Node
        The node.
    turbine : str
        Id that the status is published under.
    clock : callable
        → time [ns since 1970]; an argument, so that nodes and tests need none.
    """

    def __init__(self, node: Node, turbine: str, clock: Callable[[], int]) -> None:
        self.node = node
        self.last_sequence = -1  # of the acceleration blocks handled
        self._keeper = node if isinstance(node, PayloadNode) else None
        self._turbine = turbine
        self._clock = clock
        self._received: Counter[str] = Counter()
        self._published: Counter[str] = Counter()
        self._busy_ns = 0

    @property
    def handled(self) -> int:
        """Messages that the node has taken; statuses, which would beget statuses, do not count."""
        return self._received.total() - self._received[NodeStatus.__name__]

    def handle(self, message: Message, payload: bytes | None = None) -> Iterator[Message]:
        """Yield the node's answers to one message, in order, each as soon as the node gives it.

        Parameters
        ----------
        message : Message
            The next one.
        payload : bytes, optional
            The bytes that it came in, where they are known.

        Notes
        -----
        What a node does after its last answer, such as writing a checkpoint, it does when that
        answer has been passed on. The message counts as taken when the answers are exhausted.
        """
        with self._busy():  # a node that answers nothing works here
            answers = iter(self._answers(message, payload))
        while (answer := self._next(answers)) is not None:
            self._published[type(answer).__name__] += 1
            yield answer
        self._received[type(message).__name__] += 1
        if isinstance(message, AccelerationBlock):
            self.last_sequence = message.sequence

    def _answers(self, message: Message, payload: bytes | None) -> Iterable[Message]:
        if payload is not None and self._keeper is not None:
            return self._keeper.handle_payload(message, payload)
        return self.node.handle(message)

    def _next(self, answers: Iterator[Message]) -> Message | None:
        with self._busy():
            return next(answers, None)

    @contextmanager
    def _busy(self) -> Iterator[None]:
        """Counts the time that it takes."""
        started = self._clock()
        try:
            yield
        finally:
            self._busy_ns += max(0, self._clock() - started)

    def status(
        self,
        state: str,
        *,
        lost: int = 0,
        recovered: int = 0,
        malformed: int = 0,
        refusal: str = "",
    ) -> NodeStatus:
        """Return what the node reports of itself now.

        Parameters
        ----------
        state : str
            Of the node.
        lost : int, optional
            Blocks that its subscription knows to be lost.
        recovered : int, optional
            Blocks that came when their link was back.
        malformed : int, optional
            Messages that were dropped before they reached it.
        refusal : str, optional
            Of the last of them: where it came and what was wrong.
        """
        counts: NodeStatistics = self.node.statistics
        warnings = counts.warnings
        if malformed:
            warnings += (
                QualityWarning("malformed", f"messages were dropped, the last one {refusal}"),
            )
        return NodeStatus(
            turbine=self._turbine,
            node=self.node.name,
            time_ns=self._clock(),
            state=state,
            last_sequence=self.last_sequence,
            received=message_counts(self._received),
            published=message_counts(self._published),
            lost=lost + counts.lost,
            late=counts.late,
            duplicate=counts.duplicate,
            busy_s=self._busy_ns * 1e-9,
            warnings=warnings,
            malformed=malformed,
            recovered=recovered,
            recorded=counts.recorded,
            refused=message_counts(counts.rejected),
        )


def run_lock_step(
    source: Iterable[Message],
    nodes: Sequence[Node],
    *,
    turbine: str,
    report: BlockReport | None = None,
    stopping: threading.Event | None = None,
) -> None:
    """Every message through the whole graph before the next; deterministic, without transport.

    When `stopping` is set, the message before was the last one.
    """
    accounts = [NodeAccount(node, turbine, time.time_ns) for node in nodes]
    with one_blas_thread():
        for message in with_end(source):
            if stopping is not None and stopping.is_set():
                logger.info("the session was ended early")
                break
            _dispatch(message, accounts)
            if report and isinstance(message, AccelerationBlock):
                report(message)
        for account in accounts:
            _dispatch(account.status("stopped"), accounts)
    for account in accounts:
        account.node.close()


def _dispatch(message: Message, accounts: Sequence[NodeAccount]) -> None:
    waiting = deque([message])
    while waiting:
        message = waiting.popleft()
        payload = encode(message)
        for account in accounts:
            if type(message) in account.node.inputs:
                waiting.extend(account.handle(decode(type(message), payload), payload))
