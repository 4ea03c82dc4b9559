"""The books of a run: every block, window and estimate has one fate.

    blocks       published = recorded + lost + refused           of each unit and boot
    windows      identified | rejected (reason) | pending        of each turbine
    estimates    in the posterior | refused (reason) | pending

What does not balance is a violation, with where it is. The books are kept from messages alone: live
by the status and the summary, offline by `pilewatch audit` from the files.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from typing import Any

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.state.json_values import Json
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.boots import BootCounter

MOST_BOOKS = 2000  # boots of units, and windows that are waited for, each; of more the oldest go
UNANSWERED = 2  # later windows that were answered, after which an estimate counts as forgotten

UnitBoot = tuple[str, str, str, int]  # turbine, unit, session, boot
WindowKey = tuple[object, ...]


class Intervals:
    """A set of whole numbers, kept as ranges."""

    def __init__(self) -> None:
        self._ranges: list[tuple[int, int]] = []  # first, one past the last; in order

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
        if self._ranges and self._ranges[-1][1] == first:
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

    def holes(self) -> Iterator[tuple[int, int]]:
        """Ranges that are missing between the smallest and the largest."""
        for (_, end), (first, _) in zip(self._ranges[:-1], self._ranges[1:], strict=True):
            yield end, first

    def without(self, other: "Intervals") -> Iterator[tuple[int, int]]:
        """Ranges of this set that are not in another."""
        for first, end in self._ranges:
            at = first
            for low, high in other._ranges:
                if high <= at or low >= end:
                    continue
                if low > at:
                    yield at, low
                at = max(at, high)
            if at < end:
                yield at, end


@dataclass(slots=True)
class BlockBook:
    """What became of the blocks of one boot of one unit."""

    recorded: Intervals = field(default_factory=Intervals)
    """Block numbers that arrived."""
    reported: Intervals = field(default_factory=Intervals)
    """Block numbers that were reported missing."""
    late: Intervals = field(default_factory=Intervals)
    """Block numbers that arrived after they had been reported missing."""
    repeated: int = 0
    """Blocks that arrived again."""
    published: int | None = None
    """Blocks that the source says it published; None before its end."""

    @property
    def lost(self) -> int:
        """Blocks that are missing between those that arrived, and at the end."""
        inside = sum(end - first for first, end in self.recorded.holes())
        if self.published is None:
            return inside
        return max(inside, self.published - len(self.recorded))

    def violations(self) -> Iterator[str]:
        """Where the book does not balance, in words."""
        missing = Intervals()
        for first, end in self.recorded.holes():
            missing.add(first, end)
        for first, end in missing.without(self.reported):
            yield f"{_numbers(first, end)} are neither recorded nor reported missing"
        inside = Intervals()
        if self.recorded:
            inside.add(self.recorded.first, self.recorded.end)
        absent = Intervals()
        for each in (missing, self.late):
            for first, end in each:
                absent.add(first, end)
        for first, end in self.reported.without(absent):
            wrong = Intervals()
            wrong.add(first, end)
            outside = sum(b - a for a, b in wrong.without(inside))
            if end - first > outside:
                yield f"{_numbers(first, end)} are reported missing and recorded"
        if self.published is None:
            return
        unreported = sum(end - first for first, end in missing.without(self.reported))
        elsewhere = sum(end - first for first, end in self.reported.without(self.recorded))
        unknown = self.published - len(self.recorded) - elsewhere - unreported
        if unknown > 0:
            yield (
                f"{unknown} of {self.published} published blocks are neither recorded nor reported "
                "missing"
            )
        if len(self.recorded) > self.published:
            yield f"{len(self.recorded)} blocks are recorded and {self.published} were published"


@dataclass(slots=True)
class TurbineBook:
    """What became of one turbine's windows and estimates."""

    identified: int = 0
    rejected: Counter[str] = field(default_factory=Counter)
    """By the reason's code."""
    in_posterior: int = 0
    refused: Counter[str] = field(default_factory=Counter)
    """Estimates that the updating did not use, by the reason's code."""
    pending: dict[WindowKey, int] = field(default_factory=dict)
    """Estimates without an answer of the updating → estimates answered since."""
    known: dict[WindowKey, str] = field(default_factory=dict)
    """Fates of the latest windows."""
    last: dict[WindowKey, int] = field(default_factory=dict)
    """Boots of the units → number of their last window."""
    skipped: list[str] = field(default_factory=list)
    """Windows that have no fate, in words."""


class Books:
    """Keeps the books of a run from its messages.

    Parameters
    ----------
    updates : bool
        Whether the run has an updating, which owes every estimate an answer.
    """

    def __init__(self, *, updates: bool = True) -> None:
        self._updates = updates
        self._blocks: dict[UnitBoot, BlockBook] = {}
        self._boots: dict[tuple[str, str, str], BootCounter] = {}
        self._turbines: dict[str, TurbineBook] = {}
        self._refused: dict[tuple[str, str], Counter[str]] = {}  # turbine, node → blocks by code

    def handle(self, message: Message) -> None:
        """Enter one message."""
        match message:
            case AccelerationBlock():
                self._block(message)
            case StreamGap():
                book = self._latest(message.turbine, message.unit, message.session)
                book.reported.add(message.first_sequence, message.first_sequence + message.n_blocks)
            case StreamEnd():
                self._latest(
                    message.turbine, message.unit, message.session
                ).published = message.n_blocks
            case ModalEstimate():
                self._estimate(self._turbine(message.turbine), message)
            case WindowRejected():
                self._rejection(self._turbine(message.turbine), message)
            case FoundationPosterior():
                self._posterior(self._turbine(message.turbine), message)
            case NodeStatus():
                codes = Counter({each.message: each.count for each in message.refused})
                self._refused[message.turbine, message.node] = codes
                _limit(self._refused)

    def _block(self, block: AccelerationBlock) -> None:
        session = (block.turbine, block.unit, block.session)
        boot = self._boots.setdefault(session, BootCounter()).boot_of(block)
        _limit(self._boots)
        book = self._blocks.setdefault((*session, boot), BlockBook())
        _limit(self._blocks)
        before = len(book.recorded)
        book.recorded.add(block.sequence)
        if len(book.recorded) == before:
            book.repeated += 1
        elif block.sequence in book.reported:
            book.late.add(block.sequence)

    def _latest(self, turbine: str, unit: str, session: str) -> BlockBook:
        """The book of the session's present boot."""
        counter = self._boots.setdefault((turbine, unit, session), BootCounter())
        return self._blocks.setdefault((turbine, unit, session, counter.boot), BlockBook())

    def _turbine(self, turbine: str) -> TurbineBook:
        book = self._turbines.setdefault(turbine, TurbineBook())
        _limit(self._turbines)
        return book

    def _estimate(self, book: TurbineBook, estimate: ModalEstimate) -> None:
        key = _key(estimate)
        if key in book.known:
            return  # given again after a restart
        book.identified += 1
        self._follow(book, estimate)
        book.known[key] = "identified"
        _limit(book.known)
        if self._updates:
            book.pending[key] = 0
            _limit(book.pending)

    def _rejection(self, book: TurbineBook, rejected: WindowRejected) -> None:
        key = _key(rejected)
        fate = book.known.get(key)
        if fate is None:
            book.rejected[rejected.code] += 1
            self._follow(book, rejected)
            book.known[key] = "rejected"
            _limit(book.known)
        elif key in book.pending:
            del book.pending[key]
            book.refused[rejected.code] += 1
            self._answered(book)

    def _posterior(self, book: TurbineBook, posterior: FoundationPosterior) -> None:
        key = _key(posterior)
        if not posterior.origins:  # of an older recording: by the end of its window
            key = next((each for each in book.pending if each[-1] == posterior.time_ns), key)
        if book.pending.pop(key, None) is not None:
            book.in_posterior += 1
            self._answered(book)

    @staticmethod
    def _answered(book: TurbineBook) -> None:
        for key in book.pending:
            book.pending[key] += 1

    @staticmethod
    def _follow(book: TurbineBook, answer: ModalEstimate | WindowRejected) -> None:
        """Note windows between this one and the last of the same boots that have no answer."""
        if not answer.origins:
            return
        boots: WindowKey = tuple((o.unit, o.session, o.boot) for o in answer.origins)
        last = book.last.pop(boots, None)
        book.last[boots] = max(answer.window, -1 if last is None else last)
        _limit(book.last)
        if last is not None and answer.window > last + 1:
            book.skipped.append(
                f"windows {last + 1} to {answer.window - 1} of boot {answer.origins[0].boot} of "
                f"session {answer.origins[0].session} have no answer"
            )

    def violations(self, only: str | None = None) -> list[str]:
        """Where the books do not balance, in words; none: they do. only: of that turbine."""
        found = [
            f"unit {unit} of {turbine}, session {session}, boot {boot}: {text}"
            for (turbine, unit, session, boot), book in self._blocks.items()
            if book.recorded and only in (None, turbine)
            for text in book.violations()
        ]
        for turbine, book in self._turbines.items():
            if only not in (None, turbine):
                continue
            found += [f"{turbine}: {text}" for text in book.skipped]
            forgotten = sum(count >= UNANSWERED for count in book.pending.values())
            if forgotten:
                found.append(
                    f"{turbine}: {forgotten} estimates are neither in the posterior nor refused"
                )
        return found

    def as_json(self, only: str | None = None) -> Json:
        """The books in figures; names are stable. only: of that turbine."""
        violations = self.violations(only)
        return {
            "balanced": not violations,
            "violations": violations,
            "units": [
                {
                    "turbine": turbine,
                    "unit": unit,
                    "session": session,
                    "boot": boot,
                    "published": book.published,
                    "recorded": len(book.recorded),
                    "repeated": book.repeated,
                    "late": len(book.late),
                    "lost": book.lost,
                }
                for (turbine, unit, session, boot), book in self._blocks.items()
                if book.recorded and only in (None, turbine)
            ],
            "refused": {
                node: dict(codes)
                for (turbine, node), codes in self._refused.items()
                if codes and only in (None, turbine)
            },
            "turbines": [
                {
                    "turbine": turbine,
                    "identified": book.identified,
                    "rejected": dict(book.rejected),
                    "in_posterior": book.in_posterior,
                    "refused": dict(book.refused),
                    "pending": len(book.pending),
                }
                for turbine, book in self._turbines.items()
                if only in (None, turbine)
            ],
        }

    @property
    def line(self) -> str:
        """The books in one line."""
        blocks = [book for book in self._blocks.values() if book.recorded]
        books = self._turbines.values()
        return (
            f"{sum(len(each.recorded) for each in blocks)} blocks of {len(blocks)} boots recorded, "
            f"{sum(each.lost for each in blocks)} lost; "
            f"{sum(each.identified for each in books)} windows identified, "
            f"{sum(each.rejected.total() for each in books)} rejected; "
            f"{sum(each.in_posterior for each in books)} estimates in the posterior, "
            f"{sum(each.refused.total() for each in books)} refused, "
            f"{sum(len(each.pending) for each in books)} pending"
        )


def _key(message: ModalEstimate | WindowRejected | FoundationPosterior) -> WindowKey:
    """A window's identity; of an older recording its start and end."""
    if message.origins:
        return tuple(message.origins)
    if isinstance(message, FoundationPosterior):
        return ("ends", message.time_ns)
    return ("lies", message.start_ns, message.end_ns)


def _numbers(first: int, end: int) -> str:
    return f"block {first}" if end == first + 1 else f"blocks {first} to {end - 1}"


def _limit(table: dict[Any, Any]) -> None:
    if len(table) > MOST_BOOKS:
        del table[next(iter(table))]
