"""Dates and times of day as people and loggers write them → nanoseconds since 1970.

    2024-03-13T12:00:00.250Z     13.03.2024 12:00:00,250     3/13/2024 12:00:00.250 PM
    2024/03/13 12:00:00          13-Mar-2024 12:00:00.250    12:00:00.250, 00:00.25 (of no date)

    13.03.2024 12:00:00,250 MEZ      12:00:00 UTC+1                20240313T120000.250Z

A time without a zone is UTC, unless a zone is stated beside the file. Whether 3/4/2024 is in March
or in April, only a later day shows.

`local_clock` follows stamps without a zone over the changes of their clock, times of day over
midnight.
"""

import re
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Literal

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.files.table import DateOrder, zone_named
from sensors.files.text.arrow_values import integers_of, truths_of

DateKind = Literal["moment", "date", "time of day"]
Order = Literal["ymd", "dmy", "mdy"]

MONTHS = ("jan", "feb", "m[aä]r", "apr", "ma[yi]", "jun", "jul", "aug", "sep", "o[ck]t", "nov",
          "de[cz]")  # fmt: skip
HALF_DAY = 12 * 3600 * 10**9  # [ns]

# Abbreviations that mean one offset from UTC alone [h], MEZ and MESZ in German; not IST, CST, BST.
ZONES = {"UTC": 0, "GMT": 0, "WET": 0, "WEST": 1, "CET": 1, "MEZ": 1, "CEST": 2, "MESZ": 2,
         "EET": 2, "EEST": 3}  # fmt: skip
_NAMES = "|".join(sorted(ZONES, key=len, reverse=True))

_YEAR_FIRST = r"\d{4}[-/.]\d{1,2}[-/.]\d{1,2}"
_YEAR_LAST = r"\d{1,2}(?:\. |[-/. ])(?:\d{1,2}|[^\W\d]{3,9}\.?)[-/. ](?:\d{4}|\d{2})"
_DIGITS = r"(?:19|20)\d{2}(?:0[1-9]|1[0-2])(?:0[1-9]|[12]\d|3[01])"  # 20240313
_DATE = rf"(?:{_YEAR_FIRST}|{_YEAR_LAST})"
_TIME = r"\d{1,2}:\d{1,2}(?::\d{1,2}(?:[.,:]\d+)?|[.,]\d+)?"
_ZONE = rf"(?:(?:UTC|GMT)[+-]\d{{1,2}}(?::?\d{{2}})?|{_NAMES}|Z|[+-]\d{{2}}:?\d{{2}})"
_ENDING = rf"(?:\s*(?:[AaPp][Mm]|{_ZONE}))?"
_OFFSET = re.compile(
    r"(?:UTC|GMT)\s?(?P<sign>[+-])\s?(?P<hours>1[0-4]|0?\d)(?::?(?P<minutes>\d{2}))?(?!\d)",
    re.IGNORECASE,
)
_ABBREVIATION = re.compile(rf"(?<![A-Za-z])(?:{_NAMES})(?![A-Za-z])")
_KINDS: dict[DateKind, re.Pattern[str]] = {
    "moment": re.compile(
        rf"(?:{_DATE}|{_DIGITS})[T _,;]+{_TIME}{_ENDING}"
        rf"|{_DIGITS}[T _,;]+\d{{6}}(?:[.,]\d+)?{_ENDING}"
    ),
    "date": re.compile(_DATE),
    "time of day": re.compile(_TIME + _ENDING),
}
_PARTS = re.compile(r"(\d{1,2})[-/. ](\d{1,2})[-/. ](?:\d{4}|\d{2})")


class DateError(ValueError):
    """A text that is no time, or an order of day and month that nothing shows."""


def zone_offset_ns(local_ns: int, zone: str, *, second: bool = False) -> int:
    """Return by how much a local time is ahead of UTC [ns].

    Parameters
    ----------
    local_ns : int
        As written, counted from 1970-01-01 of the local clock [ns].
    zone : str
        Such as "Europe/Berlin"; empty: UTC.
    second : bool
        Which of the two an hour is that comes twice, as summer time ends.
    """
    local = datetime.fromtimestamp(local_ns // NANOSECONDS, UTC).replace(tzinfo=zone_named(zone))
    return _ahead_ns(local.replace(fold=int(second)))


def repeated_after_ns(time_ns: int, zone: str) -> int:
    """Return after how long the local clock shows the time of a moment again [ns]; 0: never.

    Parameters
    ----------
    time_ns : int
        [ns since 1970-01-01 UTC].
    zone : str
        Such as "Europe/Berlin"; empty: UTC.
    """
    local = datetime.fromtimestamp(time_ns // NANOSECONDS, zone_named(zone))
    return max(0, _ahead_ns(local) - _ahead_ns(local.replace(fold=1)))


def offset_name(time_ns: int, zone: str) -> str:
    """Return how far a zone is ahead of UTC at a moment, as `zone_named` takes it: "UTC+01:00"."""
    local = datetime.fromtimestamp(time_ns // NANOSECONDS, zone_named(zone))
    return f"UTC{local:%z}"[:6] + ":" + f"{local:%z}"[3:5]


def _ahead_ns(local: datetime) -> int:
    ahead = local.utcoffset()
    return 0 if ahead is None else round(ahead.total_seconds()) * NANOSECONDS


def zone_in_title(title: str) -> str | None:
    """Return the zone that a time column's title states, as `zone_named` takes it; None: none.

    "Zeit (MESZ)" and "Time UTC+2" give "UTC+02:00", "t_utc" gives "UTC+00:00".
    """
    offset = _OFFSET.search(title)
    if offset is not None:
        return f"UTC{offset['sign']}{int(offset['hours']):02d}:{offset['minutes'] or '00'}"
    name = _ABBREVIATION.search(title)
    if name is not None:
        return f"UTC+{ZONES[name[0]]:02d}:00"
    return "UTC+00:00" if "utc" in title.lower() else None


def kind_of_text(text: str) -> DateKind | None:
    """Return whether a text is a moment, a date or a time of day; None where it is none of them."""
    return next((kind for kind, form in _KINDS.items() if form.fullmatch(text.strip())), None)


def is_date_of_digits(number: float) -> bool:
    """Return whether a number is a date without marks: 20240313."""
    return number == int(number) and re.fullmatch(_DIGITS, str(int(number))) is not None


@dataclass(frozen=True, slots=True)
class DateStyle:
    """How the times of one column are written."""

    order: Order
    dated: bool
    """Whether they have a date; False: times of day."""

    zoned: bool

    @classmethod
    def of(cls, examples: Sequence[str], dates: DateOrder | None = None) -> "DateStyle":
        """Return the style of a column's first texts.

        Parameters
        ----------
        examples : sequence of str
            Its first texts.
        dates : {"day-first", "month-first"}, optional
            What comes first where the texts leave it open; None: an error there.

        Raises
        ------
        DateError
            If the order of day and month cannot be found.
        """
        first = examples[0].strip()
        zoned = re.search(rf"(?::\d.*|[T _,;]\d{{6}}[.,\d]*\s*){_ZONE}$", first) is not None
        if kind_of_text(first) == "time of day":
            return cls("ymd", False, zoned)
        if re.match(r"\d{4}", first):
            return cls("ymd", True, zoned)
        return cls(_order(examples, dates), True, zoned)

    def nanoseconds(self, texts: pa.Array) -> NDArray[np.int64]:
        """(n,) [ns] since 1970-01-01 UTC, or since midnight.

        Returns
        -------
        ndarray, shape (n,)
            In [ns].

        Raises
        ------
        pyarrow.ArrowInvalid
            If one is written in another way.
        """
        kind = pa.timestamp("ns", tz="UTC" if self.zoned else None)
        try:
            stamps = texts.cast(kind)
        except pa.ArrowInvalid:
            stamps = self._plain(texts).cast(kind)
        since = integers_of(stamps.cast(pa.int64()))
        if re.search(r"[AaPp][Mm]\s*$", texts[0].as_py()) is None:
            return since
        later = truths_of(pc.match_substring_regex(texts, r"[Pp][Mm]\s*$"))
        twelve = since // HALF_DAY % 2 == 1  # 12:30 AM is half an hour after midnight
        return since + np.where(later & ~twelve, HALF_DAY, np.where(~later & twelve, -HALF_DAY, 0))

    def _plain(self, texts: pa.Array) -> pa.Array:
        """ISO 8601, as Arrow reads it."""
        for pattern, replacement in [*self._dates(), *_TIMES]:
            texts = pc.replace_substring_regex(texts, pattern, replacement)
        return texts

    def _dates(self) -> list[tuple[str, str]]:
        """Year, month, day; of times of day, the first day there is."""
        trimmed = [(r"^\s+", ""), (r"\s*([AaPp][Mm])?\s*$", "")]
        if not self.dated:
            return [*trimmed, (r"^(\d{1,2}:\d{1,2}[.,]\d+)$", r"00:\1"), ("^", "1970-01-01 ")]
        months = [
            (rf"(?i)^(\d+)(?:\. |[-/. ]){name}[^\W\d]*\.?[-/. ]", rf"\1-{number:02d}-")
            for number, name in enumerate(MONTHS, start=1)
        ]
        day = r"(\d{1,2})"
        year_last = r"\3-\2-\1 " if self.order == "dmy" else r"\3-\1-\2 "
        this_century = year_last.replace(r"\3", r"20\3")
        rest = r"[T _,;]+"
        return [
            *trimmed,
            *(months if self.order == "dmy" else []),
            (rf"^(\d{{4}})[-/.]{day}[-/.]{day}{rest}", r"\1-\2-\3 "),
            (rf"^(\d{{4}})(\d\d)(\d\d){rest}", r"\1-\2-\3 "),
            (rf"^{day}[-/. ]{day}[-/. ](\d{{2}}){rest}", this_century),
            (rf"^{day}[-/. ]{day}[-/. ](\d{{4}}){rest}", year_last),
            (r"-(\d)\b", r"-0\1"),
        ]


_TIMES = [
    (r" (\d\d)(\d\d)(\d\d)", r" \1:\2:\3"),
    (r" (\d):", r" 0\1:"),
    (r":(\d):", r":0\1:"),
    (r":(\d)([.,]|$)", r":0\1\2"),
    (r"(:\d\d:\d\d)[,:](\d+)", r"\1.\2"),  # a decimal comma, or a colon before milliseconds
    (r"(\.\d{9})\d+", r"\1"),
    (r"\s*(UTC|GMT)([+-]\d)", r" \2"),  # UTC+2, GMT+02:00: the offset alone
    (r" ([+-])(\d)(:?\d\d)?$", r" \1" + r"0\2\3"),
    (r" ([+-]\d\d)$", r" \1:00"),
    *((rf"\s*{name}$", f"+{hours:02d}:00" if hours else "Z") for name, hours in ZONES.items()),
    (r"\s+([+-]\d{2}:?\d{2})$", r"\1"),
]


def _order(examples: Sequence[str], dates: DateOrder | None) -> Order:
    parts = [found for each in examples if (found := _PARTS.match(each.strip()))]
    if not parts or "." in examples[0].strip()[:3]:  # month by name; only a German date has dots
        return "dmy"
    if any(int(found[1]) > 12 for found in parts):
        return "dmy"
    if any(int(found[2]) > 12 for found in parts):
        return "mdy"
    if dates is not None:
        return "dmy" if dates == "day-first" else "mdy"
    raise DateError(
        f"{examples[0].strip()!r}: is the day or the month first? --dates day-first or --dates "
        'month-first says it (dates="day-first" in Python, under [time] of a layout file too)'
    )
