"""A clock in columns of its parts: year, day of the year, hour, minute, second; or date, time, ms.

Loggers that write numbers alone keep the parts of each stamp in columns of their own, and so do
tables whose clock has whole seconds, with a column of milliseconds beside it. The columns are
known by their titles.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.constants import DAY
from sensors.files.text.arrow_values import truths_of, values_of

ClockPart = Literal[
    "year",
    "month",
    "day",
    "day of the year",
    "hour",
    "minute",
    "second",
    "hour and minute",
    "second of the day",
    "millisecond",
    "microsecond",
    "nanosecond",
]

_TITLES: dict[ClockPart, frozenset[str]] = {
    "year": frozenset({"year", "yr", "yyyy", "jahr"}),
    "month": frozenset({"month", "mon", "monat"}),
    "day": frozenset({"day", "dd", "tag", "dayofmonth"}),
    "day of the year": frozenset({"doy", "dayofyear", "yearday", "jday", "julianday", "ddd"}),
    "hour": frozenset({"hour", "hours", "hr", "hh", "stunde"}),
    "minute": frozenset({"minute", "minutes", "min", "mi"}),
    "second": frozenset({"second", "seconds", "sec", "ss", "sekunde"}),
    "hour and minute": frozenset({"hhmm", "hourminute"}),
    "second of the day": frozenset({"secondofday", "secondsofday", "sod"}),
    "millisecond": frozenset({"millisecond", "milliseconds", "millis", "msec", "ms"}),
    "microsecond": frozenset({"microsecond", "microseconds", "micros", "usec", "us"}),
    "nanosecond": frozenset({"nanosecond", "nanoseconds", "nanos", "nsec", "ns"}),
}
FRACTIONS: Mapping[ClockPart, int] = {"millisecond": 10**6, "microsecond": 10**3, "nanosecond": 1}
"""What is counted within a second [ns]."""
_SECONDS: Mapping[ClockPart, float] = {
    "hour": 3600.0,
    "minute": 60.0,
    "second": 1.0,
    "second of the day": 1.0,
}
_DATES: tuple[frozenset[ClockPart], ...] = (
    frozenset(("year", "month", "day")),
    frozenset(("year", "day of the year")),
)
_OF_DATE = frozenset[ClockPart]().union(*_DATES)
_CLOCKS: tuple[frozenset[ClockPart], ...] = (
    frozenset(("hour", "minute")),
    frozenset(("hour and minute", "second")),
    frozenset(("second of the day",)),
)
_RANGES: Mapping[ClockPart, tuple[float, float]] = {
    "year": (0, 2100),
    "month": (1, 12),
    "day": (1, 31),
    "day of the year": (1, 366),
    "hour": (0, 24),
    "minute": (0, 59),
    "second": (0, 60.999_999_999),
    "hour and minute": (0, 2400),
    "second of the day": (0, DAY + 1),
    **dict.fromkeys(FRACTIONS, (0, NANOSECONDS)),
}
CENTURY = 2000  # of years of two digits
_WHOLE_DAY = int(DAY) * NANOSECONDS  # [ns]


class PartError(ValueError):
    """A part of a stamp that cannot be; the message states it, not in which file."""


def part_of(title: str) -> ClockPart | None:
    """Return which part of a stamp a column of that name, without its unit, holds."""
    plain = "".join(each for each in re.sub(r"[\[(].*", "", title).lower() if each.isalnum())
    return next((part for part, titles in _TITLES.items() if plain in titles), None)


def split_clock(titles: Sequence[str]) -> dict[ClockPart, int]:
    """Return where the parts of a clock stand; empty where the columns make none.

    Parameters
    ----------
    titles : sequence of str
        Names of columns of numbers, without their units; "" of others.

    Notes
    -----
    "Min" alone is a minimum, and "day" alone no clock: hour and minute are there together, or one
    column is both or the second of the day. A date is whole or is not one.
    """
    places: dict[ClockPart, int] = {}
    for place, title in enumerate(titles):
        part = part_of(title)
        if part is not None:
            places.setdefault(part, place)
    if not any(clock <= places.keys() for clock in _CLOCKS):
        return {}
    dated = any(date <= places.keys() for date in _DATES)
    return {part: at for part, at in places.items() if dated or part not in _OF_DATE}


def is_fraction(title: str, first: Sequence[float]) -> bool:
    """Return whether a column counts within a second, by its title and its first numbers."""
    length = FRACTIONS.get(part_of(title) or "second", NANOSECONDS)
    return length < NANOSECONDS and all(0 <= each * length < NANOSECONDS for each in first)


def joined_clock(texts: Sequence[pa.Array], parts: Mapping[ClockPart, pa.Array]) -> pa.Array:
    """Return the stamps of a clock that stands in several columns.

    Parameters
    ----------
    texts : sequence of pyarrow.Array
        Columns of dates and times of day, as they are written.
    parts : mapping of str to pyarrow.Array
        Columns of numbers, or of texts of numbers.

    Returns
    -------
    pyarrow.Array
        Texts, or timestamps [ns]; null where a part is.

    Raises
    ------
    PartError
        A part that is no number, or cannot be.
    """
    written = [each.cast(pa.string()) for each in texts]
    if not parts:
        return pc.binary_join_element_wise(*written, " ")
    if parts.keys() <= FRACTIONS.keys():
        whole = written[0] if len(written) == 1 else pc.binary_join_element_wise(*written, " ")
        ((part, column),) = parts.items()
        return _with_fraction(whole, part, column)
    stamps = _stamps_of_parts(parts)
    return pc.binary_join_element_wise(*written, stamps, " ") if written else stamps


def _stamps_of_parts(columns: Mapping[ClockPart, pa.Array]) -> pa.Array:
    """Timestamps [ns], or where there is no date times of day in text; null where a part is."""
    numbers = {part: _numbers(part, column) for part, column in columns.items()}
    missing = np.any([np.isnan(each) for each in numbers.values()], axis=0)
    filled = {part: np.where(missing, _RANGES[part][0], each) for part, each in numbers.items()}
    since_midnight = _since_midnight(filled)
    if "year" in filled:
        stamps = (_days(filled) + since_midnight).astype("datetime64[ns]")
        return pa.array(stamps, mask=missing)
    times = pa.array(since_midnight % _WHOLE_DAY, mask=missing)
    return times.cast(pa.time64("ns")).cast(pa.string())


def _with_fraction(texts: pa.Array, part: ClockPart, column: pa.Array) -> pa.Array:
    """Clock times of whole seconds, and what is counted within the second behind them.

    "12:00:00 PM" and 50 ms are "12:00:00.050000000 PM"; a time that has a fraction stays as it is.
    """
    counts = np.nan_to_num(_numbers(part, column)) * FRACTIONS[part]
    if (counts >= NANOSECONDS).any():
        raise PartError(f"has {part} {counts.max() / FRACTIONS[part]:g}, which is a second or more")
    written = pa.array([f".{count:09d}" for count in np.rint(counts).astype(np.int64).tolist()])
    split = pc.extract_regex(texts, r"^(?P<clock>.*:\d{1,2}:\d{1,2})(?P<rest>[^\d.,:].*)?$")
    clock, rest = pc.struct_field(split, "clock"), pc.struct_field(split, "rest")
    joined = pc.binary_join_element_wise(clock, written, pc.fill_null(rest, ""), "")
    return pc.if_else(column.is_null(), pa.scalar(None, pa.string()), pc.fill_null(joined, texts))


def _since_midnight(parts: Mapping[ClockPart, FloatArray]) -> NDArray[np.int64]:
    """(n,) [ns], without what doubles round off."""
    total = np.zeros(len(next(iter(parts.values()))), dtype=np.int64)
    for part, values in parts.items():
        if part in FRACTIONS:
            total += np.rint(values * FRACTIONS[part]).astype(np.int64)
        elif part in _SECONDS:
            total += np.rint(values * _SECONDS[part] * NANOSECONDS).astype(np.int64)
        elif part == "hour and minute":
            minutes = values // 100 * 60 + values % 100
            total += np.rint(minutes).astype(np.int64) * 60 * NANOSECONDS
    return total


def _days(parts: Mapping[ClockPart, FloatArray]) -> NDArray[np.int64]:
    """(n,) [ns since 1970] of each date's midnight."""
    year = parts["year"].astype(np.int64)
    year = np.where(year < 100, year + CENTURY, year) - 1970
    if "day of the year" in parts:
        begin, day = year.astype("datetime64[Y]"), parts["day of the year"]
    else:
        months = year * 12 + parts["month"].astype(np.int64) - 1
        begin, day = months.astype("datetime64[M]"), parts["day"]
    dates = begin.astype("datetime64[D]") + (day.astype(np.int64) - 1)
    return np.asarray(dates.astype("datetime64[ns]").astype(np.int64), dtype=np.int64)


def _numbers(part: ClockPart, column: pa.Array) -> FloatArray:
    """(n,) numbers of one part, NaN where it is missing."""
    if pa.types.is_dictionary(column.type):
        column = column.dictionary_decode()
    if pa.types.is_string(column.type) or pa.types.is_large_string(column.type):
        plain = pc.replace_substring(pc.utf8_trim_whitespace(column), ",", ".")
        try:
            column = plain.cast(pa.float64())
        except pa.ArrowInvalid as error:
            raise PartError(f"has {part} with a value that is no number") from error
    values = values_of(column.cast(pa.float64()))
    least, most = _RANGES[part]
    with np.errstate(invalid="ignore"):
        odd = ~truths_of(column.is_null()) & ~((values >= least) & (values <= most))
        if part in _OF_DATE:
            odd |= values % 1 > 0
        if part == "hour and minute":
            odd |= values % 100 >= 60
    if odd.any():
        sample = int(np.argmax(odd)) + 1
        raise PartError(f"has {part} {values[sample - 1]:g}; {least:g} to {most:g} are possible")
    return values
