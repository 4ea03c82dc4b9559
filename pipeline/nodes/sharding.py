"""A node's share of a farm: the turbines of one of several equal nodes, wherever they run.

    turbines t1 … t20 ──► updating-1-of-2    t1, t3, t5, …
                     └──► updating-2-of-2    t2, t4, t6, …

Every shard takes every message and leaves alone what is another's; so the books of a session, which
count messages by node, balance for shards as they do for nodes.
"""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pipeline.messages import Message, NodeStatus
from pipeline.nodes.node import Node, NodeStatistics
from sensors.errors import InputError


class ShardError(InputError):
    """A share of a farm that does not exist."""


@dataclass(frozen=True, slots=True)
class Shard:
    """Number `number` of `count` shares, from 1.

    Turbines that are known beforehand are dealt in turn, so that shares are equal; others go by a
    checksum of their names. Both are the same on every machine, in every run.
    """

    number: int
    count: int
    turbines: tuple[str, ...] = ()
    """Known beforehand, in their order."""

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise ShardError(
                f"shard {self.number}/{self.count} does not exist; 1/{self.count} does"
            )

    @property
    def suffix(self) -> str:
        """Suffix of the name of a node that has this share."""
        return f"-{self.number}-of-{self.count}"

    def has(self, turbine: str) -> bool:
        """Whether this share has a turbine."""
        if turbine in self.turbines:
            place = self.turbines.index(turbine)
        else:
            place = zlib.crc32(turbine.encode())
        return place % self.count == self.number - 1


def parsed_shard(text: str, turbines: Sequence[str] = ()) -> Shard:
    """Return the share that "1/4" names. Raises ShardError."""
    number, _, count = text.partition("/")
    try:
        return Shard(int(number), int(count), tuple(turbines))
    except ValueError:
        raise ShardError(f"--shard {text!r} is not like 1/4, the first of four") from None


class ShardedNode:
    """A node that handles its own turbines' messages and leaves the others'."""

    def __init__(self, node: Node, shard: Shard) -> None:
        self.name = node.name + shard.suffix
        self.inputs = node.inputs
        self._node = node
        self._shard = shard

    def handle(self, message: Message) -> Iterable[Message]:
        """Return the node's answers; none to a message of another share's turbine."""
        if isinstance(message, NodeStatus) or self._shard.has(message.turbine):
            return self._node.handle(message)
        return ()

    @property
    def statistics(self) -> NodeStatistics:
        """The node's own."""
        return self._node.statistics

    def close(self) -> None:
        """Let go of what the node holds."""
        self._node.close()
