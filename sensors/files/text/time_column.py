"""The time column of a file → seconds since its first stamp, and when that was.

Numbers are read in the unit that the title states. Where it states none, their size shows what
counts from 1970 (1.7e9 are seconds, 1.7e12 milliseconds, …) and the days of spreadsheets and of
MATLAB; anything else is in seconds.
"""

import re
from dataclasses import dataclass, field
from datetime import UTC, datetime
from decimal import Decimal
from fractions import Fraction
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import BoolArray, FloatArray
from sensors.constants import DAY
from sensors.files.table import DateOrder
from sensors.files.text.arrow_values import integers_of, truths_of, values_of
from sensors.files.text.dates import (
    DateError,
    DateStyle,
    kind_of_text,
)
from sensors.files.text.local_clock import SLACK, Midnights, SummerTime, ZoneClock, clock_of

SECONDS_PER_UNIT = {
    "": 1.0,
    "s": 1.0,
    "sec": 1.0,
    "ms": 1e-3,
    "us": 1e-6,
    "µs": 1e-6,
    "ns": 1e-9,
    "min": 60.0,
    "h": 3600.0,
    "d": 86400.0,
}
_SPELLED = {
    **dict.fromkeys(("secs", "second", "seconds", "sek", "sekunden"), "s"),
    **dict.fromkeys(("msec", "millisecond", "milliseconds", "millis"), "ms"),
    **dict.fromkeys(("μs", "usec", "microsecond", "microseconds", "micros"), "us"),
    **dict.fromkeys(("nsec", "nanosecond", "nanoseconds", "nanos"), "ns"),
    **dict.fromkeys(("mins", "minute", "minutes"), "min"),
    **dict.fromkeys(("hr", "hour", "hours"), "h"),
    **dict.fromkeys(("day", "days"), "d"),
}
ABSOLUTE = 1e8  # seconds that count from 1970, not from a start: later than 1973 [s]
LATEST_STAMP = 4_102_444_800  # 2100-01-01: a later one has another unit [s since 1970]
COUNTED_FROM_1970 = ((1e17, "ns"), (1e14, "us"), (1e11, "ms"))  # larger numbers than these
# Days since another date, if they step by less than two seconds: (from, to, of 1970-01-01)
SPREADSHEET_DAYS = (25_569, 73_050, 25_569)  # 1970 to 2100, since 1899-12-30
MATLAB_DAYS = (719_529, 767_010, 719_529)  # since the year 0
SHORTEST_STEP = 2.0 / DAY  # of such days [d]
CLOCK_DIGITS = ("hhmmss", "hhmmss.s", "hhmmss.ss", "hhmmss.sss")  # "units" of such numbers
MINUTE_LEAP = 40.0  # of such a number at a full minute
COUNTERS = (2**16, 2**32)  # numbers after which a counter of 16 or 32 bits begins again
LONGEST_TURN = 10  # steps that may be missing where it does
LONGEST_STEP = 2.0  # a number without a unit that steps by so much counts no seconds


class ClockError(ValueError):
    """A time column that cannot be understood; the message states why, not in which file."""


def known_unit(unit: str) -> str | None:
    """Return a unit of time as `SECONDS_PER_UNIT` has it; None where it is none."""
    plain = unit.strip().lower()
    plain = _SPELLED.get(plain, plain)
    return plain if plain in SECONDS_PER_UNIT else None


@dataclass(frozen=True, slots=True)
class Scale:
    """What the numbers of a time column count."""

    seconds: float = 1.0
    """Length of the column's unit [s]."""

    origin: int = 0
    """Origin in units of the column, at 1970-01-01."""

    absolute: bool = False
    """Whether it counts from 1970, not from a start."""

    @classmethod
    def of(cls, unit: str, first: float, step: float | None) -> "Scale":
        """Return the scale of a column of numbers.

        Parameters
        ----------
        unit : str
            Unit of the column; empty: not stated.
        first : float
            First number.
        step : float or None
            Difference of consecutive numbers; None: unknown.

        Raises
        ------
        ClockError
            For an unknown unit, a time that is not possible, a step that is no second.
        """
        known = known_unit(unit)
        if known is None:
            units = ", ".join(key for key in SECONDS_PER_UNIT if key)
            raise ClockError(f"is in [{unit}]; its unit can be {units}")
        found = _scale_by_size(first, step) if not known else None
        scale = found or cls(SECONDS_PER_UNIT[known])
        if (
            not known
            and found is None
            and step is not None
            and step >= LONGEST_STEP
            and abs(first) <= ABSOLUTE
        ):
            raise ClockError(
                f"steps by {step:g} and has no unit; say it in brackets, e.g. [ms] or [s]"
            )
        since_1970 = (first - scale.origin) * scale.seconds
        if scale.origin == 0 and since_1970 <= ABSOLUTE:
            return scale
        if since_1970 > LATEST_STAMP:
            raise ClockError(
                f"begins at {first:.12g}{f' {unit}' if unit else ''}, which would be after the "
                "year 2100; is its unit right?"
            )
        return cls(scale.seconds, scale.origin, absolute=True)


def _scale_by_size(first: float, step: float | None) -> Scale | None:
    """Return the scale that the size of a number without a unit shows."""
    for least, unit in COUNTED_FROM_1970:
        if first > least:
            return Scale(SECONDS_PER_UNIT[unit])
    for begin, end, origin in (SPREADSHEET_DAYS, MATLAB_DAYS):
        if begin < first < end and step is not None and 0 < step < SHORTEST_STEP:
            return Scale(DAY, origin)
    return None


def seconds_of_digits(values: NDArray[Any], unit: str) -> FloatArray | None:
    """Return seconds since midnight of numbers such as 215959.50, 21:59:59.50; None: they are none.

    Parameters
    ----------
    values : ndarray, shape (n,)
        Numbers of a time column.
    unit : str
        Of the column; empty: not stated.

    Notes
    -----
    Where the unit does not state it, a full minute shows it: no number is between 60 and 100 then,
    and the clock goes on evenly where the number leaps by 40.
    """
    stated = unit.strip().lower() in CLOCK_DIGITS
    if unit and not stated:
        return None
    number = np.asarray(values, dtype=np.float64)
    if not ((number >= 0) & (number < 240_000)).all():
        return None
    minutes, seconds = number // 100 % 100, number % 100
    if (minutes >= 60).any() or (seconds >= 60).any():
        return None
    since_midnight = np.asarray(number // 10_000 * 3600 + minutes * 60 + seconds)
    if stated:
        return since_midnight
    steps = np.diff(since_midnight)
    leaps = np.diff(number) - steps > 0.5 * MINUTE_LEAP
    even = (
        np.abs(steps[leaps] - np.median(steps)) <= 0.5 * np.median(steps) if len(steps) else leaps
    )
    return since_midnight if leaps.any() and even.all() else None


@dataclass(slots=True)
class CounterTurns:
    """Follows a counter of 16 or 32 bits over its end, batch by batch.

    `micros()` of a small logger is at its end after 71.6 minutes.
    """

    _added: int = 0
    """To the numbers from the last end on."""

    _last: float | None = None
    _step: float = 0.0

    def added(self, values: NDArray[Any]) -> NDArray[np.int64]:
        """Return what numbers lack to go on where the counter began again; 0 of others.

        Parameters
        ----------
        values : ndarray, shape (n,)
            Numbers of a time column, n > 0.
        """
        steps = np.diff(values, prepend=values[0] if self._last is None else self._last)
        rising = steps[steps > 0]
        if not self._step and len(rising):
            self._step = float(np.median(rising))
        turns = np.zeros(len(values), dtype=np.int64)
        for most in COUNTERS:
            over = (steps < 0) & (steps + most > 0) & (steps + most <= LONGEST_TURN * self._step)
            bounded = (np.abs(values) < most) & (np.abs(values - steps) < most)
            turns[over & bounded] = most
        self._last = float(values[-1])
        added = self._added + np.cumsum(turns)
        self._added = int(added[-1])
        return np.asarray(added, dtype=np.int64)


def midnights_of_numbers() -> Midnights:
    """Return what follows numbers over midnight: only where next to nothing is missing there.

    A count that starts again may have begun at any time before.
    """
    return Midnights(late_ns=SLACK)


@dataclass(slots=True)
class TextClock:
    """The time column of a file, batch by batch.

    Attributes
    ----------
    title : str
        Of the column, for errors.
    unit : str
        Of its numbers; "" where it is not stated.
    dates : DateOrder or None
        What comes first in dates such as 3/4/2024; None: as they show.
    zone : str
        Of dates that state none; empty: UTC.
    """

    title: str
    unit: str = ""
    dates: DateOrder | None = None
    zone: str = ""
    second: bool = False
    """Whether a first stamp in an hour that comes twice is of the second, not of the first."""

    start_ns: int = 0
    """The file's first stamp [ns since 1970]; 0 where it counts from a start."""

    _first: Any = None
    """That stamp as the column has it: an int, a float or a Decimal."""

    _rows: int = 0
    """Stamps that were read."""

    _scale: Scale | None = None
    _of_digits: bool = False
    """Whether its numbers are hours, minutes and seconds, 215959.50."""

    _style: DateStyle | None = field(default=None)
    _midnights: Midnights = field(default_factory=Midnights)
    _counted_midnights: Midnights = field(default_factory=midnights_of_numbers)
    _turns: CounterTurns = field(default_factory=CounterTurns)
    local_clock: SummerTime | ZoneClock = field(init=False)
    """Reads dates without a zone."""

    def __post_init__(self) -> None:
        self.local_clock = clock_of(self.zone, second=self.second)

    def seconds(self, column: pa.Array) -> FloatArray:
        """Return seconds since the file's first stamp.

        Raises
        ------
        ClockError
        """
        if pa.types.is_dictionary(column.type):
            column = column.dictionary_decode()
        self._require_all(truths_of(column.is_null()))
        kind = column.type
        if pa.types.is_string(kind) or pa.types.is_large_string(kind):
            seconds = self._of_texts(column.cast(pa.string()))
        elif pa.types.is_timestamp(kind) or pa.types.is_date(kind):
            stamps = _nanoseconds(column, pa.timestamp("ns"))
            if self.zone and (pa.types.is_date(kind) or kind.tz is None):
                stamps = self.local_clock.in_utc(stamps)
            seconds = self._of_nanoseconds(stamps, dated=True)
        elif pa.types.is_duration(kind) or pa.types.is_time(kind):
            nanosecond_kind = pa.duration("ns") if pa.types.is_duration(kind) else pa.time64("ns")
            seconds = self._of_nanoseconds(_nanoseconds(column, nanosecond_kind), dated=False)
        elif pa.types.is_decimal(kind):
            seconds = self._of_decimals(column)
        elif pa.types.is_integer(kind):
            seconds = self._of_numbers(integers_of(column.cast(pa.int64())))
        elif pa.types.is_floating(kind):
            seconds = self._of_numbers(values_of(column.cast(pa.float64())))
        else:
            raise ClockError(f"holds {kind}; numbers or dates are needed")
        self._rows += len(column)
        return seconds

    def _require_all(self, missing: BoolArray) -> None:
        if missing.any():
            sample = self._rows + int(np.argmax(missing)) + 1
            raise ClockError(f"has no value in sample {sample}; every row needs a time")

    def _of_texts(self, texts: pa.Array) -> FloatArray:
        try:
            if self._style is None:
                self._style = DateStyle.of(texts.to_pylist(), self.dates)
            stamps = self._style.nanoseconds(texts)
            if not self._style.dated:
                stamps = self._midnights.continuous(stamps)
            elif not self._style.zoned:
                stamps = self.local_clock.in_utc(stamps)
            return self._of_nanoseconds(stamps, dated=self._style.dated)
        except DateError as error:
            raise ClockError(f"has {error}") from error
        except pa.ArrowInvalid as error:
            odd = self._first_odd(texts)
            raise ClockError(
                f"has {texts[odd].as_py()!r} in sample {self._rows + odd + 1}; a time is needed: a "
                "number, or 2024-12-31T23:59:59.5, alike in every row"
            ) from error

    def _first_odd(self, texts: pa.Array) -> int:
        """Return the place of the first text that is no time, or no time in the column's style."""
        for place, each in enumerate(texts.to_pylist()):
            if not kind_of_text(each):
                return place
        good, bad = 0, len(texts)  # all before `good` are read; one before `bad` is not
        while self._style is not None and bad - good > 1:
            middle = (good + bad) // 2
            try:
                self._style.nanoseconds(texts.slice(good, middle - good))
                good = middle
            except pa.ArrowInvalid:
                bad = middle
        return good

    def _of_nanoseconds(self, stamps: NDArray[np.int64], *, dated: bool) -> FloatArray:
        if self._first is None:
            self._first = int(stamps[0])
            self.start_ns = self._first if dated else 0
        return np.asarray((stamps - self._first) * 1e-9, dtype=np.float64)

    def _of_numbers(self, values: NDArray[Any]) -> FloatArray:
        self._require_all(~np.isfinite(values))
        if self._scale is None and seconds_of_digits(values, self.unit) is not None:
            self._of_digits = True
        values = self._clock_of(values) if self._of_digits else values + self._turns.added(values)
        scale = self._scale_of(values[0].item(), values[: min(len(values), 100)])
        seconds = np.asarray((values - self._first) * scale.seconds, dtype=np.float64)
        if scale.absolute:
            return seconds
        return seconds + self._counted_midnights.seconds_added(values * scale.seconds)

    def _clock_of(self, values: NDArray[Any]) -> FloatArray:
        seconds = seconds_of_digits(values, CLOCK_DIGITS[0])
        if seconds is None:
            raise ClockError(
                "has hours, minutes and seconds as 215959.50 at first and other numbers later"
            )
        return seconds

    def _of_decimals(self, column: pa.Array) -> FloatArray:
        """Numbers of so many digits that a double does not hold them."""
        some = np.array([float(each) for each in column[:100].to_pylist()])
        scale = self._scale_of(column[0].as_py(), some)
        since = values_of(
            pc.subtract(column, pa.scalar(self._first, column.type)).cast(pa.float64())
        )
        return (since + self._turns.added(values_of(column.cast(pa.float64())))) * scale.seconds

    def _scale_of(self, first: int | float | Decimal, some: NDArray[Any]) -> Scale:
        if self._scale is None:
            step = float(np.median(np.diff(some))) if len(some) > 1 else None
            unit = "s" if self._of_digits else self.unit
            self._scale = Scale.of(unit, float(first), step)
            self._first = first
            if self._scale.absolute:
                self.start_ns = since_1970(first, self._scale)
        return self._scale


def since_1970(first: int | float | Decimal, scale: Scale) -> int:
    """[ns], without what doubles round off."""
    seconds = Fraction(scale.seconds).limit_denominator(NANOSECONDS)
    return round((Fraction(first) - scale.origin) * seconds * NANOSECONDS)


def _nanoseconds(column: pa.Array, kind: pa.DataType) -> NDArray[np.int64]:
    if pa.types.is_timestamp(column.type):
        kind = pa.timestamp("ns", tz=column.type.tz)
    try:
        counts = column.cast(kind).cast(pa.int64())
    except pa.ArrowInvalid as error:
        raise ClockError("has a date that 64 bits of nanoseconds do not hold") from error
    return integers_of(counts)


def parse_start_ns(number: int | float) -> int:
    """[ns since 1970] of a number that states when a file begins; 0 where it counts from no date.

    Raises
    ------
    ClockError
        A moment that cannot be.
    """
    if not np.isfinite(number):
        raise ClockError(f"is {number}; a time is needed")
    scale = Scale.of("", number, None)
    return since_1970(number, scale) if scale.absolute else 0


def words_of(title: str) -> list[str]:
    """Return a title's words in lower case: "Time_ms" gives "time" and "ms"."""
    return [word for word in re.split(r"[\W\d_]+", title.lower()) if word]


def iso(time_ns: int) -> str:
    """Return a time in ISO 8601 to the nanosecond."""
    seconds, rest = divmod(time_ns, NANOSECONDS)
    return f"{datetime.fromtimestamp(seconds, UTC):%Y-%m-%dT%H:%M:%S}.{rest:09d}"
