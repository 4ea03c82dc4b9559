"""What the lines above a table of samples and a file's name state: its rate, when it began."""

import re
from collections.abc import Iterator, Sequence
from datetime import datetime
from math import isnan, nan

import pyarrow as pa

from sensors.acquisition.blocks import NANOSECONDS
from sensors.files.table import (
    ACCELERATION_UNITS,
    UNSTATED,
    TimeColumn,
    plain_unit,
    zone_named,
)
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
    r"(?<![a-z])(?P<label>(?:fs|f_s)(?!\d)"
    r"|(?P<of>(?:sampl\w*|scan\w*|data|abtast\w*|mess(?:ungs?|daten)?|acqui\w*|daq|measur\w*"
    r"|logg\w*|record\w*|erfassungs|aufzeichnungs)(?:[ _-]+(?:at|with|an?|the|mit|einer|der))*)?"
    r"[ _-]*(?:(?P<rate>rate)|freq(?:uency|uenz)?|frequenz))" + _GAP + _VALUE + _BEHIND,
    re.IGNORECASE,
)  # fmt: skip
_SURE = re.compile(r"(?<![a-z])f_?s(?![a-z])|sampl|scan|abtast|mess(?!age)|acqui", re.IGNORECASE)
_BEGINS = re.compile(r"(?:^|[;,|\t#*\"'(\[])\s*(?:(?:the|die)\s+)?$", re.IGNORECASE)  # an entry
_STEP = re.compile(
    r"(?<![a-z])(?:dt(?!\d)|delta[ _-]?[tx]|(?:sampl\w*|abtast)[ _-]*"
    r"(?:interval[a-z]*|step|(?P<duration>period|time)))" + _GAP + _VALUE + _BEHIND,
    re.IGNORECASE,
)  # fmt: skip
_LONGEST_STEP = 1.0  # a sampling time or period beyond it is how long was measured [s]
_HERTZ = {
    **dict.fromkeys(("hz", "sps", "s-1", "s^-1", "s⁻¹"), 1.0),
    **dict.fromkeys(("khz", "ksps"), 1000.0),
}
_OF_FULL_SCALE = {*ACCELERATION_UNITS, "v", "mv"}  # which is abbreviated FS too
_STEP_UNITS = ("s", "sec", "ms", "us", "µs", "ns")
_START = re.compile(
    r"(?:start|begin|trigger|t0)\w*?[^\d\n]{0,30}(?<!\d)"
    r"(?P<moment>\d{1,4}[-/. ]{1,2}(?:\d{1,2}|[^\W\d]{3,9})[-/. ]{1,2}\d{1,4}[T _,;]+"
    r"\d{1,2}:\d{2}:\d{2}(?:[.,:]\d+)?)",
    re.IGNORECASE,
)
_HALF = re.compile(r"[\s;,|]*(?P<half>[ap])\.?m(?![a-z])\.?", re.IGNORECASE)
_ZONE = re.compile(  # in a cell of its own, "-5" may be any number
    r"(?: *|[\s;,|]+(?![+-]\d+(?![\d:])))[\[(]?"
    r"(?P<zone>z|(?:(?:utc|gmt)\s?)?[+-](?:1[0-4]|0?\d)(?::?[0-5]\d)?|[a-z]{3,4})"
    r"(?![\w:+-]|[.,]\d)[\])]?",
    re.IGNORECASE,
)
# Another cell, another entry, or the end of a period: what stood before them is whole
_DONE = re.compile(
    r"(?: ?Uhr)?\.?(?:\s*(?:$|[;,|\t\"'#*)\]])|\s+[-–]\s+\d{1,4}[-/.]|\s+(?!\w*zone)\w+ ?[:=])",
    re.IGNORECASE,
)

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
    of_any_kind = any(_hertz_of(found) for found in _labelled(line))  # a filter's frequency too
    return of_any_kind or bool(_rates_in(line)) or _START.search(line) is not None


def _rates_in(line: str, decimal_point: str = ".") -> list[float]:
    """Return the rates that a line states [Hz]; NaN for one that is not understood."""
    rates: list[float] = []
    found = next((each for each in _labelled(line) if _is_of_sampling(each)), None)
    if found is not None:
        rates.append(_number(found["value"], decimal_point) * _only(_hertz_of(found)))
    found = _STEP.search(line) if not rates or isnan(rates[0]) else None
    if found is not None:
        seconds = {each for unit in _units(found) if (each := _seconds(unit)) is not None}
        step = _number(found["value"], decimal_point) * _only(seconds)
        whole = found["duration"] is not None and step > _LONGEST_STEP
        rates.append(1.0 / step if step and not whole else nan)
    return rates


def _labelled(line: str) -> Iterator[re.Match[str]]:
    """Yield each rate or frequency of a line with its number."""
    found = _RATE.search(line)
    while found is not None:
        yield found
        found = _RATE.search(line, found.end("label"))


def _is_of_sampling(found: re.Match[str]) -> bool:
    """Whether a rate or frequency is that of sampling: not a filter's, a rotor's, an update's.

    A word of sampling says so, or a rate in Hz that is of nothing else.
    """
    if found["gap"].count(")") > found["gap"].count("("):  # the number stands behind a remark
        return False
    if _SURE.search(found["label"]):
        return True
    in_hertz = bool(_hertz_of(found))
    if _BEGINS.search(found.string, 0, found.start()) is None:
        return in_hertz and found["of"] is not None
    named = found["of"] is not None or found["rate"] is not None
    return (in_hertz and named) or _SURE.search(found["gap"]) is not None


def _hertz_of(found: re.Match[str]) -> set[float]:
    """Return what the units of a rate are [Hz]; NaN for one of something else."""
    return {each for unit in _units(found) if (each := _hertz(unit)) is not None}


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
    of_time = known_unit(time if slash else unit)
    other = unit.endswith("hz") or of_time or plain_unit(unit) in _OF_FULL_SCALE
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
    moments = (found for line in lines if (found := _START.search(line)))
    return next((start for found in moments if (start := _moment_ns(found, time))), 0)


def _moment_ns(found: re.Match[str], time: TimeColumn) -> int:
    """Return a moment in UTC [ns]; 0 where it, or what follows it, is not understood."""
    text, line, end = found["moment"], found.string, found.end()
    if (half := _HALF.match(line, end)) is not None:
        text, end = f"{text} {half['half']}M", half.end()
    zone = time.zone
    behind = _ZONE.match(line, end)
    if behind is not None and (stated := _zone_of(behind["zone"])) is not None:
        zone, end = stated, behind.end()
    if kind_of_text(text) != "moment" or _DONE.match(line, end) is None:
        return 0
    try:
        local = int(DateStyle.of([text], time.dates).nanoseconds(pa.array([text]))[0])
        return local - zone_offset_ns(local, zone, second=time.second_hour)
    except DateError as error:
        log_once(f"the start of the measurement is left out; {error}")
    except pa.ArrowInvalid:
        pass
    return 0


def _zone_of(text: str) -> str | None:
    """Return the zone that "Z", "+0100", "GMT+2" or "MESZ" is; None for another word."""
    if text[0] in "+-":
        return zone_in_title(f"UTC{text}")
    return zone_in_title("UTC" if text in ("Z", "z") else text)
