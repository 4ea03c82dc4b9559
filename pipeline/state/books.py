"""The books of a run: every block, window and estimate has one fate.

    blocks       published = recorded + lost + refused           of each unit and boot
    windows      identified | rejected (reason)                  of each turbine
    estimates    in the posterior | refused (reason) | pending
    answers      of a window that has another one by now: superseded
    instruments  messages read, and those lost, late or malformed, of each feed

What does not balance is a violation, with where it is. The books are kept from messages alone: live
by the status and the summary, offline by `pilewatch audit` from the files.
"""

from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field

from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    StreamEnd,
    StreamGap,
    WindowRejected,
)
from pipeline.state.instrument_book import InstrumentBook, InstrumentMessages
from pipeline.state.phrases import block_numbers, codes_in_words, count_noun
from pipeline.state.time_spans import covered
from pipeline.state.turbine_book import TurbineBook, bounded_table
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.boots import NOTABLE_CLOCK_STEP, BootCounter
from sensors.bounded_dict import BoundedDict
from sensors.intervals import Intervals
from sensors.json_values import Json

UNBALANCED = 2  # windows that were answered while books do not balance, after which it is an alarm
WITHOUT_POSTERIOR = 6  # windows that were answered without a posterior, after which it is an alarm
UPDATING = "updating"  # name of the node
MISSED = ("lost", "late", "malformed")  # messages of instruments of which nothing is in a block
REPORTED_WITHIN = 5  # blocks after which missing ones are reported: they may be late
UnitBoot = tuple[str, str, str, int]  # turbine, unit, session, boot


@dataclass(slots=True)
class BlockBook:
    """What became of the blocks of one boot of one unit: sets of block numbers."""

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
    received: int = 0
    """Different blocks that a run received, recorded or not, where it says so."""
    start_ns: int | None = None
    """Earliest stamp of a block that arrived [ns]."""
    end_ns: int | None = None
    """Latest end of one [ns]."""
    outside: int = 0
    """Of those that arrived, the ones outside of the period that is looked at: they show whether
    blocks are missing at its edges."""

    def enter(self, block: AccelerationBlock, *, unused_before: int) -> bool:
        """Enter a block that arrived; return whether for the first time.

        Parameters
        ----------
        unused_before : int
            Numbers that its unit passed over before it.
        """
        number = block.sequence
        self.start_ns = min(block.start_ns, self.start_ns or block.start_ns)
        self.end_ns = max(block.end_ns, self.end_ns or block.end_ns)
        self.unused.add(number - unused_before, number)
        before = len(self.recorded)
        self.recorded.add(number)
        is_new = len(self.recorded) > before
        if not is_new:
            self.repeated += 1
        elif number in self.reported:
            self.late.add(number)
        return is_new

    @property
    def lost(self) -> int:
        """Blocks that are missing between those that arrived, and at the end; those that a run
        received and could not record."""
        inside = max(len(self.missing), self.received - len(self.recorded))
        if self.published is None:
            return inside
        return max(inside, self.published - len(self.recorded) - self.repeated)

    @property
    def is_known(self) -> bool:
        """Whether a block of the period arrived, or is missing from it."""
        return self.n_recorded > 0 or self.received > 0 or bool(self.outside and self.missing)

    @property
    def n_recorded(self) -> int:
        """Different blocks that arrived, of the period that is looked at."""
        return len(self.recorded) - self.outside

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
        """Yield in words where the book does not balance, except blocks reported that arrived."""
        missing = self.missing
        for first, end in missing - self.reported:
            if self.published is None and end > self.recorded.end - REPORTED_WITHIN:
                continue  # they may still come
            yield f"{block_numbers(first, end)} neither recorded nor reported missing"
        unrecorded = self.received - len(self.recorded) - len(missing)
        if unrecorded > 0:
            yield (
                f"{unrecorded} of {self.received} received blocks are not recorded: recording had "
                "stopped"
            )
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
        """Return the book in figures; names are stable."""
        return {
            "published": self.published,
            "recorded": self.n_recorded,
            "repeated": self.repeated,
            "late": len(self.late),
            "lost": self.lost,
        }


def pauses_before(books: Mapping[UnitBoot, BlockBook]) -> dict[UnitBoot, tuple[int, int]]:
    """Return when a unit was silent before each of its boots, by its stamps [ns since 1970].

    Before the first, and between boots that follow each other or overlap, it was not.
    """
    spans = [
        (book.start_ns, book.end_ns, boot)
        for boot, book in books.items()
        if book.start_ns is not None and book.end_ns is not None
    ]
    ends: dict[tuple[str, str], int] = {}  # of a unit's boots so far
    found: dict[UnitBoot, tuple[int, int]] = {}
    for start_ns, end_ns, boot in sorted(spans):
        before_ns = ends.get(boot[:2], start_ns)
        if start_ns - before_ns > NOTABLE_CLOCK_STEP * NANOSECONDS:
            found[boot] = before_ns, start_ns
        ends[boot[:2]] = max(before_ns, end_ns)
    return found


@dataclass(frozen=True, slots=True)
class BooksAlarm:
    """What a person must look into although nothing has failed."""

    turbine: str
    kind: str
    """"books": they do not balance; "no-posterior": windows are answered and none comes."""
    text: str


class Books:
    """Keeps the books of a run from its messages.

    Parameters
    ----------
    updates : bool, optional
        Whether the run has an updating, which owes every estimate an answer; None: it has one
        when one has sent anything.
    """

    def __init__(self, *, updates: bool | None = None) -> None:
        self._updates = updates
        self._is_updating = bool(updates)
        self._blocks: BoundedDict[UnitBoot, BlockBook] = bounded_table()
        self._boots: BoundedDict[tuple[str, str, str], BootCounter] = bounded_table()
        self._turbines: BoundedDict[str, TurbineBook] = bounded_table()
        self._nodes: BoundedDict[tuple[str, str], NodeStatus] = bounded_table()
        self._instruments: BoundedDict[tuple[str, str], InstrumentBook] = bounded_table()

    def handle(self, message: Message, *, outside: bool = False) -> bool:
        """Enter one message; False: a block that has come before.

        Parameters
        ----------
        message : Message
            In the order of coming.
        outside : bool, optional
            Whether it is a block beside the period that is looked at: it is not counted.
        """
        match message:
            case AccelerationBlock():
                return self._block(message, outside=outside)
            case StreamGap():
                end = message.first_sequence + message.n_blocks
                book = self._book_at(_session(message), end, message.end_ns)
                book.reported.add(message.first_sequence, end)
            case StreamEnd():
                book = self._book_at(_session(message), message.n_blocks, message.time_ns)
                book.published = message.n_blocks
            case ModalEstimate() | WindowRejected():
                self._answer(message)
            case FoundationPosterior():
                self._note_updating()
                self._turbine(message.turbine).enter_posterior(message)
            case NodeStatus():
                if message.is_of(UPDATING):
                    self._note_updating()
                self._nodes[message.turbine, message.node] = message
                self._note_instrument(message)
        return True

    def _note_updating(self) -> None:
        self._is_updating = self._updates is not False

    def _note_instrument(self, status: NodeStatus) -> None:
        counts = InstrumentMessages.of(status)
        if counts is not None:
            book = self._instruments.setdefault((status.turbine, status.node), InstrumentBook())
            book.enter(counts)

    def _block(self, block: AccelerationBlock, *, outside: bool) -> bool:
        session = _session(block)
        counter = self._boots.pop(session, None) or BootCounter()
        self._boots[session] = counter  # of too many, those that sent nothing for longest go
        present = self._blocks.get((*session, counter.boot))
        repeats = present is not None and block.sequence in present.recorded
        unused = counter.unused_before(block)
        boot = counter.boot_of(block, repeats=repeats)
        book = self._blocks.pop((*session, boot), None) or BlockBook()
        self._blocks[(*session, boot)] = book
        if counter.also and present is not None:  # they were taken for the same once more
            present.repeated -= counter.also
            book.recorded.add(block.sequence - counter.also, block.sequence)
        is_new = book.enter(block, unused_before=unused)
        book.outside += is_new and outside
        return is_new

    def _book_at(self, session: tuple[str, str, str], sequence: int, time_ns: int) -> BlockBook:
        """The book of the boot whose block of that number begins at that time, else the present."""
        boot = self._boots.setdefault(session, BootCounter()).boot_at(sequence, time_ns)
        return self._blocks.setdefault((*session, boot), BlockBook())

    def enter_received(self, session: tuple[str, str, str], n_blocks: int) -> None:
        """Enter how many blocks of a session a run received, recorded or not.

        Parameters
        ----------
        session : tuple of str
            Turbine, unit, session.
        n_blocks : int
            Different blocks, of all boots.
        """
        books = [book for key, book in self._blocks.items() if key[:3] == session]
        if not books:
            books = [self._blocks.setdefault((*session, 0), BlockBook())]
        *others, last = books
        there = sum(len(book.recorded) for book in others)
        last.received = max(last.received, n_blocks - there)

    def _turbine(self, turbine: str) -> TurbineBook:
        return self._turbines.setdefault(turbine, TurbineBook())

    def _answer(self, answer: ModalEstimate | WindowRejected) -> None:
        """Enter it; look, when a window is answered, whether books balance and posteriors come."""
        book = self._turbine(answer.turbine)
        if isinstance(answer, WindowRejected):
            is_first = book.enter_rejection(answer)
        else:
            awaited = self._updates is not False
            is_first = book.enter_estimate(answer, updated=self._is_updating, awaited=awaited)
        if is_first:
            book.without_posterior += 1
            balanced = not any(self._violations_of(answer.turbine))
            book.unbalanced = 0 if balanced else book.unbalanced + 1

    def violations(self, only: str | None = None) -> list[str]:
        """Return where the books do not balance, in words; none where they do.

        Parameters
        ----------
        only : str, optional
            A turbine; None: of all of them.
        """
        known = dict.fromkeys([*(key[0] for key in self._blocks), *self._turbines])
        turbines = known if only is None else (only,)
        return [text for turbine in turbines for text in self._violations_of(turbine)]

    def _violations_of(self, turbine: str) -> Iterator[str]:
        unread: int | None = None  # many names may have been refused: counted when it matters
        for (of, unit, session, boot), blocks in self._blocks.items():
            if of != turbine or not blocks.is_known:
                continue
            place = f"unit {unit} of {turbine}, session {session}, boot {boot}"
            yield from (f"{place}: {text}" for text in blocks.violations())
            for first, end, there in blocks.refuted:
                unread = self._unread_blocks(turbine) if unread is None else unread
                if there > unread:
                    numbers = block_numbers(first, end)
                    yield f"{place}: {numbers} reported missing and recorded"
                unread = max(0, unread - there)
        book = self._turbines.get(turbine)
        if book is None:
            return
        yield from (f"{turbine}: {text}" for text in book.skipped)
        if book.forgotten and self._is_updating:
            estimates = "estimate is" if book.forgotten == 1 else "estimates are"
            yield f"{turbine}: {book.forgotten} {estimates} neither in the posterior nor refused"

    def _unread_blocks(self, turbine: str) -> int:
        """Blocks that the identification misses although they are recorded.

        It refused them, or they came too late: a late block may get here before the report that
        it is missing, since another node sends that.
        """
        others = [
            status
            for (of, node), status in self._nodes.items()
            if of == turbine and not status.is_of(UPDATING) and (of, node) not in self._instruments
        ]
        refused = sum(_refused_by(status).total() for status in others)
        seen_late = sum(len(book.late) for key, book in self._blocks.items() if key[0] == turbine)
        return refused + max(0, sum(status.late for status in others) - seen_late)

    def alarms(self, without_posterior: int = WITHOUT_POSTERIOR) -> list[BooksAlarm]:
        """Return what a person must look into now.

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
                text = f"no posterior for {book.without_posterior} windows: of all {book.line}"
                found.append(BooksAlarm(turbine, "no-posterior", text))
        return found

    def as_json(self, only: str | None = None) -> Json:
        """Return the books in figures; names are stable. For `only` see `violations`."""
        violations, pauses = self.violations(only), pauses_before(self._blocks)
        names = ("turbine", "unit", "session", "boot")
        return {
            "balanced": not violations,
            "violations": violations,
            "alarms": [asdict(alarm) for alarm in self.alarms() if only in (None, alarm.turbine)],
            "units": [
                dict(zip(names, boot, strict=True))
                | book.as_json()
                | {"pause_before_s": covered([pauses.get(boot, (0, 0))]) / NANOSECONDS}
                for boot, book in sorted(self._blocks.items(), key=lambda each: each[0])
                if book.is_known and only in (None, boot[0])
            ],
            "refused": {
                node: dict(_refused_by(status))
                for (turbine, node), status in self._nodes.items()
                if status.refused and only in (None, turbine)
            },
            "instruments": [
                {"turbine": turbine, "node": node} | book.as_json()
                for (turbine, node), book in self._instruments.items()
                if only in (None, turbine)
            ],
            "turbines": [
                {"turbine": turbine} | book.as_json()
                for turbine, book in self._turbines.items()
                if only in (None, turbine)
            ],
        }

    def silence(self, turbine: str) -> float:
        """Return for how long a unit of a turbine, or several at once, was between boots [s]."""
        pauses = pauses_before(self._blocks)
        return covered(pauses[boot] for boot in pauses if boot[0] == turbine) / NANOSECONDS

    @property
    def is_empty(self) -> bool:
        """Whether there is neither a block nor a window."""
        known = (book for book in self._blocks.values() if book.is_known)
        return next(known, None) is None and not self._turbines

    @property
    def line(self) -> str:
        """The books in one line."""
        blocks = [book for book in self._blocks.values() if book.is_known]
        books = self._turbines.values()
        refused = sum(map(_refused_by, self._nodes.values()), Counter[str]())
        silent = sum(self.silence(turbine) for turbine in {boot[0] for boot in self._blocks})
        pauses = f" ({silent:.0f} s without samples between boots)" if silent else ""
        unused = f", {refused.total()} not used ({codes_in_words(refused)})" if refused else ""
        recorded = sum(each.n_recorded for each in blocks)
        return (
            f"{count_noun(recorded, 'block')} of "
            f"{count_noun(len(blocks), 'boot')} recorded{pauses}, "
            f"{sum(each.lost for each in blocks)} lost{unused}{self._instruments_line}; "
            f"{count_noun(sum(each.identified for each in books), 'window')} identified, "
            f"{sum(each.rejected.total() for each in books)} rejected; "
            f"{count_noun(sum(each.in_posterior for each in books), 'estimate')} in the posterior, "
            f"{sum(each.refused.total() for each in books)} refused, "
            f"{sum(len(each.pending) for each in books)} pending"
        )

    @property
    def _instruments_line(self) -> str:
        """What is missing of the instruments' messages; nothing where nothing is."""
        totals = [book.total for book in self._instruments.values()]
        missing = Counter({name: sum(getattr(each, name) for each in totals) for name in MISSED})
        told = codes_in_words(+missing)
        return f"; of the instruments' messages {told}" if missing.total() else ""


def _refused_by(status: NodeStatus) -> Counter[str]:
    """Blocks that a node did not use, by the reason's code."""
    return Counter({each.message: each.count for each in status.refused})


def _session(message: AccelerationBlock | StreamGap | StreamEnd) -> tuple[str, str, str]:
    return message.turbine, message.unit, message.session
