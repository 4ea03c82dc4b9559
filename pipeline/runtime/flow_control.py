"""How fast a replay may go, and when it is over: from what the nodes report of themselves alone."""

from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from pipeline.messages import MessageCount, NodeStatus
from sensors.acquisition.blocks import AccelerationBlock

# Published but not yet reported as handled by every node: two minutes of one unit's blocks, so that
# no node waits for the source and a replay fits into the transport's queues.
UNACKNOWLEDGED_BLOCKS = 120


class Credit:
    """Lets a source publish as fast as the slowest node follows.

    Parameters
    ----------
    takers : iterable of str
        Names of the nodes that take acceleration blocks.
    unacknowledged : int
        Blocks that may be on their way to the slowest of them.

    Raises
    ------
    ValueError
        If `unacknowledged` is less than 1.

    Notes
    -----
    A node acknowledges with `NodeStatus.last_sequence`: every block published up to that one.
    Blocks are counted, not their numbers, so that a gap in a recording holds nothing up.
    """

    def __init__(self, takers: Iterable[str], unacknowledged: int) -> None:
        if unacknowledged < 1:
            raise ValueError(f"{unacknowledged} unacknowledged blocks: at least 1 must be allowed")
        self._limit = unacknowledged
        self._on_their_way: dict[str, deque[int]] = {taker: deque() for taker in takers}

    def may_send(self, sequence: int, statuses: Iterable[NodeStatus]) -> bool:
        """Whether the block of this number may be published now; if so, it counts as published.

        Parameters
        ----------
        sequence : int
            Number of the block.
        statuses : iterable of NodeStatus
            The latest of each node; those of others do not matter.
        """
        for status in statuses:
            _acknowledge(self._on_their_way.get(status.node), status.last_sequence)
        if any(len(sequences) >= self._limit for sequences in self._on_their_way.values()):
            return False
        for sequences in self._on_their_way.values():
            sequences.append(sequence)
        return True


def _acknowledge(on_their_way: deque[int] | None, sequence: int) -> None:
    if on_their_way is None or sequence not in on_their_way:
        return
    while on_their_way.popleft() != sequence:
        pass


class Quiet:
    """Knows when nodes have nothing left to do, where their counts cannot show it: after a restart
    a node counts from zero again, and the transport gives it again what it had already.

    A node reports its status every second and whenever it has caught up, but never while it is busy
    with a message. One that has reported the same often enough has been waiting in between.
    """

    ENOUGH = 4  # statuses in a row: at least three seconds; lost messages are asked for each half

    def __init__(self) -> None:
        self._latest: dict[str, NodeStatus] = {}
        self._alike: dict[str, int] = {}

    def note(self, status: NodeStatus) -> None:
        """Take note of a node's next status."""
        before = self._latest.get(status.node)
        alike = before is not None and _taken(before) == _taken(status)
        self._alike[status.node] = self._alike.get(status.node, 1) + 1 if alike else 1
        self._latest[status.node] = status

    def of_all(self, nodes: Iterable[str]) -> bool:
        """Whether all of these nodes have been waiting."""
        return all(
            self._alike.get(node, 0) >= self.ENOUGH and self._latest[node].state == "running"
            for node in nodes
        )


def _taken(status: NodeStatus) -> tuple[MessageCount, ...]:
    """Return what a node has taken, but for statuses, which never end."""
    return tuple(each for each in status.received if each.message != NodeStatus.__name__)


@dataclass(frozen=True, slots=True)
class Unarrived:
    """Messages of one type that a node has not handled, of all that were published."""

    node: str
    message: str
    missing: int
    published: int

    def __str__(self) -> str:
        return f"{self.node} has not received {self.missing} of {self.published} {self.message}"


def is_drained(statuses: Iterable[NodeStatus], consumers: Mapping[str, Sequence[type]]) -> bool:
    """Whether every message that was published has been handled by every node that takes it.

    Parameters
    ----------
    statuses : iterable of NodeStatus
        The latest of each node, and of the source after its last message; of several of one node
        the last counts.
    consumers : mapping of str to sequence of type
        Node name → message types that it takes; NodeStatus, which never ends, is left out.

    Notes
    -----
    Why the latest statuses are enough, though each is from another moment: a node that gives more
    than its status reports must have taken more than its status reports, and so on upstream until
    the source, which has ended. Blocks known to be lost count as handled.
    """
    latest = {status.node: status for status in statuses}
    return latest.keys() >= consumers.keys() and not unarrived(latest.values(), consumers)


def unarrived(
    statuses: Iterable[NodeStatus], consumers: Mapping[str, Sequence[type]]
) -> list[Unarrived]:
    """Return what nodes that have reported lack; see `is_drained`."""
    latest = {status.node: status for status in statuses}
    found = []
    for node in latest.keys() & consumers.keys():
        for message_type in consumers[node]:
            published = _published(latest.values(), message_type)
            missing = published - _handled(latest[node], message_type)
            if missing > 0 and message_type is not NodeStatus:
                found.append(Unarrived(node, message_type.__name__, missing, published))
    return sorted(found, key=lambda each: (each.node, each.message))


def _published(statuses: Iterable[NodeStatus], message_type: type) -> int:
    return sum(
        counted.count
        for status in statuses
        for counted in status.published
        if counted.message == message_type.__name__
    )


def _handled(status: NodeStatus, message_type: type) -> int:
    received = sum(
        counted.count for counted in status.received if counted.message == message_type.__name__
    )
    return received + (status.lost if message_type is AccelerationBlock else 0)
