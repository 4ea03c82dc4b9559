"""What the title of a column states: its name, its unit, whether it is the time."""

import re
from collections.abc import Sequence
from itertools import chain, count

from sensors.files.table import (
    ACCELERATION_UNITS,
    DISPLACEMENT_UNITS,
    LIKE_DISPLACEMENT,
    VELOCITY_UNITS,
    plain_unit,
)
from sensors.files.text.time_column import known_unit, words_of

# Titles of time columns begin or end with one of these words (English and German).
_TIME_WORDS = {
    *("time", "timestamp", "timestamps", "datetime", "datenum", "date", "elapsed", "epoch", "unix"),
    "utc",
    *("seconds", "zeit", "zeitstempel", "datum", "uhrzeit", "messzeit", "tid", "temps", "tijd"),
}
_TIME_TITLES = {"t", "s", "sec", "ts", "x_value"}  # as a whole, or with a unit behind "t_"
_NUMBER_TITLES = re.compile(
    r"(unnamed: ?0|__index_level_0__|index|idx|i|n|no|nr|#|row|scan|scans|record|point|count"
    r"|counter|messwert|punkt|samples?)?([ _.-]*(no|nr|num|number|count|counter|index|id|#))?\.?",
    re.IGNORECASE,
)
_OTHER_UNITS = {
    *("mv", "uv", "ma", "hz", "khz", "°c", "degc", "pa", "hpa", "kpa", "bar", "kn", "nm", "knm"),
    *("%", "counts", "count", "cnt", "digit", "digits", "lsb", "rpm", "kw", "db", "v/v", "mv/v"),
    *("-", "1", "raw", "rn", "ts"),
}
_CAPITALS = {"V", "A", "N", "C", "K", "W"}  # in lower case they are names
_SQUARE = re.compile(r"^(?P<name>.*?)\s*\[(?P<unit>[^\]]*)\]\s*$")
_ROUND = re.compile(r"^(?P<name>.*?)\s*\((?P<unit>(?:[^()]|\([^()]*\))*)\)\s*$")
_BEHIND = re.compile(r"^(?P<name>.*?)(?:\s+/\s*|\s*/\s+|,\s*)(?P<unit>[^/,\s][^,\s]*)$")


def split_unit(title: str) -> tuple[str, str]:
    """Name and unit of a title: "top [mm/s]" gives "top" and "mm/s", "top" gives "top" and "".

    What stands in round brackets, or behind "name /" or "name,", is a unit only where one is known
    by that name: "Acc (X)" has none.
    """
    match = _SQUARE.match(title)
    if match is None:
        match = _ROUND.match(title) or _BEHIND.match(title)
        if match is None or not is_unit(match["unit"]):
            return title, ""
    return match["name"].strip(), match["unit"].strip()


def is_unit(text: str) -> bool:
    """Return whether a text is a unit that is known, if only by name."""
    plain = plain_unit(text)
    known = (ACCELERATION_UNITS, VELOCITY_UNITS, DISPLACEMENT_UNITS, LIKE_DISPLACEMENT)
    is_time = bool(text.strip()) and known_unit(text) is not None
    named = plain in _OTHER_UNITS or text.strip() in _CAPITALS
    return is_time or named or any(plain in units for units in known)


def distinct(names: Sequence[str]) -> list[str]:
    """Return names without duplicates or blanks; what one column is called no other becomes.

    A blank becomes "ch3", a second "a" becomes "a.2"; where that is taken, the next that is free.
    """
    taken = set(names)
    found: dict[str, None] = {}
    for place, given in enumerate(names, start=1):
        name = given
        if not given or given in found:
            stem = given or f"ch{place}"
            others = chain([stem], (f"{stem}.{number}" for number in count(2)))
            name = next(each for each in others if each not in taken)
            taken.add(name)
        found[name] = None
    return list(found)


def is_time_title(name: str) -> bool:
    """Return whether a column of that name, without its unit, holds the time."""
    words = words_of(name)
    if name.strip().lower() in _TIME_TITLES:
        return True
    if len(words) > 1 and words[0] == "t" and known_unit(words[1]) is not None:
        return True
    return bool(words) and (words[0] in _TIME_WORDS or words[-1] in _TIME_WORDS)


def time_unit(name: str) -> str:
    """Return the unit that a time column's name ends with.

    "ms" of "time_ms"; "" where it has none.
    """
    words = words_of(name)
    return words[-1] if len(words) > 1 and known_unit(words[-1]) else ""


def is_number_title(name: str) -> bool:
    """Return whether a column of that name numbers the samples."""
    return _NUMBER_TITLES.fullmatch(name.strip()) is not None
