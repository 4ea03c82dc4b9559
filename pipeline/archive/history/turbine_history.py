"""What of one turbine's history is there, and the calls that make the rest of it, in order.

months    |  2025-12  |  2026-01           |
days      | ✓ ✓ … ✓ ✓ | ✓ ✓ ✓ ✓ ✓ changed  |     ✓ in the month's files, by its fingerprint
passes                  from here ──►            a call a day, each from the state before it
posteriors                        ▢ ▢ ▢          calls of some windows each, as a day has passed
files                   ◄─ written again ──►

A task belongs to the UTC day that its first window begins in. What a day's windows give depends on
all days before, and on nothing else. A day's fingerprint is made of the one before and of its
tasks: two archives with the same fingerprint at a day have the same history up to it, bit by bit.
"""

from collections import defaultdict
from collections.abc import Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import chain, groupby, pairwise
from pathlib import Path

from pipeline.archive.history.day_pass import (
    DayCall,
    HistoryPlan,
    day_frames,
    passed_day,
)
from pipeline.archive.history.months import (
    WHOLE_MONTHS,
    MonthWriter,
    WrittenDay,
    WrittenMonth,
    forget_months,
    written_months,
)
from pipeline.archive.identification import IdentificationCall
from pipeline.archive.store import FinishedResults, StoredFrame, key_of_result
from pipeline.archive.turbines import TurbineArchive
from pipeline.archive.work import Call
from pipeline.messages import StreamGap
from sensors.acquisition.blocks import NANOSECONDS
from sensors.errors import InputError


@dataclass(frozen=True, slots=True, eq=False)
class Day:
    """What one UTC day adds to a turbine's history."""

    date: str
    """2026-01-05."""
    calls: tuple[IdentificationCall, ...]
    """In order of time."""
    gaps: tuple[StreamGap, ...]
    """That begin on it."""
    content: str
    """Fingerprint of its tasks and gaps."""

    @property
    def month(self) -> str:
        """2026-01"""
        return self.date[:7]

    def key(self, before: str, done: Sequence[bool]) -> str:
        """Fingerprint of the history up to this day.

        Parameters
        ----------
        before : str
            Of the day before; of the turbine's settings for the first.
        done : sequence of bool
            Whether each task gave its windows.
        """
        return key_of_result("day", before, self.content, "".join("-+"[each] for each in done))


def days_of(calls: Iterable[IdentificationCall], gaps: Iterable[StreamGap]) -> tuple[Day, ...]:
    """Return every day on which a task or a gap of one turbine begins; both in order of time."""
    calls_of: dict[str, list[IdentificationCall]] = defaultdict(list)
    gaps_of: dict[str, list[StreamGap]] = defaultdict(list)
    for call in calls:
        calls_of[date_of(call.task.start_ns)].append(call)
    for gap in gaps:
        gaps_of[date_of(gap.start_ns)].append(gap)
    return tuple(
        _day(date, calls_of.get(date, []), gaps_of.get(date, []))
        for date in sorted({*calls_of, *gaps_of})
    )


def _day(date: str, calls: Sequence[IdentificationCall], gaps: Sequence[StreamGap]) -> Day:
    later = [repr((n, call.period)) for n, call in enumerate(calls) if call.period]
    later += [repr((n, call.renamed)) for n, call in enumerate(calls) if call.renamed]
    content = key_of_result(*(call.task.content for call in calls), *map(repr, gaps), *later)
    return Day(date, tuple(calls), tuple(gaps), content)


def date_of(time_ns: int) -> str:
    """UTC date of a time, 2026-01-05."""
    return datetime.fromtimestamp(time_ns // NANOSECONDS, UTC).date().isoformat()


class TurbineHistory:
    """One turbine's history among an archive's results.

    Parameters
    ----------
    turbine : TurbineArchive
        What the archive holds of it.
    results : Path
        Folder of the tables.
    finished : FinishedResults
        What is kept from run to run.
    """

    def __init__(self, turbine: TurbineArchive, results: Path, finished: FinishedResults) -> None:
        self._name = turbine.plan.turbine
        self._plan = history_plan(turbine)
        self._days = days_of(turbine.identification, turbine.plan.gaps)
        self._results = results
        self._finished = finished
        self._awaited: set[str] = set()
        self._failed: set[str] = set()
        self._months = written_months(results, self._name)
        self._written: dict[str, str] = {}
        for month in self._months.values():
            self._written |= month.keys
        self.found = 0
        """Days that the files had, and results that an earlier run had left."""
        self.done = 0
        """Days that are in the files now."""
        self._look()

    @property
    def n_tasks(self) -> int:
        """Number of identification tasks in all."""
        return sum(len(day.calls) for day in self._days)

    @property
    def n_days(self) -> int:
        """Number of days in all."""
        return len(self._days)

    @property
    def missing(self) -> tuple[IdentificationCall, ...]:
        """Identification that is still to be done, in order of time; it may fail again."""
        return tuple(
            call
            for number, day in enumerate(self._days)
            if number >= self._first_pass or number in self._incomplete
            for call in day.calls
            if self._finished.get(call.key) is None
        )

    def _look(self) -> None:
        """Fingerprints as far as the files have them, and with which day the passes begin."""
        self._keys: list[str] = []
        self._incomplete: set[int] = set()  # days without the windows of a task that failed
        for number, day in enumerate(self._days):
            key = self._written_key(number, day)
            if key is None:
                break
            self._keys.append(key)
        self._first_pass = len(self._keys)
        while 0 < self._first_pass < len(self._days):
            if self._finished.get(state_key(self._keys[self._first_pass - 1])) is not None:
                break
            self._first_pass -= 1

    def _before(self, number: int) -> str:
        return self._keys[number - 1] if number else self._plan.key

    def _written_key(self, number: int, day: Day) -> str | None:
        """Return the day's fingerprint if the files have it; None if they do not."""
        written = self._written.get(day.date)
        if written is None:
            return None
        if day.key(self._before(number), [True] * len(day.calls)) == written:
            return written
        self._incomplete.add(number)
        return written if self._key(number, day) == written else None

    def _key(self, number: int, day: Day) -> str:
        """Return the day's fingerprint by the tasks that have given their windows."""
        done = [self._finished.get(call.key) is not None for call in day.calls]
        return day.key(self._before(number), done)

    def settle(self, key: str, *, failed: bool) -> bool:
        """A call is over and its result kept; whether it is this turbine's."""
        if key not in self._awaited:
            return False
        self._awaited.discard(key)
        if failed:
            self._failed.add(key)
        return True

    def calls(self) -> Iterator[Call | None]:
        """Every call that is to be done, in order; None where one that is under way must end first.

        A month's files are written when all of its days are there.
        """
        self._look()
        first = self.found = self.done = self._first_pass
        forget_months(self._results, self._name, self._months.keys() - self._all_months)
        state = self._state_before(first)
        days = list(enumerate(self._days))[first:]
        for month, group in groupby(days, key=lambda each: each[1].month):
            numbers = []
            for number, day in group:
                passed = yield from self._passed(number, day, state)
                if passed is None:
                    return  # without it nothing after it can be known
                state = passed
                numbers.append(number)
            while self._awaited:
                yield None
            self._write(month)
            self.done += len(numbers)
        self._forget_states()

    @property
    def _all_months(self) -> set[str]:
        return {day.month for day in self._days}

    def _state_before(self, number: int) -> tuple[StoredFrame, ...]:
        return (self._finished.get(state_key(self._keys[number - 1])) or ()) if number else ()

    def _passed(
        self, number: int, day: Day, state: tuple[StoredFrame, ...]
    ) -> Generator[Call | None, None, tuple[StoredFrame, ...] | None]:
        """The pass over a day and the calls for its posteriors; the state after it, None where it
        failed."""
        if number == len(self._keys):
            self._keys.append(self._key(number, day))
        key = self._keys[number]
        frames = self._finished.get(_pass_key(key))
        if frames is None:
            call = DayCall(self._plan, state, tuple(self._answers(day)))
            yield self._awaiting(Call(_pass_key(key), day_frames, call))
            while _pass_key(key) in self._awaited:
                yield None
            frames = self._finished.get(_pass_key(key))
        else:
            self.found += 1
        if frames is None:
            return None
        passed = passed_day(self._plan, frames)
        self._finished.put(state_key(key), passed.state)
        if self._written.get(day.date) != key:
            for posterior in passed.calls:
                if posterior.key in self._finished:
                    self.found += 1
                else:
                    yield self._awaiting(posterior)
        return passed.state

    def _answers(self, day: Day) -> Iterator[tuple[int, tuple[StoredFrame, ...]]]:
        """Windows of a day, those in a row of one layout period together."""
        for period, calls in groupby(day.calls, key=lambda call: call.period):
            answers = (self._finished.get(call.key) or () for call in calls)
            yield period, tuple(chain.from_iterable(answers))

    def _awaiting(self, call: Call) -> Call:
        self._awaited.add(call.key)
        return call

    def _write(self, month: str) -> None:
        """The month's files, unless they have all of its days and no other; what only led to them
        is forgotten."""
        numbers = [n for n, day in enumerate(self._days) if day.month == month]
        keys = {self._days[number].date: self._keys[number] for number in numbers}
        before = self._months.get(month, WrittenMonth())
        used = [_pass_key(key) for key in keys.values()]
        if before.keys != keys:
            writer = MonthWriter(self._results, self._name, month, before)
            for number in numbers:
                used += self._add(writer, self._days[number], self._keys[number])
            self._months[month] = writer.finished()
        gone = set(before.keys.values()) - set(keys.values())
        self._finished.forget([*used, *map(state_key, gone)])

    def _add(self, writer: MonthWriter, day: Day, key: str) -> list[str]:
        """A day into the month's files; the keys of the results that it was made of."""
        if self._written.get(day.date) == key and writer.copied(key):
            return []
        frames = self._finished.get(_pass_key(key))
        if frames is None:
            raise InputError(
                f"{self._results}: the tables have lost {day.date} of {self._name}; remove them "
                f"and the folder {WHOLE_MONTHS}, and run the command again"
            )
        passed = passed_day(self._plan, frames)
        results = {call.key: self._finished.get(call.key) for call in passed.calls}
        messages = chain(passed.messages(lambda key: results[key] or ()), day.gaps)
        writer.add(day.date, key, messages, whole=None not in results.values())
        return [key for key, frames in results.items() if frames is not None]

    def _forget_states(self) -> None:
        """States within months before the newest; that of a month's last day stays."""
        newest = self._days[-1].month if self._days else ""
        within = [
            self._keys[number]
            for number, (day, after) in enumerate(pairwise(self._days))
            if day.month == after.month < newest
        ]
        self._finished.forget(map(state_key, within))

    @property
    def written(self) -> Iterator[WrittenDay]:
        """The days in the files, with what they hold."""
        for month in self._months.keys() & self._all_months:
            yield from self._months[month].days


def _pass_key(day: str) -> str:
    """Return the key of the pass over a day, by the day's fingerprint."""
    return key_of_result("pass", day)


def state_key(day: str) -> str:
    """Return the key of the state after a day, by the day's fingerprint."""
    return key_of_result("state", day)


def history_plan(turbine: TurbineArchive) -> HistoryPlan:
    """Return the plan of one turbine's archive."""
    updating, oma = turbine.updating_by_period, turbine.scenario.oma
    key = key_of_result(
        "history",
        turbine.plan.turbine,
        repr((turbine.channels, oma, turbine.layouts)),
        *([each.key for each in updating] or [""]),
    )
    return HistoryPlan(turbine.plan.turbine, turbine.channels, oma.hop, updating, key)
