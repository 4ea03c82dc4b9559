"""The source's side of a run: what it publishes, and when all of it has been handled."""

import logging
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Protocol

from pipeline.messages import Message, NodeStatus, StreamEnd, message_counts
from pipeline.runtime.errors import NodeFailed
from pipeline.runtime.flow_control import Credit, Quiet, is_drained, unarrived
from pipeline.transport.bus import Bus, Inbox
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.boots import BootCounter
from sensors.acquisition.layout import SensorLayout
from sensors.intervals import Intervals

logger = logging.getLogger(__name__)

# For every node to be ready [s]: one that ends is noticed at once, and a cold process of a machine
# with much else to do imports for a minute.
START_TIMEOUT = 300.0
FIRST_BLOCK_TIMEOUT = 60.0  # for every node to acknowledge the first block [s]
LAYOUT_TIMEOUT = 10.0  # for every node to have a new layout, before the source goes on [s]
GIVEN_UP_AFTER = 30.0  # of quiet, what has not arrived; a cut link comes back in seconds [s]
REPORTING = 5.0  # since its last status a node may be waiting; one that computes says nothing [s]
STOPPED_WITHIN = 7.0  # all nodes, together; what remains of ten seconds is the summary's [s]
SOURCE = "source"

BlockReport = Callable[[AccelerationBlock], None]


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

    def ask_to_stop(self) -> None:
        """Let the node finish what it has and close its files."""
        ...

    def has_ended(self, within: float) -> bool:
        """Wait for the node's end, not for longer [s]; report whether it came."""
        ...

    def abandon(self) -> None:
        """Go on without a node that was asked to stop and has not ended."""
        ...


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
        self._heard: dict[str, float] = {}  # by node, when [s, monotonic]
        self._quiet_since: float | None = None  # while something is missing [s, monotonic]

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
        consumers = {worker.name: worker.inputs for worker in self._workers}
        published: Counter[str] = Counter()
        first_published: float | None = None
        layouts: set[tuple[str, str, str]] = set()
        arriving = False
        for message in with_end(source):
            if arriving and isinstance(message, AccelerationBlock):
                so_far = source_status(turbine, published)
                deadline = time.monotonic() + LAYOUT_TIMEOUT
                self.wait(partial(self._layouts_arrived, so_far, consumers, deadline))
                arriving = False
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
            if isinstance(message, SensorLayout):
                arriving |= _identity(message) not in layouts
                layouts.add(_identity(message))
        finished = source_status(turbine, published)
        self._bus.publish(finished)
        self._deaf = partial(self._unacknowledged, takers, first_published)
        self._quiet = Quiet()
        self.wait(lambda: self._all_handled(finished, consumers))

    def _layouts_arrived(
        self, source: NodeStatus, consumers: Mapping[str, Sequence[type]], deadline: float
    ) -> bool:
        """Whether every node has the layouts, or their time is over [s, monotonic]: they travel on
        keys of their own, and of several units the first blocks wait for them, but not all."""
        if time.monotonic() > deadline or any(worker.restarts for worker in self._workers):
            return True
        missing = unarrived([source, *self._latest.values()], consumers)
        return all(each.message != SensorLayout.__name__ for each in missing)

    def _all_handled(self, finished: NodeStatus, consumers: Mapping[str, Sequence[type]]) -> bool:
        """Whether it has; or nothing has come for long, and what is missing is said."""
        now = time.monotonic()
        heard_all = all(now - self._heard.get(node, -math.inf) < REPORTING for node in consumers)
        is_quiet = heard_all and self._quiet.of_all(consumers)
        if any(worker.restarts for worker in self._workers):  # their counts started again
            return is_quiet
        statuses = [finished, *self._latest.values()]
        if is_drained(statuses, consumers):
            return True
        self._quiet_since = (self._quiet_since or now) if is_quiet else None
        if self._quiet_since is None or now - self._quiet_since < GIVEN_UP_AFTER:
            return False
        for each in unarrived(statuses, consumers):
            logger.error("%s: the transport lost them; the run ends without", each)
        return True

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
            self._heard[status.node] = time.monotonic()
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
        received = {name for name, status in self._latest.items() if status.has_blocks}
        return [name for name in takers if name not in received]


def _identity(layout: SensorLayout) -> tuple[str, str, str]:
    return layout.turbine, layout.unit, layout.layout_id


def source_status(turbine: str, published: Counter[str]) -> NodeStatus:
    """Return the source's last word: what it published in all."""
    return NodeStatus(
        turbine=turbine,
        node=SOURCE,
        time_ns=time.time_ns(),
        state="stopped",
        last_sequence=-1,
        published=message_counts(published),
    )


def with_end(source: Iterable[Message]) -> Iterator[Message]:
    """Yield the source's messages, then one StreamEnd per unit and session, of its last boot."""
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
        published = len(numbers[*key, boots[key].boot_at(block.sequence, block.start_ns)])
        yield StreamEnd(block.turbine, block.unit, block.session, block.end_ns, published)
