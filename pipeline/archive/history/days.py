"""The days of a turbine's history, and the chain of their fingerprints.

    day           2026-01-04   2026-01-05   2026-01-06
    tasks         a b c        d e f        g h
    fingerprint   H₁ ────────► H₂ ────────► H₃          each of the one before and of its tasks

A task belongs to the UTC day that its first window begins in. What a day's windows give depends on
all days before, and on nothing else: two archives with the same fingerprint at a day have the same
history up to it, bit by bit.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

from pipeline.archive.identification import IdentificationCall
from pipeline.archive.store import key_of_result
from pipeline.messages import StreamGap
from sensors.acquisition.blocks import NANOSECONDS


@dataclass(frozen=True, slots=True, eq=False)
class Day:
    """What one UTC day adds to a turbine's history."""

    date: str  # 2026-01-05
    calls: tuple[IdentificationCall, ...]  # in order of time
    gaps: tuple[StreamGap, ...]  # that begin on it
    content: str  # fingerprint of its tasks and gaps

    @property
    def month(self) -> str:
        """2026-01"""
        return self.date[:7]

    def key(self, before: str, done: Sequence[bool]) -> str:
        """Fingerprint of the history up to it.

        before   of the day before; of the turbine's settings for the first
        done     whether each task gave its windows
        """
        return key_of_result("day", before, self.content, "".join("-+"[each] for each in done))


def days_of(calls: Iterable[IdentificationCall], gaps: Iterable[StreamGap]) -> tuple[Day, ...]:
    """Every day on which a task or a gap of one turbine begins; both in order of time."""
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
    content = key_of_result(*(call.task.content for call in calls), *map(repr, gaps))
    return Day(date, tuple(calls), tuple(gaps), content)


def date_of(time_ns: int) -> str:
    """UTC date of a time, 2026-01-05."""
    return datetime.fromtimestamp(time_ns // NANOSECONDS, UTC).date().isoformat()
