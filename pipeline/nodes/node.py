"""What a node is: a name, the messages it takes, what it answers, what it counts."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, fields
from typing import Protocol, get_args, runtime_checkable

from pipeline.messages import Message, QualityWarning


@dataclass(frozen=True, slots=True)
class NodeStatistics:
    """What a node counts of the blocks that it is given, and warns of."""

    lost: int = 0
    """Blocks that it received and could not keep."""
    late: int = 0
    """Blocks that came too late to be used."""
    duplicate: int = 0
    """Blocks that came twice."""
    recorded: int = 0
    """Blocks in a recorder's recording, those of its earlier parts too."""
    rejected: Counter[str] = field(default_factory=Counter)
    """Blocks that were refused, by the reason's code."""
    warnings: tuple[QualityWarning, ...] = ()

    def __add__(self, other: "NodeStatistics") -> "NodeStatistics":
        """Both together."""
        return NodeStatistics(
            *(getattr(self, each.name) + getattr(other, each.name) for each in fields(self))
        )


class Node(Protocol):
    """One step of the flow. A pure node has no I/O, reads no clock and prints nothing; a sink
    (recorder, viewer) has the same face and answers with nothing.

    An expected failure is a message (WindowRejected); an exception means that a person must act.
    """

    @property
    def name(self) -> str:
        """Unique in a session: "identification", "updating", "recorder", …"""
        ...

    @property
    def inputs(self) -> tuple[type, ...]:
        """Message types that it takes."""
        ...

    @property
    def statistics(self) -> NodeStatistics:
        """What it counts and warns of until now."""
        ...

    def handle(self, message: Message) -> Iterable[Message]:
        """Take one message, give what follows from it, in order."""
        ...

    def close(self) -> None:
        """Let go of what the node holds; called once, at the end."""
        ...


class Sink:
    """Base of a node that takes messages, gives none back and counts none."""

    inputs: tuple[type, ...] = get_args(Message)

    @property
    def statistics(self) -> NodeStatistics:
        """Nothing of its own: its status would count what it then receives."""
        return NodeStatistics()

    def close(self) -> None:
        """Nothing is held."""


@runtime_checkable
class PayloadNode(Protocol):
    """A node that keeps messages as they arrived: it is given their bytes as well."""

    def handle_payload(self, message: Message, payload: bytes) -> Iterable[Message]:
        """Take one message with the bytes that it came in."""
        ...


@dataclass(frozen=True, slots=True)
class Plan:
    """A node of the graph and how to make it.

    It is made where it runs: in this thread, in a thread of its own, in another process.
    """

    node: type[Node]
    make: Callable[[], Node]

    @property
    def name(self) -> str:
        """Name of the node."""
        return self.node.name  # type: ignore[return-value]  # a class attribute of every node


@dataclass(frozen=True, slots=True)
class NodeSnapshot:
    """What a node of one turbine must not forget."""

    state: bytes
    """As the node itself reads it."""
    messages: tuple[Message, ...] = ()
    """Layouts, latest answers: what is kept as it was sent."""


class TurbineNode(Protocol):
    """A node of one turbine: `NodeByTurbine` holds one of each, evicts and restarts them."""

    @property
    def statistics(self) -> NodeStatistics:
        """What it counts and warns of until now."""
        ...

    @property
    def revision(self) -> int:
        """Grows whenever there is more to keep."""
        ...

    def handle(self, message: Message) -> Iterable[Message]:
        """Take one message of the turbine, give what follows from it, in order."""
        ...

    def finish(self) -> Iterator[Message]:
        """Return what is still to be reported before the node goes."""
        ...

    def snapshot(self) -> NodeSnapshot:
        """Return what must not be forgotten."""
        ...

    def restore(self, snapshot: NodeSnapshot, past: Iterable[Message]) -> Iterator[Message]:
        """Go on from a snapshot and from what was recorded; what is reported again or for the
        first time."""
        ...
