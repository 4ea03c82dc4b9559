"""Stamps of a clock that is set while a file is written → UTC, batch by batch.

    02:59:59.95, 02:00:00.00      an hour back, in autumn: the stamps behind it are an hour later
    01:59:59.95, 03:00:00.00      an hour ahead, in spring: no sample is missing
    23:59:59.95, 00:00:00.00      times of day without a date: the next day
    86399.95, 0.00                seconds since midnight: the next day

Where a zone is stated, its clock changes when the zone's does and never else: of UTC and of other
fixed offsets an hour without rows is missing. Where none is stated, the rows alone show a change.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta, tzinfo

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.constants import DAY
from sensors.files.table import zone_named
from sensors.files.text.dates import offset_name, zone_offset_ns

HOUR = 3600 * NANOSECONDS  # [ns]
SLACK = 60 * NANOSECONDS  # by which a clock may be set too late, or back further than an hour [ns]
WHOLE_DAY = round(DAY) * NANOSECONDS  # [ns]
LONGEST_COUNT = 1e9  # from midnight or a start; 64 bits hold its nanoseconds [s]
LATE = HOUR  # that may be missing around midnight [ns]
SUNDAY, THURSDAY = 6, 3  # days of a week from Monday; 1970-01-01 was a Thursday
LATEST_HOUR = 4  # of the night in which clocks change [h]
# Months and days of the Sundays on which clocks go ahead, and back: in Europe the last of March and
# of October, in North America the second of March and the first of November, in Australia the first
# of October and of April, in New Zealand the last of September and the first of April.
NIGHTS_AHEAD = ((3, 8, 14), (3, 25, 31), (9, 24, 30), (10, 1, 7))
NIGHTS_BACK = ((10, 25, 31), (11, 1, 7), (4, 1, 7))


@dataclass(slots=True)
class _Steps:
    """Steps of a column's stamps, batch by batch."""

    usual: float = 0.0
    """Where no clock changes [ns]."""

    _last: int | None = None
    _rising: int = 0
    _falling: int = 0

    def of(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return the step from the stamp before to each, (n,) [ns]; to the very first a usual one.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            As written, n > 0 [ns since 1970].
        """
        steps = np.diff(stamps, prepend=stamps[0] if self._last is None else np.int64(self._last))
        rising = steps[steps > 0]
        self._rising += len(rising)
        self._falling += int((steps < 0).sum())
        if len(rising):
            self.usual = float(np.median(rising))
        if self._last is None:
            steps[0] = round(self.usual)
        self._last = int(stamps[-1])
        return steps

    def less(self, steps: NDArray[np.int64], by_ns: int = HOUR) -> NDArray[np.bool_]:
        """Return which steps are less than usual by what a clock goes back.

        Notes
        -----
        Rows that are s apart step by s less an hour there, and by more if some are missing, for up
        to half an hour. Rows a quarter of an hour apart or less that are out of order or written
        twice are less than that off; rows further apart than an hour, and those in falling order,
        show no change.
        """
        shows = self.usual <= by_ns and self._rising >= self._falling
        return shows & (steps - self.usual < -by_ns / 2) & (steps >= -by_ns - SLACK)

    def more(self, steps: NDArray[np.int64]) -> NDArray[np.bool_]:
        """Return which steps are an hour more than usual, as exactly as rows of theirs can be."""
        uneven = max(2 * min(self.usual, NANOSECONDS), self.usual / 2)
        return np.asarray(np.abs(steps - self.usual - HOUR) <= uneven)


@dataclass(slots=True)
class SummerTime:
    """Follows the stamps of a column that states no zone, by what the rows show alone.

    Notes
    -----
    Such stamps are taken as UTC, but loggers and controllers often write local time. An hour back
    cannot be UTC. An hour without rows can, and is taken for a clock that goes ahead only where it
    begins on the full hour of a night in which clocks do so in Europe, North America, Australia or
    New Zealand: an outage that fills just this hour is far less likely. Either is logged with the
    way out, for nothing in the file decides it.
    """

    changes_ns: list[int] = field(default_factory=list)
    """First stamp behind each change, as it is written [ns since 1970]."""

    went_back: bool = False
    """Whether one of them was the end of summer time: what is before it came first."""

    _added: int = 0
    """To the stamps from the last change on [ns]."""

    _steps: _Steps = field(default_factory=_Steps)

    def in_utc(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return stamps on the clock of the column's first one, which is taken as UTC.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            As written, n > 0 [ns since 1970].
        """
        steps = self._steps.of(stamps)
        back, ahead = self._steps.less(steps), self._steps.more(steps)
        back[back] = _is_night_of(NIGHTS_BACK, stamps[back])
        full_hours = (stamps[ahead] - HOUR) // HOUR * HOUR
        begins_there = (stamps - steps)[ahead] < full_hours + SLACK
        ahead[ahead] = begins_there & _is_night_of(NIGHTS_AHEAD, stamps[ahead])
        change = back | ahead
        self.changes_ns += stamps[change].tolist()
        self.went_back = self.went_back or bool(back.any())
        added = self._added + np.cumsum(np.where(change, np.where(back, HOUR, -HOUR), 0))
        self._added = int(added[-1])
        return np.asarray(stamps + added, dtype=np.int64)

    @property
    def remarks(self) -> list[str]:
        """Sentences on what the rows do not decide."""
        return [
            f"the clock leaps by an hour at {_written(each)}, as local time does on that night; "
            "all times are read as those before it (--zone states whose clock it is; with --zone "
            "UTC it does not leap)"
            for each in self.changes_ns
        ]


@dataclass(frozen=True, slots=True)
class ClockChange:
    """A moment at which the clocks of a zone are set."""

    moment_ns: int
    """[ns since 1970-01-01 UTC]."""

    before_ns: int
    """How far they are ahead of UTC until then [ns]."""

    after_ns: int
    """How far they are ahead of UTC from then on [ns]."""

    @property
    def begin_ns(self) -> int:
        """First stamp that they show twice, or leave out [ns since 1970 of the local clock]."""
        return self.moment_ns + min(self.before_ns, self.after_ns)

    @property
    def end_ns(self) -> int:
        """First stamp behind [ns since 1970 of the local clock]."""
        return self.moment_ns + max(self.before_ns, self.after_ns)

    @property
    def size_ns(self) -> int:
        """By how much they are set [ns]."""
        return abs(self.after_ns - self.before_ns)


def clock_changes(zone: str, begin_ns: int, end_ns: int) -> Iterator[ClockChange]:
    """Yield the changes of a zone's clocks in a period, in order; none of a fixed offset.

    Parameters
    ----------
    zone : str
        As `zone_named` takes it.
    begin_ns, end_ns : int
        [ns since 1970-01-01 UTC]; a change that is up to a day later may be among them.
    """
    clock = zone_named(zone)
    one_day = int(DAY)
    first, last = begin_ns // WHOLE_DAY * one_day, end_ns // WHOLE_DAY * one_day + one_day
    before = _ahead(clock, first)
    for midnight in range(first, last, one_day):
        after = _ahead(clock, midnight + one_day)
        if after != before:
            low, high = midnight, midnight + one_day  # [s]
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if _ahead(clock, middle) == before else (low, middle)
            yield ClockChange(high * NANOSECONDS, before * NANOSECONDS, after * NANOSECONDS)
        before = after


def _ahead(clock: tzinfo, moment: int) -> int:
    """How far a clock is ahead of UTC at a moment [s since 1970] in whole seconds."""
    ahead = (datetime(1970, 1, 1, tzinfo=UTC) + timedelta(seconds=moment)).astimezone(clock)
    offset = ahead.utcoffset()
    return 0 if offset is None else round(offset.total_seconds())


@dataclass(slots=True)
class ZoneClock:
    """Follows the stamps of a column of a zone that is stated.

    Attributes
    ----------
    zone : str
        As `zone_named` takes it.
    second : bool
        Whether a first stamp in an hour that comes twice is of the second, not of the first.

    Notes
    -----
    A stamp has one offset from UTC, whatever rows are missing, but in an hour that comes twice: it
    is of the first until a step back shows the second. A clock that runs through an hour that its
    zone leaves out is evidently not set with the zone, and stays as it was.
    """

    zone: str
    second: bool = False

    remarks: list[str] = field(default_factory=list)
    """Sentences on what the rows show against the zone, or do not decide."""

    went_back: bool = False
    """Whether a step showed the end of summer time: what is before it came first."""

    _steps: _Steps = field(default_factory=_Steps)
    _first: int | None = None
    _shown: set[int] = field(default_factory=set)
    """Moments of the changes behind which the stamps of an hour that comes twice are."""

    _open: int | None = None
    """Moment of a change that the next batch may show: the last one ends just behind its hour."""

    _fixed: int | None = None
    """How far ahead of UTC a clock is that is not set with the zone [ns]."""

    def in_utc(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return stamps of local time in UTC.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            As written, n > 0 [ns since 1970].
        """
        steps = self._steps.of(stamps)
        is_start = self._first is None
        if self._first is None:
            self._first = int(stamps[0])
        if self._fixed is not None:
            return stamps - self._fixed
        # a local clock is less than a day off, and the row before belongs to the period too
        begin_ns = int(min(stamps.min(), (stamps - steps).min())) - WHOLE_DAY
        changes = list(clock_changes(self.zone, begin_ns, int(stamps.max()) + WHOLE_DAY))
        offset = changes[0].before_ns if changes else zone_offset_ns(int(stamps[0]), self.zone)
        ahead = np.full(len(stamps), offset)
        for change in changes:
            ahead[stamps >= change.end_ns] = change.after_ns
        before = stamps - steps
        if is_start:
            before[0] = np.iinfo(np.int64).min // 2  # no row is before the first
        for change in changes:
            if change.after_ns < change.before_ns:
                if is_start and self.second and change.begin_ns <= stamps[0] < change.end_ns:
                    self._shown.add(change.moment_ns)
                self._set_back(change, stamps, before, steps, ahead)
            elif self._is_not_set(change, stamps, before, steps, ahead):
                return stamps - ahead
        if not changes:
            self._follow_back(stamps, steps, ahead)
        return stamps - ahead

    def _follow_back(
        self, stamps: NDArray[np.int64], steps: NDArray[np.int64], ahead: NDArray[np.int64]
    ) -> None:
        """Go on an hour later behind a step back at the end of summer time, in place.

        No clock of a fixed offset goes back: a title such as "Zeit (MESZ)" is of the first rows.
        """
        back = self._steps.less(steps) & _is_night_of(NIGHTS_BACK, stamps)
        if not back.any():
            return
        place = int(np.argmax(back))
        self._fixed = int(ahead[place]) - HOUR
        ahead[place:] = self._fixed
        self.went_back = True
        self.remarks.append(
            f"the clock goes back by an hour at {_written(int(stamps[place]))}, as local time does "
            f"on that night, though {self.zone} is stated; all times behind are read on"
        )

    def _set_back(
        self,
        change: ClockChange,
        stamps: NDArray[np.int64],
        before: NDArray[np.int64],
        steps: NDArray[np.int64],
        ahead: NDArray[np.int64],
    ) -> None:
        """Take the stamps behind a step back as of the second hour, in place."""
        begin_ns, end_ns = change.begin_ns, change.end_ns
        twice = (stamps >= begin_ns) & (stamps < end_ns)
        if change.moment_ns in self._shown:
            ahead[twice] = change.after_ns
            return
        # a clock that is set late goes on beyond the hour before it goes back
        late = (stamps >= end_ns) & (stamps < end_ns + change.size_ns)
        from_first = (before >= begin_ns) & (before < end_ns + change.size_ns)
        back = twice & from_first & self._steps.less(steps, change.size_ns)
        if back.any():
            place = int(np.argmax(back))
            behind = np.arange(len(stamps)) >= place
            ahead[late & ~behind] = change.before_ns
            ahead[twice & behind] = change.after_ns
            self._shown.add(change.moment_ns)
            self.went_back = True
            return
        leaving = (stamps >= end_ns) & (before >= begin_ns) & (before < end_ns)
        leaving &= steps - self._steps.usual < change.size_ns / 2
        if not leaving.any() and self._open != change.moment_ns:
            return
        self._open = None
        if stamps[-1] < end_ns + SLACK:
            ahead[stamps >= end_ns] = change.before_ns
            self._open = change.moment_ns
        elif self._first is not None and self._first < begin_ns:
            self.remarks.append(
                f"the hour from {_written(begin_ns)} comes once, and twice in {self.zone}; one is "
                f"taken as missing ({self._stays(change)})"
            )

    def _is_not_set(
        self,
        change: ClockChange,
        stamps: NDArray[np.int64],
        before: NDArray[np.int64],
        steps: NDArray[np.int64],
        ahead: NDArray[np.int64],
    ) -> bool:
        """Return whether rows run through an hour that is left out; if so, go on as before it."""
        through = (stamps >= change.end_ns) & (before >= change.begin_ns)
        through &= (before < change.end_ns) & (steps - self._steps.usual < change.size_ns / 2)
        if not through.any():
            return False
        self._fixed = change.before_ns
        ahead[np.argmax(through) :] = change.before_ns
        self.remarks.append(
            f"its clock shows the hour from {_written(change.begin_ns)}, which {self.zone} leaves "
            f"out; all times behind are read as those before it ({self._stays(change)})"
        )
        return True

    def _stays(self, change: ClockChange) -> str:
        offset = offset_name(change.moment_ns - NANOSECONDS, self.zone)
        return f"--zone {offset} states a clock that stays as it is then"


def clock_of(zone: str, *, second: bool = False) -> SummerTime | ZoneClock:
    """Return what follows the stamps of a zone; "": of none that is stated."""
    return ZoneClock(zone, second) if zone else SummerTime()


@dataclass(slots=True)
class Midnights:
    """Follows times of day without a date over midnight, batch by batch."""

    late_ns: int = LATE
    """That may be missing around midnight [ns]."""

    _added: int = 0
    """To the times from the last midnight on [ns]."""
    _last: int | None = None

    def continuous(self, times: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return times since the first day's midnight.

        Parameters
        ----------
        times : ndarray, shape (n,)
            Since midnight, n > 0 [ns].
        """
        steps = np.diff(times, prepend=times[0] if self._last is None else np.int64(self._last))
        over = (steps + WHOLE_DAY <= self.late_ns) & (times >= 0) & (times - steps <= WHOLE_DAY)
        added = self._added + WHOLE_DAY * np.cumsum(over)
        self._last, self._added = int(times[-1]), int(added[-1])
        return np.asarray(times + added, dtype=np.int64)

    def seconds_added(self, seconds: FloatArray) -> FloatArray:
        """Return what numbers that count from each midnight lack to seconds of the first day.

        Parameters
        ----------
        seconds : ndarray, shape (n,)
            As they count, n > 0 [s].
        """
        bounded = np.clip(seconds, -LONGEST_COUNT, LONGEST_COUNT)
        times = np.round(bounded * NANOSECONDS).astype(np.int64)
        return np.asarray((self.continuous(times) - times) / NANOSECONDS, dtype=np.float64)


def _written(stamp: int) -> str:
    return str(np.datetime64(stamp, "ns").astype("datetime64[s]"))


def _is_night_of(
    sundays: tuple[tuple[int, int, int], ...], stamps: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Return which stamps are in the nights that begin Sundays of months between two days."""
    seconds = stamps // NANOSECONDS
    day = seconds // int(DAY)
    dates = stamps.astype("datetime64[ns]").astype("datetime64[D]")
    month = dates.astype("datetime64[M]").astype(np.int64) % 12 + 1
    of_month = (dates - dates.astype("datetime64[M]")).astype(np.int64) + 1
    sunday = (day + THURSDAY) % 7 == SUNDAY
    hour = seconds % int(DAY) // 3600
    listed = np.any(
        [(month == m) & (of_month >= first) & (of_month <= last) for m, first, last in sundays],
        axis=0,
    )
    return np.asarray(sunday & (hour <= LATEST_HOUR) & listed)
