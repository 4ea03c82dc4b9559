"""What the lines above a table of samples and a file's name state: its rate, when it began."""

import re
from collections.abc import Sequence
from datetime import datetime

import pyarrow as pa

from sensors.acquisition.blocks import NANOSECONDS
from sensors.files.table import UNSTATED, TimeColumn, zone_named
from sensors.files.text.columns import log_once
from sensors.files.text.dates import (
    DateError,
    DateStyle,
    kind_of_text,
    zone_in_title,
    zone_offset_ns,
)
from sensors.files.text.time_column import SECONDS_PER_UNIT

_GAP = r"[^\d\n+-]{0,24}?"
_VALUE = r"(?P<value>\d+(?:[.,]\d+)?(?:[eE][+-]?\d+)?)"
_RATE = re.compile(
    r"(?<![a-z])(?:fs|f_s|(?:sampl\w*|scan|data|abtast\w*|mess|acquisition)?[ _-]*"
    r"(?:rate|freq(?:uency|uenz)?|frequenz)(?: ?\(?hz\)?)?)" + _GAP + _VALUE
    + r"[ \t]*(?P<unit>khz|hz|ks/s|s/s|sps|1/s)?",
    re.IGNORECASE,
)  # fmt: skip
_SURE = re.compile(r"fs|f_s|sampl|scan|abtast|mess|acqui", re.IGNORECASE)
_STEP = re.compile(
    r"(?<![a-z])(?:dt|delta[ _-]?[tx]|(?:sampl\w*|abtast)[ _-]*(?:interval\w*|period|step|time))"
    + _GAP + _VALUE + r"[ \t]*(?P<unit>ms|us|µs|ns|s)?",
    re.IGNORECASE,
)  # fmt: skip
_START = re.compile(
    r"(?:start|begin|trigger|t0)\w*[^\d\n]{0,24}"
    r"(?P<moment>\d{4}-\d{2}-\d{2}[T ]\d{2}:\d{2}:\d{2})(?P<part>\.\d+)?"
    r"(?P<zone>Z|[+-]\d{2}:?\d{2})?",
    re.IGNORECASE,
)
_OTHER_START = re.compile(
    r"(?:start|begin|trigger|t0)[^\d\n]{0,30}"
    r"(?P<moment>\d{1,4}[-/. ]{1,2}(?:\d{1,2}|[^\W\d]{3,9})[-/. ]{1,2}\d{1,4}[T ,;]+"
    r"\d{1,2}:\d{2}:\d{2}(?:[.,]\d+)?(?: ?[AP]M)?)",
    re.IGNORECASE,
)
_ZONE_BEHIND = re.compile(r" ?\(?[A-Z]{3,4}(?![A-Za-z])(?:[+-]\d{1,2}(?::?\d{2})?)?")

_IN_NAME = re.compile(
    r"(?<!\d)(20\d\d)[-_.]?(\d\d)[-_.]?(\d\d)[-_T .]?(\d\d)[-_.:h]?(\d\d)(?:[-_.:m]?(\d\d))?(Z?)"
    r"(?![\da-z])",
    re.IGNORECASE,
)


def start_in_name(name: str, time: TimeColumn = UNSTATED) -> int:
    """Return the date and time in a file's name [ns since 1970-01-01 UTC]; 0: it has none.

    Parameters
    ----------
    name : str
        Without its suffix, such as "mast_20250301_000230" or "T1-2025-03-01T00-02-30Z".
    time : TimeColumn, optional
        What is stated of dates beside the file.
    """
    found = _IN_NAME.search(name)
    if found is None:
        return 0
    *parts, seconds, utc = found.groups()
    zone = zone_named("" if utc else time.zone)
    try:
        moment = datetime(*map(int, parts), int(seconds or 0), tzinfo=zone)  # type: ignore[misc, arg-type]
        moment = moment.replace(fold=int(time.second_hour))
    except ValueError:
        return 0
    return round(moment.timestamp()) * NANOSECONDS


def stated_rate(lines: Sequence[str]) -> float | None:
    """Return the sampling rate that the lines state, perhaps as its interval [Hz].

    None: none, or several.
    """
    rates = {rate for line in lines for rate in _rates_in(line) if 0 < rate < float("inf")}
    return rates.pop() if len(rates) == 1 else None


def _rates_in(line: str) -> list[float]:
    found = _RATE.search(line)
    if found is not None and (found["unit"] or _SURE.search(found[0]) or "hz" in found[0].lower()):
        unit = (found["unit"] or "").lower()
        kilo = unit.startswith("k") or "[khz]" in line.lower()
        return [_number(found["value"]) * (1000.0 if kilo else 1.0)]
    found = _STEP.search(line)
    if found is None:
        return []
    step = _number(found["value"]) * SECONDS_PER_UNIT[(found["unit"] or "s").lower()]
    return [1.0 / step] if step > 0 else []


def _number(text: str) -> float:
    return float(text.replace(",", "."))


def stated_start_ns(lines: Sequence[str], time: TimeColumn = UNSTATED) -> int:
    """Return when the measurement began [ns since 1970-01-01 UTC]; 0: not stated.

    Parameters
    ----------
    lines : sequence of str
        Above the table.
    time : TimeColumn, optional
        What is stated of dates beside the file.
    """
    found = next((match for line in lines if (match := _START.search(line))), None)
    if found is None:
        return _other_start_ns(lines, time)
    try:
        moment = datetime.fromisoformat(found["moment"] + (found["zone"] or ""))
    except ValueError:
        return 0
    zone, fold = zone_named(_zone(found, time)), int(time.second_hour)
    aware = moment if moment.tzinfo else moment.replace(tzinfo=zone, fold=fold)
    part = (found["part"] or ".")[1:]
    return round(aware.timestamp()) * NANOSECONDS + int(f"{part:0<9}"[:9])


def _zone(moment: re.Match[str], time: TimeColumn) -> str:
    """Return the zone behind a moment, "10:00:00 MESZ"; the one stated beside the file else."""
    behind = _ZONE_BEHIND.match(moment.string, moment.end())
    return (zone_in_title(behind[0]) if behind else None) or time.zone


def _other_start_ns(lines: Sequence[str], time: TimeColumn) -> int:
    """Return a start that is not written as ISO 8601; 0 where day and month may be exchanged."""
    found = next((match for line in lines if (match := _OTHER_START.search(line))), None)
    if found is None or kind_of_text(found["moment"]) != "moment":
        return 0
    text = found["moment"]
    try:
        local = int(DateStyle.of([text], time.dates).nanoseconds(pa.array([text]))[0])
        return local - zone_offset_ns(local, _zone(found, time), second=time.second_hour)
    except DateError as error:
        log_once(f"the start of the measurement is left out; {error}")
    except pa.ArrowInvalid:
        pass
    return 0
