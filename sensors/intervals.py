"""Sets of whole numbers, kept as ranges: which blocks arrived, are missing, were taken."""

from bisect import bisect_right
from collections.abc import Iterable, Iterator


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
