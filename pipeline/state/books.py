"""The books of a run: every block, window and estimate has one fate.

    blocks       published = recorded + lost + refused           of each unit and boot
    windows      identified | rejected (reason)                  of each turbine
    estimates    in the posterior | refused (reason) | pending
    answers      of a window that has another one by now: superseded

What does not balance is a violation, with where it is. The books are kept from messages alone: live
by the status and the summary, offline by `pilewatch audit` from the files.
"""

from bisect import bisect_right
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field
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
UNBALANCED = 2  # windows that were answered while books do not balance, after which it is an alarm
WITHOUT_POSTERIOR = 6  # windows that were answered without a posterior, after which it is an alarm
IN_POSTERIOR = "in-posterior"  # fate of an estimate
UPDATING = "updating"  # name of the node, or the beginning of its shares' names
REPORTED_WITHIN = 5  # blocks after which missing ones are reported: they may be late
LATEST_WINDOWS = 20  # whose fates are listed

UnitBoot = tuple[str, str, str, int]  # turbine, unit, session, boot
WindowKey = tuple[object, ...]


@dataclass(frozen=True, slots=True)
class BooksAlarm:
    """What a person must look into although nothing has failed."""

    turbine: str
    kind: str
    """"books": they do not balance; "no-posterior": windows are answered and none comes."""
    text: str


@dataclass(slots=True)
class WindowFate:
    """What became of one window."""

    window: int
    start_ns: int
    fate: str
    """"identified", or the reason's code."""
    estimate: str = ""
    """Of an identified window: "pending", "in-posterior", or the code why it was refused."""


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
            yield f"{_numbers(first, end)} are neither recorded nor reported missing"
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
    """Estimates without an answer of the updating, in their order → later ones answered since."""
    known: dict[WindowKey, WindowFate] = field(default_factory=dict)
    """Fates of the latest windows."""
    superseded: int = 0
    """Answers of windows that have another one by now."""
    without_posterior: int = 0
    """Windows that were answered since the last posterior."""
    unbalanced: int = 0
    """Windows on end that were answered while the books did not balance."""
    early: dict[WindowKey, str] = field(default_factory=dict)
    """The last answer of the updating that may have overtaken its estimate on the way: two nodes
    send them, and nothing orders what different nodes send."""
    last: dict[WindowKey, int] = field(default_factory=dict)
    """Boots of the units → number of their last window."""
    skipped: list[str] = field(default_factory=list)
    """Windows that have no fate, in words."""


class Books:
    """Keeps the books of a run from its messages.

    Parameters
    ----------
    updates : bool, optional
        Whether the run has an updating, which owes every estimate an answer; None: it has one
        when one is heard of.
    """

    def __init__(self, *, updates: bool | None = None) -> None:
        self._updates = updates
        self._is_updating = bool(updates)
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
                end = message.first_sequence + message.n_blocks
                book = self._book_at(_session(message), end, message.end_ns)
                book.reported.add(message.first_sequence, end)
            case StreamEnd():
                book = self._book_at(_session(message), message.n_blocks, message.time_ns)
                book.published = message.n_blocks
            case ModalEstimate():
                self._estimate(self._turbine(message.turbine), message)
            case WindowRejected():
                self._rejection(self._turbine(message.turbine), message)
            case FoundationPosterior():
                self._note_updating()
                self._posterior(self._turbine(message.turbine), message)
            case NodeStatus():
                if message.node.partition("-")[0] == UPDATING:
                    self._note_updating()
                codes = Counter({each.message: each.count for each in message.refused})
                self._refused[message.turbine, message.node] = codes
                _limit(self._refused)

    def _note_updating(self) -> None:
        self._is_updating = self._updates is not False

    def _block(self, block: AccelerationBlock) -> None:
        session = _session(block)
        counter = self._boots.setdefault(session, BootCounter())
        present = self._blocks.get((*session, counter.boot))
        repeats = present is not None and block.sequence in present.recorded
        unused = counter.unused_before(block)
        boot = counter.boot_of(block, repeats=repeats)
        _limit(self._boots)
        book = self._blocks.setdefault((*session, boot), BlockBook())
        _limit(self._blocks)
        if counter.also and present is not None:  # they were taken for the same once more
            present.repeated -= counter.also
            book.recorded.add(block.sequence - counter.also, block.sequence)
        book.unused.add(block.sequence - unused, block.sequence)
        before = len(book.recorded)
        book.recorded.add(block.sequence)
        if len(book.recorded) == before:
            book.repeated += 1
        elif block.sequence in book.reported:
            book.late.add(block.sequence)

    def _book_at(self, session: tuple[str, str, str], sequence: int, time_ns: int) -> BlockBook:
        """The book of the boot whose block of that number begins at that time, else the present."""
        boot = self._boots.setdefault(session, BootCounter()).boot_at(sequence, time_ns)
        return self._blocks.setdefault((*session, boot), BlockBook())

    def _turbine(self, turbine: str) -> TurbineBook:
        book = self._turbines.setdefault(turbine, TurbineBook())
        _limit(self._turbines)
        return book

    def _estimate(self, book: TurbineBook, estimate: ModalEstimate) -> None:
        key = _key(estimate)
        known = book.known.get(key)
        if known is not None and known.fate == "identified":
            return  # given again after a restart
        early = book.early.get(key, "") if self._is_updating else ""
        book.early.clear()
        if known is None:
            self._follow(book, estimate)
        else:
            book.rejected -= Counter({known.fate: 1})
            book.superseded += not early
        book.identified += 1
        pending = "" if self._updates is False else early or "pending"
        book.known[key] = WindowFate(estimate.window, estimate.start_ns, "identified", pending)
        _limit(book.known)
        if early:
            book.in_posterior += early == IN_POSTERIOR
            book.refused += Counter({early: early != IN_POSTERIOR})
        elif self._updates is not False:
            book.pending[key] = 0
            _limit(book.pending)
        self._note_answer(estimate.turbine, book)

    def _rejection(self, book: TurbineBook, rejected: WindowRejected) -> None:
        key = _key(rejected)
        known = book.known.get(key)
        if known is None:
            book.rejected[rejected.code] += 1
            self._follow(book, rejected)
            book.known[key] = WindowFate(rejected.window, rejected.start_ns, rejected.code)
            book.early = {key: rejected.code}
            _limit(book.known)
            self._note_answer(rejected.turbine, book)
        elif key in book.pending:
            self._answered(book, key)
            book.refused[rejected.code] += 1
            known.estimate = rejected.code
        elif known.fate == "identified" and rejected.code != known.estimate:
            book.superseded += 1  # by the estimate that the posterior has

    def _posterior(self, book: TurbineBook, posterior: FoundationPosterior) -> None:
        key = _key(posterior)
        if not posterior.origins:  # of an older recording: by the end of its window
            key = next((each for each in book.pending if each[-1] == posterior.time_ns), key)
        if key in book.pending:
            self._answered(book, key)
            book.in_posterior += 1
            if key in book.known:
                book.known[key].estimate = IN_POSTERIOR
        elif key not in book.known:
            book.early = {key: IN_POSTERIOR}
        book.without_posterior = 0

    def _note_answer(self, turbine: str, book: TurbineBook) -> None:
        """Look, when a window is answered, whether books balance and posteriors come."""
        book.without_posterior += 1
        book.unbalanced = book.unbalanced + 1 if any(self._violations_of(turbine)) else 0

    @staticmethod
    def _answered(book: TurbineBook, answered: WindowKey) -> None:
        """Strike out an estimate. One that came before it and is still pending was passed over; one
        that came after it only waits for a slow updating."""
        for key in book.pending:
            if key == answered:
                break
            book.pending[key] += 1
        del book.pending[answered]

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
        if only is not None:
            return [*self._violations_of(only)]
        turbines = dict.fromkeys([*(key[0] for key in self._blocks), *self._turbines])
        return [text for turbine in turbines for text in self._violations_of(turbine)]

    def _violations_of(self, turbine: str) -> Iterator[str]:
        refused = self._refused_blocks(turbine)
        for (of, unit, session, boot), blocks in self._blocks.items():
            if of != turbine or not blocks.recorded:
                continue
            place = f"unit {unit} of {turbine}, session {session}, boot {boot}"
            yield from (f"{place}: {text}" for text in blocks.violations())
            for first, end, there in blocks.refuted:
                if there > refused:
                    yield f"{place}: {_numbers(first, end)} are reported missing and recorded"
                refused = max(0, refused - there)
        book = self._turbines.get(turbine)
        if book is None:
            return
        yield from (f"{turbine}: {text}" for text in book.skipped)
        forgotten = sum(count >= UNANSWERED for count in book.pending.values())
        if forgotten and self._is_updating:
            estimates = "estimate is" if forgotten == 1 else "estimates are"
            yield f"{turbine}: {forgotten} {estimates} neither in the posterior nor refused"

    def _refused_blocks(self, turbine: str) -> int:
        """Blocks that the identification refused: it misses them although they are recorded."""
        return sum(
            codes.total()
            for (of, node), codes in self._refused.items()
            if of == turbine and node.partition("-")[0] != UPDATING
        )

    def alarms(self, without_posterior: int = WITHOUT_POSTERIOR) -> list[BooksAlarm]:
        """What a person must look into now.

        Parameters
        ----------
        without_posterior : int
            Windows that may be answered on end without a posterior.
        """
        found = []
        for turbine, book in self._turbines.items():
            violations = [*self._violations_of(turbine)] if book.unbalanced >= UNBALANCED else []
            if violations:
                rest = f" (and {len(violations) - 1} more)" if len(violations) > 1 else ""
                text = f"the books do not balance: {violations[0]}{rest}"
                found.append(BooksAlarm(turbine, "books", text))
            if self._is_updating and book.without_posterior >= without_posterior:
                text = (
                    f"no posterior for {book.without_posterior} windows: of all "
                    f"{book.identified} were identified, {book.rejected.total()} rejected "
                    f"({_counted(book.rejected)}), {book.refused.total()} estimates refused "
                    f"({_counted(book.refused)})"
                )
                found.append(BooksAlarm(turbine, "no-posterior", text))
        return found

    def as_json(self, only: str | None = None) -> Json:
        """The books in figures; names are stable. only: of that turbine."""
        violations = self.violations(only)
        return {
            "balanced": not violations,
            "violations": violations,
            "alarms": [asdict(alarm) for alarm in self.alarms() if only in (None, alarm.turbine)],
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
                    "superseded": book.superseded,
                    "windows": [
                        asdict(fate) for fate in list(book.known.values())[-LATEST_WINDOWS:]
                    ],
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
        refused = sum(self._refused.values(), Counter[str]())
        not_used = f", {refused.total()} not used ({_counted(refused)})" if refused else ""
        return (
            f"{sum(len(each.recorded) for each in blocks)} blocks of {len(blocks)} boots recorded, "
            f"{sum(each.lost for each in blocks)} lost{not_used}; "
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


def _session(message: AccelerationBlock | StreamGap | StreamEnd) -> tuple[str, str, str]:
    return message.turbine, message.unit, message.session


def _numbers(first: int, end: int) -> str:
    return f"block {first}" if end == first + 1 else f"blocks {first} to {end - 1}"


def _counted(codes: Counter[str]) -> str:
    return ", ".join(f"{count} × {code}" for code, count in codes.most_common()) or "none"


def _limit(table: dict[Any, Any]) -> None:
    if len(table) > MOST_BOOKS:
        del table[next(iter(table))]
