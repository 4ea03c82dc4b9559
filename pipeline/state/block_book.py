"""What became of the blocks of one boot of one unit: sets of block numbers."""

from collections.abc import Iterator
from dataclasses import dataclass, field

from pipeline.state.phrases import block_numbers
from sensors.intervals import Intervals
from sensors.json_values import Json

REPORTED_WITHIN = 5  # blocks after which missing ones are reported: they may be late


@dataclass(slots=True)
class BlockBook:
    """What became of the blocks of one boot of one unit."""

    recorded: Intervals = field(default_factory=Intervals)
    """Block numbers that arrived."""
    reported: Intervals = field(default_factory=Intervals)
    """Block numbers that were reported missing."""
    late: Intervals = field(default_factory=Intervals)
    """Block numbers that arrived after they had been reported missing."""
    unused: Intervals = field(default_factory=Intervals)
    """Block numbers that the unit passed over: no sample is missing."""
    repeated: int = 0
    """Blocks that arrived again."""
    published: int | None = None
    """Blocks that the source says it published; None before its end."""

    def enter(self, number: int, *, unused_before: int) -> None:
        """Enter a block that arrived, and how many numbers its unit passed over before it."""
        self.unused.add(number - unused_before, number)
        before = len(self.recorded)
        self.recorded.add(number)
        if len(self.recorded) == before:
            self.repeated += 1
        elif number in self.reported:
            self.late.add(number)

    @property
    def lost(self) -> int:
        """Blocks that are missing between those that arrived, and at the end."""
        inside = len(self.missing)
        if self.published is None:
            return inside
        return max(inside, self.published - len(self.recorded) - self.repeated)

    @property
    def missing(self) -> Intervals:
        """Block numbers between those that arrived whose samples are not there."""
        return self.recorded.holes - self.unused

    @property
    def refuted(self) -> Iterator[tuple[int, int, int]]:
        """Ranges of block numbers reported missing, and how many of them arrived in time."""
        span = Intervals([(self.recorded.first, self.recorded.end)] if self.recorded else ())
        for first, end in self.reported - (self.missing | self.late):
            there = end - first - len(Intervals([(first, end)]) - span)
            if there > 0:
                yield first, end, there

    def violations(self) -> Iterator[str]:
        """Where the book does not balance, in words; but for what is reported and arrived."""
        missing = self.missing
        for first, end in missing - self.reported:
            if self.published is None and end > self.recorded.end - REPORTED_WITHIN:
                continue  # they may still come
            yield f"{block_numbers(first, end)} neither recorded nor reported missing"
        if self.published is None:
            return
        elsewhere = len(self.reported - self.recorded) + len(missing - self.reported)
        unknown = self.published - len(self.recorded) - elsewhere
        unknown -= min(self.repeated, max(0, unknown))  # that were published twice
        if unknown > 0:
            yield (
                f"{unknown} of {self.published} published blocks are neither recorded nor reported "
                "missing"
            )
        if len(self.recorded) > self.published:
            yield f"{len(self.recorded)} blocks are recorded and {self.published} were published"

    def as_json(self) -> Json:
        """The book in figures; names are stable."""
        return {
            "published": self.published,
            "recorded": len(self.recorded),
            "repeated": self.repeated,
            "late": len(self.late),
            "lost": self.lost,
        }
