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
from collections import Counter, deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Protocol

from threadpoolctl import threadpool_limits

from pipeline.messages import Message, NodeStatus, StreamEnd
from pipeline.nodes.node import Node
from pipeline.nodes.statistics import NodeAccount, message_counts
from pipeline.runtime.errors import NodeFailed
from pipeline.runtime.flow_control import Credit, Quiet, is_drained
from pipeline.state.block_book import Intervals
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.codec import decode, encode
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.boots import BootCounter
from sensors.errors import InputError

logger = logging.getLogger(__name__)

STATUS_PERIOD = 1.0  # longest time between two statuses of a running node [s]
STATUS_BLOCKS = 16  # a status at the latest after so many blocks, so that the source can go on
START_TIMEOUT = 60.0  # for every node to be ready [s]; a cold process imports for seconds
FIRST_BLOCK_TIMEOUT = 60.0  # for every node to acknowledge the first block [s]
SOURCE = "source"
DRAINED_WITHIN = 2.0  # what a node has received when it is asked to stop [s]
STOPPED_WITHIN = 7.0  # all nodes, together; what remains of ten seconds is the summary's [s]
KEPT_FOR_RECORDER = 4.0  # of that, when the nodes before it have ended [s]
KEPT_FOR_LAST = 1.0  # of that, for what follows the recorder [s]
LEAST_PATIENCE = 0.2  # with the last of them [s]
RECORDER = "recorder"

BlockReport = Callable[[AccelerationBlock], None]


def run_lock_step(
    source: Iterable[Message],
    nodes: Sequence[Node],
    *,
    turbine: str,
    report: BlockReport | None = None,
) -> None:
    """Every message through the whole graph before the next; deterministic, without transport."""
    accounts = [NodeAccount(node, turbine, time.time_ns) for node in nodes]
    with one_blas_thread():
        for message in with_end(source):
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


class Worker(Protocol):
    """A node somewhere else: in a thread or in a process of its own."""

    @property
    def name(self) -> str:
        """Name of the node."""
        ...

    @property
    def inputs(self) -> tuple[type, ...]:
        """Message types that the node takes."""
        ...

    def start(self) -> None:
        """Start the node."""
        ...

    @property
    def restarts(self) -> int:
        """How often the node had to be started again."""
        ...

    def check(self) -> None:
        """Handle a node that has ended before it was asked to: start it again or raise
        NodeFailed."""
        ...

    def stop(self, within: float = STOPPED_WITHIN) -> None:
        """Let the node finish what it has, close it, and wait for it; not for longer [s]."""
        ...


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

    Raises NodeFailed when a node ends with an exception; the others are closed first.
    """
    ended = stopping or threading.Event()
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
        except RunEnded:
            logger.info("the session was ended early")
        finally:
            deadline = time.monotonic() + STOPPED_WITHIN
            for worker, kept in zip(workers, _kept_for_others(workers), strict=True):
                worker.stop(deadline - kept - time.monotonic())
        for worker in workers:
            worker.check()


def _kept_for_others(workers: Sequence[Worker]) -> list[float]:
    """Of the time in which all stop, what each leaves to those behind it [s].

    They stop in the order of the flow: the recorder sees the others stop.
    """
    names = [worker.name for worker in workers]
    recorder = names.index(RECORDER) if RECORDER in names else len(names) - 1
    kept = [KEPT_FOR_RECORDER] * recorder + [KEPT_FOR_LAST] * (len(names) - recorder)
    return [*kept[:-1], 0.0]


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

    def stop(self, within: float = STOPPED_WITHIN) -> None:
        """Let the node finish what it has, close it, and wait for it; not for longer [s]."""
        self._stopping.set()
        self.join(max(within, LEAST_PATIENCE))
        if self.is_alive():
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
    clock: Callable[[], int] = time.time_ns,
    monotonic: Callable[[], float] = time.monotonic,
) -> None:
    """Give a node its messages and publish its answers, until `stopping` is set and all is done.

    What is not done DRAINED_WITHIN after that is left: a node that is started again finds it where
    it is recorded.
    """
    account = NodeAccount(node, turbine, clock)
    inbox = Inbox()
    subscription = bus.subscribe(node.inputs, inbox)
    beat = Heartbeat(clock)

    def say(state: str) -> None:
        bus.publish(
            account.status(
                state,
                lost=subscription.lost_of(AccelerationBlock) + inbox.dropped_of(AccelerationBlock),
                recovered=subscription.recovered_of(AccelerationBlock),
                malformed=inbox.malformed,
                refusal=inbox.refusal,
            )
        )
        beat.said(account)

    say("ready")
    asked: float | None = None  # when it was asked to stop [s]
    try:
        while True:
            message = inbox.get(timeout=0.05)
            if message is not None:
                for answer in account.handle(message, inbox.payload):
                    bus.publish(answer)
            if beat.due(account, idle=message is None):
                say("running")
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
        say("stopped")
        subscription.close()


class Heartbeat:
    """When a node should report: every second, every few blocks, when it has caught up."""

    def __init__(self, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._said_ns = 0
        self._said_messages = -1
        self._said_sequence = -1

    def said(self, account: NodeAccount) -> None:
        """Remember what the last status reported."""
        self._said_ns = self._clock()
        self._said_messages = account.handled
        self._said_sequence = account.last_sequence

    def due(self, account: NodeAccount, *, idle: bool) -> bool:
        """Whether it is time for the next status."""
        if self._clock() - self._said_ns > STATUS_PERIOD * 1e9:
            return True
        if idle:
            return account.handled != self._said_messages
        return account.last_sequence - self._said_sequence >= STATUS_BLOCKS


class RunEnded(Exception):  # noqa: N818  # the name states what happened
    """The run was asked to end before the source ended."""


class SourceFeed:
    """Publishes a source no faster than the workers follow, and knows when all is handled."""

    def __init__(self, bus: Bus, workers: Sequence[Worker], ended: threading.Event) -> None:
        self._bus = bus
        self._workers = workers
        self._ended = ended
        self._inbox = Inbox()
        self._subscription = bus.subscribe((NodeStatus,), self._inbox)
        self._latest: dict[str, NodeStatus] = {}  # by node
        self._deaf: Callable[[], list[str]] = list  # nodes that receive nothing
        self._quiet = Quiet()

    def wait_until_ready(self) -> None:
        """Return when every worker has subscribed. Raises NodeFailed after START_TIMEOUT."""
        names = {worker.name for worker in self._workers}
        deadline = time.monotonic() + START_TIMEOUT
        self.wait(lambda: self._latest.keys() >= names or time.monotonic() > deadline)
        missing = names - self._latest.keys()
        if missing:
            raise NodeFailed(f"{', '.join(sorted(missing))} not ready after {START_TIMEOUT:g} s")

    def publish(
        self,
        source: Iterable[Message],
        turbine: str,
        unacknowledged_blocks: int | None,
        report: BlockReport | None,
    ) -> None:
        """Publish all of the source and return when every message has been handled."""
        takers = [each.name for each in self._workers if AccelerationBlock in each.inputs]
        credit = Credit(takers, unacknowledged_blocks) if unacknowledged_blocks else None
        published: Counter[str] = Counter()
        first_published: float | None = None
        for message in with_end(source):
            if credit and isinstance(message, AccelerationBlock):
                self._deaf = partial(self._unacknowledged, takers, first_published)
                self.wait(partial(self._may_send, credit, message.sequence))
            self._check()
            self._bus.publish(message)
            published[type(message).__name__] += 1
            if first_published is None and isinstance(message, AccelerationBlock):
                first_published = time.monotonic()
            if report and isinstance(message, AccelerationBlock):
                report(message)
        finished = source_status(turbine, published)
        self._bus.publish(finished)
        consumers = {worker.name: worker.inputs for worker in self._workers}
        self._deaf = partial(self._unacknowledged, takers, first_published)
        self._quiet = Quiet()
        self.wait(lambda: self._all_handled(finished, consumers))

    def _all_handled(self, finished: NodeStatus, consumers: Mapping[str, Sequence[type]]) -> bool:
        if any(worker.restarts for worker in self._workers):  # their counts started again
            return self._quiet.of_all(consumers)
        return is_drained([finished, *self._latest.values()], consumers)

    def wait(self, condition: Callable[[], bool]) -> None:
        """Return when the condition on the workers' statuses holds.

        Raises NodeFailed when a worker has died, RunEnded when the run is to end.
        """
        self._take_statuses(timeout=0)
        while not condition():
            self._check()
            self._take_statuses(timeout=0.1)

    def _take_statuses(self, timeout: float) -> None:
        while (status := self._inbox.get(timeout)) is not None:
            assert isinstance(status, NodeStatus)
            self._latest[status.node] = status
            self._quiet.note(status)
            timeout = 0

    def _may_send(self, credit: Credit, sequence: int) -> bool:
        return credit.may_send(sequence, self._latest.values())

    def _check(self) -> None:
        """Raise RunEnded or NodeFailed where there is no reason to go on."""
        if self._ended.is_set():
            raise RunEnded
        for worker in self._workers:
            worker.check()
        deaf = self._deaf()
        if deaf:
            raise NodeFailed(
                f"{', '.join(sorted(deaf))}: the first block was published "
                f"{FIRST_BLOCK_TIMEOUT:g} s ago and did not arrive; is the transport's version "
                "one that this program was tried with?"
            )

    def _unacknowledged(self, takers: Sequence[str], since: float | None) -> list[str]:
        """Nodes that have not received the first block although its time is over [s, monotonic]."""
        if since is None or time.monotonic() - since < FIRST_BLOCK_TIMEOUT:
            return []
        return [name for name in takers if not _heard_blocks(self._latest.get(name))]


def _heard_blocks(status: NodeStatus | None) -> bool:
    """Whether a node has taken a block, or reports that blocks were lost before they reached it."""
    name = AccelerationBlock.__name__
    return status is not None and (
        status.lost > 0 or any(each.message == name and each.count for each in status.received)
    )


def source_status(turbine: str, published: Counter[str]) -> NodeStatus:
    """The source's last word: what it published in all."""
    return NodeStatus(
        turbine=turbine,
        node=SOURCE,
        time_ns=time.time_ns(),
        state="stopped",
        last_sequence=-1,
        published=message_counts(published),
    )


def with_end(source: Iterable[Message]) -> Iterator[Message]:
    """The source's messages, then one StreamEnd per unit and session, of its last boot."""
    last: dict[tuple[str, str, str], AccelerationBlock] = {}
    numbers: dict[tuple[str, str, str, int], Intervals] = {}  # of each boot's blocks
    boots: dict[tuple[str, str, str], BootCounter] = {}
    for message in source:
        if isinstance(message, AccelerationBlock):
            key = (message.turbine, message.unit, message.session)
            last[key] = message
            counter = boots.setdefault(key, BootCounter())
            present = numbers.setdefault((*key, counter.boot), Intervals())
            boot = counter.boot_of(message, repeats=message.sequence in present)
            of_boot = numbers.setdefault((*key, boot), Intervals())
            of_boot.add(message.sequence - counter.also, message.sequence + 1)
        yield message
    for key, block in last.items():
        boot = boots[key].boot_at(block.sequence, block.start_ns)
        yield StreamEnd(
            block.turbine, block.unit, block.session, block.end_ns, len(numbers[*key, boot])
        )


@contextmanager
def open_session(open_bus: Callable[[], Bus]) -> Iterator[Bus]:
    """A bus session that is closed whatever happens."""
    bus = open_bus()
    try:
        yield bus
    finally:
        bus.close()


@contextmanager
def one_blas_thread() -> Iterator[None]:
    """One thread in numpy's linear algebra: small matrices are faster so, and sums do not depend
    on how many cores there are, hence neither do results."""
    with threadpool_limits(limits=1):
        yield
