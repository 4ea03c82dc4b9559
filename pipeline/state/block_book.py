"""What became of the blocks of one boot of one unit: sets of block numbers."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field

from pipeline.state.phrases import block_numbers
from sensors.json_values import Json

REPORTED_WITHIN = 5  # blocks after which missing ones are reported: they may be late


class Intervals:
    """A set of whole numbers, kept as ranges."""

    def __init__(self, ranges: Iterable[tuple[int, int]] = ()) -> None:
        self._ranges: list[tuple[int, int]] = []  # first, one past the last; in order
        for first, end in ranges:
            self.add(first, end)

    def __len__(self) -> int:
        return sum(end - first for first, end in self._ranges)

    def __iter__(self) -> Iterator[tuple[int, int]]:
        return iter(self._ranges)

    def __contains__(self, number: int) -> bool:
        return any(first <= number < end for first, end in self._ranges)

    def __bool__(self) -> bool:
        return bool(self._ranges)

    def add(self, first: int, end: int | None = None) -> None:
        """Add a number, or those from `first` to one before `end`."""
        end = first + 1 if end is None else end
        if end <= first:
            return
        if not self._ranges or self.end < first:
            self._ranges.append((first, end))
            return
        if self.end == first:
            self._ranges[-1] = (self._ranges[-1][0], end)
            return
        touching = [r for r in self._ranges if r[0] <= end and r[1] >= first]
        for each in touching:
            self._ranges.remove(each)
            first, end = min(first, each[0]), max(end, each[1])
        self._ranges.insert(bisect_right(self._ranges, (first, end)), (first, end))

    @property
    def first(self) -> int:
        """The smallest."""
        return self._ranges[0][0]

    @property
    def end(self) -> int:
        """One more than the largest."""
        return self._ranges[-1][1]

    @property
    def holes(self) -> "Intervals":
        """What is missing between the smallest and the largest."""
        pairs = zip(self._ranges[:-1], self._ranges[1:], strict=True)
        return Intervals((end, first) for (_, end), (first, _) in pairs)

    def __or__(self, other: "Intervals") -> "Intervals":
        return Intervals([*self, *other])

    def __sub__(self, other: "Intervals") -> "Intervals":
        left = Intervals()
        for first, end in self:
            for low, high in other:
                left.add(first, min(low, end))
                first = max(first, high)
            left.add(first, end)
        return left


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
