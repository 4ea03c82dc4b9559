"""A node served in a thread: its messages in, its answers and statuses out."""

import ctypes
import logging
import math
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from pipeline.nodes.node import Node
from pipeline.runtime.errors import NodeFailed
from pipeline.runtime.lock_step import NodeAccount
from pipeline.transport.bus import Bus, Inbox
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError

logger = logging.getLogger(__name__)

STATUS_PERIOD = 1.0  # longest time between two statuses of a running node [s]
STATUS_BLOCKS = 16  # a status at the latest after so many blocks, so that the source can go on
DRAINED_WITHIN = 1.0  # what a node has received when it is asked to stop [s]
LEAST_PATIENCE = 0.2  # with the last of them [s]
SILENT_SESSION = 10.0  # without a message, after which a listener logs it [s]
TRIM_PERIOD = 60.0  # between two returns of freed memory [s]


class FreedMemory:
    """Returns to the system what this process has freed, at most once in `TRIM_PERIOD`.

    A window of samples leaves as many short-lived arrays as long-lived results; glibc's allocator
    keeps the holes between them for later, and a node that runs for months grows by them. Other C
    libraries return them by themselves. It takes some milliseconds. Source: malloc_trim(3).
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._next = clock() + TRIM_PERIOD
        self._trim = _allocator_trim()

    def give_back(self) -> bool:
        """Return it if it is time to; report whether it was."""
        if self._clock() < self._next:
            return False
        self._trim(0)
        self._next = self._clock() + TRIM_PERIOD
        return True


def _allocator_trim() -> Callable[[int], object]:
    """Return the allocator's own function; one that does nothing where there is none."""
    try:
        trim: Callable[[int], object] = ctypes.CDLL(None).malloc_trim
    except (AttributeError, OSError, TypeError):  # musl, macOS; Windows
        return lambda _: None
    return trim


class NodeThread(threading.Thread):
    """Serves one node until it is stopped; keeps the exception that ended it, if one did."""

    restarts = 0  # a thread that fails ends the session: what it shares may be broken

    def __init__(self, node: Node, open_bus: Callable[[], Bus], turbine: str) -> None:
        super().__init__(name=node.name, daemon=True)
        self.inputs = tuple(node.inputs)
        self._node = node
        self._failure: BaseException | None = None
        self._open_bus = open_bus
        self._turbine = turbine
        self._stopping = threading.Event()

    def run(self) -> None:
        """The thread's work; see `serve`."""
        try:
            with open_session(self._open_bus) as bus:
                serve(self._node, bus, turbine=self._turbine, stopping=self._stopping)
        except BaseException as error:  # noqa: BLE001  # `check` raises it to its caller
            self._failure = error

    def check(self) -> None:
        """Raise what ended the node."""
        if isinstance(self._failure, InputError):
            raise self._failure
        if self._failure is not None:
            raise NodeFailed(f"node {self.name} failed: {self._failure!r}") from self._failure

    def ask_to_stop(self) -> None:
        """Let the node finish what it has and close its files."""
        self._stopping.set()

    def has_ended(self, within: float) -> bool:
        """Wait for the node's end, not for longer [s]; report whether it came."""
        self.join(max(within, LEAST_PATIENCE))
        return not self.is_alive()

    def abandon(self) -> None:
        """Say that it is busy; the thread ends with its process."""
        logger.error(
            "node %s is busy and does not stop; what it has not answered is recorded", self.name
        )


def busy_nodes() -> list[str]:
    """Names of nodes whose threads did not stop when they were asked to."""
    return [each.name for each in threading.enumerate() if isinstance(each, NodeThread)]


def serve(
    node: Node,
    bus: Bus,
    *,
    turbine: str,
    stopping: threading.Event,
    monotonic: Callable[[], float] = time.monotonic,
) -> None:
    """Give a node its messages and publish its answers, until `stopping` is set and all is done.

    Parameters
    ----------
    node : Node
        To be served.
    bus : Bus
        That messages come and answers go by.
    turbine : str
        In the node's statuses.
    stopping : threading.Event
        Ends it.
    monotonic : callable, optional
        Clock of the freed memory [s].

    Notes
    -----
    What is not done DRAINED_WITHIN after that is left: a node that is started again finds it where
    it is recorded.
    """
    account = NodeAccount(node, turbine, time.time_ns)
    inbox = Inbox()
    subscription = bus.subscribe(node.inputs, inbox)
    beat = Heartbeat(time.time_ns)
    freed = FreedMemory(monotonic)

    def publish_status(state: str) -> None:
        bus.publish(
            account.status(
                state,
                lost=subscription.lost_of(AccelerationBlock) + inbox.dropped_of(AccelerationBlock),
                recovered=subscription.recovered_of(AccelerationBlock),
                malformed=inbox.malformed,
                refusal=inbox.refusal,
            )
        )
        beat.reported(account)

    publish_status("ready")
    asked: float | None = None  # when it was asked to stop [s]
    try:
        while True:
            message = inbox.get(timeout=0.05)
            if message is not None:
                for answer in account.handle(message, inbox.payload):
                    bus.publish(answer)
            if beat.due(account, idle=message is None):
                publish_status("running")
                freed.give_back()
            if not stopping.is_set():
                continue
            asked = monotonic() if asked is None else asked
            if message is None:
                break
            if monotonic() - asked > DRAINED_WITHIN:
                logger.warning("%s ends with %d messages not taken", node.name, len(inbox))
                break
    finally:
        node.close()
        publish_status("stopped")
        subscription.close()


class Heartbeat:
    """When a node should report: every second, every few blocks, when it has caught up."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._reported_ns = 0
        self._reported_messages = -1
        self._reported_sequence = -1

    def reported(self, account: NodeAccount) -> None:
        """Remember what the last status reported."""
        self._reported_ns = self._clock()
        self._reported_messages = account.handled
        self._reported_sequence = account.last_sequence

    def due(self, account: NodeAccount, *, idle: bool) -> bool:
        """Whether it is time for the next status."""
        if self._clock() - self._reported_ns > STATUS_PERIOD * 1e9:
            return True
        if idle:
            return account.handled != self._reported_messages
        return account.last_sequence - self._reported_sequence >= STATUS_BLOCKS


@contextmanager
def open_session(open_bus: Callable[[], Bus]) -> Iterator[Bus]:
    """A bus session that is closed whatever happens."""
    bus = open_bus()
    try:
        yield bus
    finally:
        bus.close()


def listened(node: Node, bus: Bus, stopping: threading.Event, *, where: str) -> None:
    """Give a sink every message until `stopping` is set; log if none comes in time.

    Nothing is published: who may only read may do this.

    Parameters
    ----------
    where : str
        Where a session should be, for the log.
    """
    inbox = Inbox()
    subscription = bus.subscribe(node.inputs, inbox)
    deadline = time.monotonic() + SILENT_SESSION
    while not stopping.is_set():
        message = inbox.get(timeout=0.2)
        if message is not None:
            node.handle(message)
            deadline = math.inf
        elif time.monotonic() > deadline:
            deadline = math.inf
            logger.warning(
                "no message in %g s from %s: does a session run there? Waiting.",
                SILENT_SESSION,
                where,
            )
    subscription.close()
