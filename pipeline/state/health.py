"""Who is alive, what is late, what is missing: from the table of streams alone."""

from dataclasses import dataclass
from heapq import nsmallest
from typing import Literal

from pipeline.messages import Message, NodeStatus, StreamEnd
from pipeline.streams import key_of, stream_of
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.bounded_dict import BoundedDict

MOST_KEYS_WATCHED = 5000  # of more, those with the fewest messages go,
LET_GO = 100  # so many at once, as the search for them takes a look at all
LATE_AFTER = 3.0  # a stream is late when so many of its periods have gone by in silence [-]

Condition = Literal["alive", "late", "ended"]


@dataclass(frozen=True, slots=True)
class StreamHealth:
    """How one key does."""

    key: str
    condition: Condition
    """A stream without a period is never late."""
    silence: float
    """Since the last message [s]."""
    messages: int
    rate: float
    """Of messages since the first [1/s]; NaN before the second."""


@dataclass(frozen=True, slots=True)
class NodeHealth:
    """How one node does."""

    condition: Condition
    """Late: it has sent nothing for too long; ended: it has reported so."""
    silence: float
    """Since its last status [s]."""
    status: NodeStatus
    """The last."""


@dataclass(slots=True)
class _Seen:
    message: Message  # the last
    time_ns: int
    count: int
    first_ns: int

    @property
    def rate(self) -> float:
        """Messages in a second since the first."""
        duration = (self.time_ns - self.first_ns) / NANOSECONDS
        return (self.count - 1) / duration if duration > 0 else float("nan")


class Health:
    """Watches messages go by.

    All times are of the watcher's own clock [ns]: when a message came, and when it is asked.
    """

    def __init__(self) -> None:
        self._seen: dict[str, _Seen] = {}
        self._ended: BoundedDict[tuple[str, str], str] = BoundedDict(MOST_KEYS_WATCHED)

    def observe(self, message: Message, now_ns: int) -> None:
        """Take note of one message that has just come."""
        key = key_of(message)
        if key not in self._seen and len(self._seen) >= MOST_KEYS_WATCHED:
            for rare in nsmallest(LET_GO, self._seen, key=lambda each: self._seen[each].count):
                del self._seen[rare]
        seen = self._seen.setdefault(key, _Seen(message, now_ns, 0, now_ns))
        seen.message, seen.time_ns, seen.count = message, now_ns, seen.count + 1
        if isinstance(message, StreamEnd):
            self._ended[message.turbine, message.unit] = message.session
        elif isinstance(message, AccelerationBlock):
            self._note_session(message)

    def streams(self, now_ns: int) -> tuple[StreamHealth, ...]:
        """Return every key on which something has come, statuses left out."""
        return tuple(
            StreamHealth(
                key, self._condition(seen, now_ns), _silence(seen, now_ns), seen.count, seen.rate
            )
            for key, seen in self._seen.items()
            if not isinstance(seen.message, NodeStatus)
        )

    def nodes(self, now_ns: int) -> tuple[NodeHealth, ...]:
        """Return every node that has sent anything."""
        return tuple(
            NodeHealth(self._condition(seen, now_ns), _silence(seen, now_ns), seen.message)
            for seen in self._seen.values()
            if isinstance(seen.message, NodeStatus)
        )

    def _note_session(self, block: AccelerationBlock) -> None:
        unit = (block.turbine, block.unit)
        if self._ended.get(unit, block.session) != block.session:
            del self._ended[unit]  # the unit has started again

    def _condition(self, seen: _Seen, now_ns: int) -> Condition:
        if self._has_ended(seen.message):
            return "ended"
        period = stream_of(type(seen.message)).period
        late = period is not None and _silence(seen, now_ns) > LATE_AFTER * period
        return "late" if late else "alive"

    def _has_ended(self, message: Message) -> bool:
        if isinstance(message, NodeStatus):
            return message.state == "stopped"
        return (message.turbine, getattr(message, "unit", "")) in self._ended


def _silence(seen: _Seen, now_ns: int) -> float:
    return (now_ns - seen.time_ns) / NANOSECONDS
