"""A node's share of a farm: the turbines of one of several equal nodes, wherever they run.

    turbines t1 … t20 ──► updating-1-of-2    t1, t3, t5, …
                     └──► updating-2-of-2    t2, t4, t6, …

Every shard takes every message and leaves alone what is another's; so the books of a session, which
count messages by node, hold for shards as they do for nodes.
"""

import zlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from pipeline.messages import (
    Message,
    NodeStatus,
    QualityWarning,
)
from pipeline.nodes.node import Node
from sensors.errors import InputError


class ShardError(InputError):
    """A share of a farm that there is not."""


@dataclass(frozen=True, slots=True)
class Shard:
    """Number `number` of `count` shares, from 1.

    Turbines that are known beforehand are dealt in turn, so that shares are equal; others go by a
    checksum of their names. Both are the same on every machine, in every run.
    """

    number: int
    count: int
    turbines: tuple[str, ...] = ()  # known beforehand, in their order

    def __post_init__(self) -> None:
        if not 1 <= self.number <= self.count:
            raise ShardError(
                f"shard {self.number}/{self.count} does not exist; 1/{self.count} does"
            )

    @property
    def suffix(self) -> str:
        """Of the name of a node that has this share."""
        return f"-{self.number}-of-{self.count}"

    def has(self, turbine: str) -> bool:
        """Whether this share has a turbine."""
        if turbine in self.turbines:
            place = self.turbines.index(turbine)
        else:
            place = zlib.crc32(turbine.encode())
        return place % self.count == self.number - 1


def parsed_shard(text: str, turbines: Sequence[str] = ()) -> Shard:
    """The share that "1/4" names. Raises ShardError."""
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
        """The node's answers; none to a message of another share's turbine."""
        if isinstance(message, NodeStatus) or self._shard.has(message.turbine):
            return self._node.handle(message)
        return ()

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """The node's own."""
        return getattr(self._node, "warnings", ())

    @property
    def late(self) -> int:
        """Blocks that came too late for the node."""
        return getattr(self._node, "late", 0)

    @property
    def duplicate(self) -> int:
        """Blocks that the node got twice."""
        return getattr(self._node, "duplicate", 0)

    def close(self) -> None:
        """Let go of what the node holds."""
        self._node.close()


def of_kind(name: str, kind: str) -> bool:
    """Whether a node's name is that of a kind, or of a share of it."""
    return name == kind or name.startswith(f"{kind}-")


MOST_TURBINES = 300  # of a session; an updater of each holds 3 MB
MOST_UNITS = 16  # of a turbine


class LimitedMembers:
    """Names of those that were heard.

    When one more comes, who has said least goes; of these, who has been silent longest. So a flood
    of new names drives out names of the flood, and nobody who has been speaking for a while.
    """

    def __init__(self, most: int) -> None:
        self.gone = 0  # names that had to go
        self._most = most
        self._said: dict[str, int] = {}  # by name, the longest silent first

    def __len__(self) -> int:
        return len(self._said)

    def heard(self, name: str) -> str | None:
        """Note that somebody speaks; who has to go for it, if anybody has."""
        leaving = None
        if name not in self._said and len(self._said) >= self._most:
            leaving = min(self._said, key=self._said.__getitem__)  # the first of equals
            del self._said[leaving]
            self.gone += 1
        self._said[name] = self._said.pop(name, 0) + 1
        return leaving


def told_of_gone(gone: int, limits: str) -> tuple[QualityWarning, ...]:
    """What a node says that had to let somebody go; nothing where nobody had to."""
    if not gone:
        return ()
    text = f"more than {limits}: {gone} times who had said least was let go"
    return (QualityWarning("too-many-turbines", text),)
