"""What became of the blocks of one boot of one unit: sets of block numbers."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

from pipeline.state.phrases import block_numbers
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.boots import NOTABLE_CLOCK_STEP
from sensors.intervals import Intervals
from sensors.json_values import Json

REPORTED_WITHIN = 5  # blocks after which missing ones are reported: they may be late
UnitBoot = tuple[str, str, str, int]  # turbine, unit, session, boot


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
    start_ns: int | None = None
    """Earliest stamp of a block that arrived [ns]."""
    end_ns: int | None = None
    """Latest end of one [ns]."""

    def enter(self, block: AccelerationBlock, *, unused_before: int) -> None:
        """Enter a block that arrived, and how many numbers its unit passed over before it."""
        number = block.sequence
        self.start_ns = min(block.start_ns, self.start_ns or block.start_ns)
        self.end_ns = max(block.end_ns, self.end_ns or block.end_ns)
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


def pauses_before(books: Mapping[UnitBoot, BlockBook]) -> dict[UnitBoot, float]:
    """Return how long a unit was silent before each of its boots, by its stamps [s].

    Before the first, and between boots that follow each other or overlap, it is 0.
    """
    spans = [
        (book.start_ns, book.end_ns, boot)
        for boot, book in books.items()
        if book.start_ns is not None and book.end_ns is not None
    ]
    ends: dict[tuple[str, str], int] = {}  # of a unit's boots so far
    found: dict[UnitBoot, float] = {}
    for start_ns, end_ns, boot in sorted(spans):
        before_ns = ends.get(boot[:2], start_ns)
        silence = (start_ns - before_ns) / NANOSECONDS
        found[boot] = silence if silence > NOTABLE_CLOCK_STEP else 0.0
        ends[boot[:2]] = max(before_ns, end_ns)
    return found
