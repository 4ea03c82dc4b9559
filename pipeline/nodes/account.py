"""NodeAccount: a node with its books, whichever runner serves it."""

from collections import Counter
from collections.abc import Callable

from pipeline.messages import Message, MessageCount, NodeStatus
from pipeline.nodes.node import Node
from sensors.blocks import AccelerationBlock


class NodeAccount:
    """Counts what a node takes and gives, and how long it is busy.

    node      the node
    turbine   id that the status is published under
    clock     → time [ns since 1970]; an argument, so that nodes and tests need none
    """

    def __init__(self, node: Node, turbine: str, clock: Callable[[], int]) -> None:
        self.node = node
        self.last_sequence = -1  # of the acceleration blocks handled
        self._turbine = turbine
        self._clock = clock
        self._received: Counter[str] = Counter()
        self._published: Counter[str] = Counter()
        self._busy_ns = 0

    @property
    def handled(self) -> int:
        """Messages that the node has taken; statuses, which would beget statuses, do not count."""
        return self._received.total() - self._received[NodeStatus.__name__]

    def handle(self, message: Message) -> list[Message]:
        """The node's answers to one message, in order."""
        started = self._clock()
        answers = list(self.node.handle(message))
        self._busy_ns += max(0, self._clock() - started)
        self._received[type(message).__name__] += 1
        self._published.update(type(answer).__name__ for answer in answers)
        if isinstance(message, AccelerationBlock):
            self.last_sequence = message.sequence
        return answers

    def status(self, state: str, *, lost: int = 0) -> NodeStatus:
        """What the node would say of itself now; `lost` is what its subscription knows of."""
        return NodeStatus(
            turbine=self._turbine,
            node=self.node.name,
            time_ns=self._clock(),
            state=state,
            last_sequence=self.last_sequence,
            received=message_counts(self._received),
            published=message_counts(self._published),
            lost=lost,
            late=getattr(self.node, "late", 0),
            duplicate=getattr(self.node, "duplicate", 0),
            busy_s=self._busy_ns * 1e-9,
        )


def message_counts(counter: Counter[str]) -> tuple[MessageCount, ...]:
    """The counts as they travel, in alphabetical order."""
    return tuple(MessageCount(name, count) for name, count in sorted(counter.items()))
