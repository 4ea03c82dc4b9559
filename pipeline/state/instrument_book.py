"""What became of the messages of instruments, by the statuses of the feeds that listen to them."""

from dataclasses import dataclass, fields

from pipeline.messages import FEED_MESSAGE, NodeStatus
from sensors.json_values import Json


@dataclass(frozen=True, slots=True)
class InstrumentMessages:
    """Counts of one feed's messages since its start."""

    received: int = 0
    lost: int = 0
    """That never came, as their numbers say."""
    late: int = 0
    """That came after the block that they belong to had gone on, and were left out."""
    malformed: int = 0
    """That could not be read, and were left out."""
    duplicate: int = 0
    """That came again."""

    @classmethod
    def of(cls, status: NodeStatus) -> "InstrumentMessages | None":
        """Return what a feed says of them; None: of another node's status."""
        received = [each.count for each in status.received if each.message == FEED_MESSAGE]
        if not received:
            return None
        return cls(sum(received), status.lost, status.late, status.malformed, status.duplicate)

    def __add__(self, other: "InstrumentMessages") -> "InstrumentMessages":
        return InstrumentMessages(
            *(getattr(self, each.name) + getattr(other, each.name) for each in fields(self))
        )

    def is_before(self, later: "InstrumentMessages") -> bool:
        """Whether the feed was not started again in between: then messages received grow in number.

        Those lost do not: one of them may still come.
        """
        return self.received <= later.received


class InstrumentBook:
    """The messages of one feed over all its starts."""

    def __init__(self) -> None:
        self._ended = InstrumentMessages()
        self._latest = InstrumentMessages()

    def enter(self, counts: InstrumentMessages) -> None:
        """Enter what the feed says now."""
        if not self._latest.is_before(counts):
            self._ended += self._latest
        self._latest = counts

    @property
    def total(self) -> InstrumentMessages:
        """Counts of all starts."""
        return self._ended + self._latest

    def as_json(self) -> Json:
        """Return the counts; names are stable."""
        return {each.name: getattr(self.total, each.name) for each in fields(InstrumentMessages)}
