"""What the lines above a table of samples and a file's name state: its rate, when it began."""

import re
from collections.abc import Sequence
from datetime import datetime
from math import isnan, nan

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
from sensors.files.text.time_column import SECONDS_PER_UNIT, known_unit

# A unit such as ms, S/s, 1/s, s-1, samples per second
_UNIT = r"(?:1/[^\W\d_]+|s(?:\^?-1|⁻¹)|(?:[^\W\d_]+ ?)?(?:/|\bper |\bpro ) ?[^\W\d_]+|[^\W\d_]+)"
_GAP = r"(?P<gap>(?:1/[a-z]+|s\^?-1|[^\d\n+-]){0,28}?)"
_VALUE = (  # with its groups of thousands; neither a time of day, a date nor a range
    r"(?!1/[a-z])(?P<value>[1-9]\d{0,2}(?:[ \xa0\u202f'’]\d{3}(?!\d))+(?:[.,]\d+)?"
    r"|\d+(?:[.,]\d+)*(?:[eE][+-]?\d+)?)(?![.,:/-]?\d)"
)
_BEHIND = rf"(?:[ \t;,|]*[\[(]?(?P<unit>{_UNIT})(?!\w|[ \t]*[=:]))?"  # not the next entry: "s=5"
_RATE = re.compile(
    r"(?<![a-z])(?P<label>(?:fs|f_s)(?!\d)|(?:sampl\w*|scan|data|abtast\w*|mess|acquisition)?[ _-]*"
    r"(?:rate|freq(?:uency|uenz)?|frequenz))" + _GAP + _VALUE + _BEHIND,
    re.IGNORECASE,
)  # fmt: skip
_SURE = re.compile(r"(?<![a-z])f_?s(?![a-z])|sampl|scan|abtast|mess|acqui", re.IGNORECASE)
_STEP = re.compile(
    r"(?<![a-z])(?:dt(?!\d)|delta[ _-]?[tx]"
    r"|(?:sampl\w*|abtast)[ _-]*(?:interval[a-z]*|period|step|time))" + _GAP + _VALUE + _BEHIND,
    re.IGNORECASE,
)  # fmt: skip
_HERTZ = {
    **dict.fromkeys(("hz", "sps", "s-1", "s^-1", "s⁻¹"), 1.0),
    **dict.fromkeys(("khz", "ksps"), 1000.0),
}
_STEP_UNITS = ("s", "sec", "ms", "us", "µs", "ns")
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


def stated_rate(lines: Sequence[str], decimal_point: str = ".") -> float | None:
    """Return the sampling rate that the lines state, perhaps as its interval [Hz].

    None: none, several, or one that may be thousands or decimals, such as 1,000 Hz.

    Parameters
    ----------
    lines : sequence of str
        Above the table.
    decimal_point : str, optional
        Of the samples: where it is a comma, a point may stand between thousands.
    """
    rates = {rate for line in lines for rate in _rates_in(line, decimal_point)}
    rates = {rate for rate in rates if 0 < rate < float("inf")}
    return rates.pop() if len(rates) == 1 else None


def states_measurement(line: str) -> bool:
    """Whether a line says how fast or since when was sampled, even if it is not understood."""
    return bool(_rates_in(line)) or any(form.search(line) for form in (_START, _OTHER_START))


def _rates_in(line: str, decimal_point: str = ".") -> list[float]:
    """Return the rates that a line states [Hz]; NaN for one that is not understood."""
    rates: list[float] = []
    found = _RATE.search(line)
    if found is not None:
        hertz = {each for unit in _units(found) if (each := _hertz(unit)) is not None}
        if hertz or _SURE.search(found["label"] + found["gap"]):
            rates.append(_number(found["value"], decimal_point) * _only(hertz))
    found = _STEP.search(line) if not rates or isnan(rates[0]) else None
    if found is not None:
        seconds = {each for unit in _units(found) if (each := _seconds(unit)) is not None}
        step = _number(found["value"], decimal_point) * _only(seconds)
        rates.append(1.0 / step if step else nan)
    return rates


def _units(found: re.Match[str]) -> list[str]:
    """Return what may be units between a label and its number and behind that."""
    words = [*re.findall(_UNIT, found["gap"], re.IGNORECASE), found["unit"] or ""]
    return [re.sub(r" ?(?:/|\bper |\bpro ) ?", "/", word.lower()) for word in words if word]


def _only(factors: set[float]) -> float:
    """Return the factor of a number's unit; 1 where it has none, NaN where it has several."""
    return (factors or {1.0}).pop() if len(factors) < 2 else nan


def _hertz(unit: str) -> float | None:
    """Return a unit of rates [Hz]; NaN for a unit of something else, None for another word."""
    samples, slash, time = unit.partition("/")
    if slash and known_unit(time) in ("s", "sec") and not samples.startswith(("ms", "gs")):
        return 1000.0 if samples in ("ks", "ksa", "ksamples") else 1.0
    other = unit.endswith("hz") or known_unit(time if slash else unit)
    return _HERTZ.get(unit, nan if other else None)


def _seconds(unit: str) -> float | None:
    """Return a unit of sampling intervals [s]; NaN for another unit, None for another word."""
    known = known_unit(unit.removesuffix("/sample"))
    if known in _STEP_UNITS:
        return SECONDS_PER_UNIT[known]
    return nan if known or _hertz(unit) is not None else None


def _number(text: str, decimal_point: str) -> float:
    """Return a number; NaN where its separators may stand between thousands."""
    separators = re.findall(r"[^\deE+-]", text)
    grouped = re.fullmatch(r"[1-9]\d{0,2}[.,]\d{3}", text) and "," in (*separators, decimal_point)
    if len(separators) > 1 or not {".", ","}.issuperset(separators) or grouped:
        return nan
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
