"""Where a channel was and what it is, read from its name and unit.

"ACC_T3_85m_X" [g]    85 m, fore-aft
"WindSpeed" [m/s]     no motion of the structure: left out

Names of one measurement are read together: a number that all of them share is the turbine's, and
numbers that count 1, 2, 3 are no heights.
"""

import math
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sensors.acquisition.layout import FORE_AFT, SIDE_SIDE
from sensors.arrays import FloatArray
from sensors.errors import InputError
from sensors.files.table import ChannelTable, FileError, quantity_named, quantity_of
from sensors.files.text.column_titles import is_unit
from sensors.files.text.columns import log_once

UP: tuple[float, float, float] = (0.0, 0.0, 1.0)
AXIS_OF_NAME: dict[str, tuple[tuple[float, float, float], str]] = {
    **dict.fromkeys(("fa", "foreaft", "x"), (FORE_AFT, "fore-aft")),
    **dict.fromkeys(("längs", "laengs", "langs", "longitudinal"), (FORE_AFT, "fore-aft")),
    **dict.fromkeys(("ss", "sideside", "y"), (SIDE_SIDE, "side-side")),
    **dict.fromkeys(
        ("quer", "dwars", "tværs", "tvaers", "tvärs", "lateral"), (SIDE_SIDE, "side-side")
    ),
    **dict.fromkeys(("transversal", "transverse"), (SIDE_SIDE, "side-side")),
    **dict.fromkeys(("z", "v", "up", "vert", "vertical", "vertikal"), (UP, "vertical")),
}
# Degrees from north. A nacelle yaws: which of its axes one is, no name can tell.
COMPASS: dict[str, float] = {
    **dict.fromkeys(("n", "ns", "north", "nord"), 0.0),
    **dict.fromkeys(("e", "ew", "east", "ost"), 90.0),
    **dict.fromkeys(("s", "south", "süd", "sued", "syd", "zuid"), 180.0),
    **dict.fromkeys(("w", "west", "vest"), 270.0),
}
LOWEST, HIGHEST = 2.0, 300.0  # heights that a bare number in a name may stand for [m]
MILLIMETRES = 1000.0  # a height above it is no metres
PAIR = 2  # channels at one height that are taken to be at right angles
TRIAXIAL = 3  # channels; of more, a number in every name is no height

_LETTERS = re.compile(r"[A-Za-zÀ-ɏ]+")
_NUMBERED = re.compile(r"([A-Za-z])\d{1,3}")  # y1, y2, y3
_SMALL, _CAPITAL = "a-zß-öø-ÿ", "A-ZÀ-ÖØ-Þ"
_WORD = re.compile(  # of "WindSpeed" too
    rf"[{_CAPITAL}]?[{_SMALL}]+|[{_CAPITAL}]+(?![{_SMALL}])"
)
_IN_METRES = re.compile(r"(?<![A-Za-z0-9.,])(-?\d+(?:[.,]\d+)?) ?([mc]?)[mM](?![A-Za-z/])")
_M_FOR_POINT = re.compile(r"(?<![A-Za-z0-9.,])(\d+)[mM](\d)(?![\dA-Za-z])")  # 16m5: 16.5 m
_AFTER_LETTERS = re.compile(r"(?<![A-Za-z0-9])(?:[Ll]at|LAT|[zZhH]|el|EL)[ _-]?(-?\d+(?:\.\d+)?)")
_NUMBER = re.compile(r"(?<![\d.])(\d{2,3}(?:\.\d+)?)(?!\d|\.\d)")
_BEARING = re.compile(  # N30E, N 120° E, S30W; 030deg, 120°
    r"(?<![A-Za-z\d])(?P<of>[NS]) ?(?P<turn>\d{1,3}(?:[.,]\d+)?) ?°? ?(?P<to>[EOW])(?![A-Za-z\d])"
    r"|(?<![\d.,])(?P<degrees>\d{1,3}(?:[.,]\d+)?) ?(?:°|[Dd]eg)(?![A-Za-z/])"
)
_ALONE = re.compile(r"(?<![A-Za-z])([SW])$")  # elsewhere S1 is a sensor
_COMPASS = re.compile(r"(?<![A-Za-z])(?:N[-/ ]?S|S[-/ ]?N|[EO][-/ ]?W|W[-/ ]?[EO])(?![A-Za-z])")
_IN_FULL = re.compile(r"(?P<fa>fore[ _/-]*aft)|(?P<ss>side[ _/-]*(?:to[ _/-]*)?side)", re.I)
_SEED = re.compile(r"\.[A-Z]{2}([NEZ])$")  # last letter of a SEED channel code: its orientation
_OPENFAST = re.compile(r"(?:TwHt\dAL|YawBrTA|NcIMUTA)([xyz])[tps]$")  # accelerations of the tower
_LOAD = re.compile(r"[a-z0-9][FM]L?[xyz](?:[A-Za-z]\d?)?$")  # TwrBsMxt, RootFzb1: OpenFAST's loads
_ANSWER = re.compile(r"(?P<height>[-+]?\d+(?:[.,]\d+)?) ?m?,? *(?P<sign>-?)(?P<axis>[a-z]+)")
_TRAILING = re.compile(r"(?:\d|\b[Aa][Cc]?[Cc]?)([XYZxyz])(?![A-Za-z])")

# The same in German, Dutch, Danish, Norwegian, Swedish, French and Spanish.
WIND_SPEED = (
    *("windgeschwindigkeit", "windgeschw", "windsnelheid", "vindhastighed", "vindhastighet"),
    *("vindhastigh", "vind", "vent", "viento"),
)
ROTOR_SPEED = (
    *("drehzahl", "toerental", "omdrejninger", "omdrejningstal", "turtall", "varvtal"),
    *("rotordrehzahl", "rotortoerental", "rotorsnelheid", "rotoromdrejninger", "rotorhastighed"),
    *("rotoromdrejningstal", "rotorturtall", "rotorvarvtal", "rotorhastighet"),
)
PITCH_ANGLE = (
    *("pitchwinkel", "blattwinkel", "bladhoek", "pitchhoek", "pitchvinkel", "bladvinkel"),
    *("calage",),
)
YAW_ANGLE = (
    *("gierwinkel", "gondelposition", "gondelrichtung", "gondelausrichtung", "gierhoek"),
    *("kruihoek", "gondelpositie", "krøjevinkel", "krøjning", "nacelleposition", "lacet"),
)
POWER = ("leistung", "wirkleistung", "vermogen", "effekt", "puissance", "potencia")
WATER_LEVEL = (
    *("wasserstand", "pegel", "waterstand", "vandstand", "vannstand", "vattenstånd", "marée"),
)

BENDING = ("biegemoment", "buigmoment", "bøjningsmoment", "effort", "fuerza", "momento")

# Words of a name, in lower case, that stand for what is no motion of the structure.
CONDITIONS = {
    **dict.fromkeys(("wind", "windspeed", "wspd", "ws", "anemometer", *WIND_SPEED), "the wind"),
    **dict.fromkeys(
        ("rotspeed", "rotorspeed", "genspeed", "rotor", "rpm", *ROTOR_SPEED), "the rotor"
    ),
    **dict.fromkeys(
        ("pitch", "bldpitch", "azimuth", "yaw", "nacyaw", *PITCH_ANGLE, *YAW_ANGLE),
        "an angle of the turbine",
    ),
    **dict.fromkeys(("power", "pwr", "genpwr", "torque", *POWER), "power"),
    **dict.fromkeys(
        ("temp", "temperature", "ptemp", "tamb", "humidity", "temperatur"), "the weather"
    ),
    **dict.fromkeys(("pressure", "rain"), "the weather"),
    **dict.fromkeys(
        ("batt", "battery", "volt", "voltage", "supply", "batterie"),
        "the logger's supply",
    ),
    **dict.fromkeys(
        ("wave", "tide", "waterlevel", "sealevel", "water", "sea", *WATER_LEVEL),
        "the sea",
    ),
    **dict.fromkeys(("force", "moment", "thrust", "load", "kraft", *BENDING), "a load"),
    **dict.fromkeys(("status", "state", "flag", "counter", "record", "valid"), "a state"),
}
NO_VALUE = "no value in any row"  # why a channel is left out
_UNSURE = {"the logger's supply", "a state", "a load", "constant", NO_VALUE}  # may be a motion
# all the same
# Units of such quantities; patterns over the unit in lower case without blanks.
_OTHER_UNIT = re.compile(
    r"[kmg]?w|rpm|(?:1|u|r|tr|t|o|omdr)/min|[kmg]?n|[kmg]?n[-*·]?m|[kmgh]?pa|m?bar|hz|%|(?:deg|°)[\s_]*[cf]|degc|k|"
    r"(?:deg|°|rad)/s|kva"
)


@dataclass(frozen=True, slots=True)
class GuessedChannel:
    """Where a channel is taken to be, and what this is taken from."""

    name: str
    """As the file has it."""
    elevation: float
    """[m]; where `height_known` is False only its place in the order."""
    direction: tuple[float, float, float]
    """Of the positive axis (x, y, z) [-]."""
    reason: str
    """What elevation and direction were read from, for people."""
    height_known: bool = True
    """Whether the name has a height."""
    direction_known: bool = True
    """Whether the name has an axis of the tower."""
    is_compass: bool = False
    """Whether the name has a compass direction instead; x is taken as north."""

    @property
    def known(self) -> bool:
        """Whether neither height nor axis is a guess."""
        return self.height_known and self.direction_known


def guess_channels(names: Sequence[str]) -> tuple[GuessedChannel, ...]:
    """Read heights and axes of one measurement's channels from their names.

    Parameters
    ----------
    names : sequence of str
        As the file has them, such as "LAT097_FA", "z145-ss", "acc 44,1m x", "T3_85000mm_X".

    Returns
    -------
    tuple of GuessedChannel
        In the order of `names`. A height that no name has is its place in the order, from 1;
        names that differ in the axis alone share one.
    """
    unturned = [_BEARING.sub(" ", name) for name in names]  # a bearing is no height
    shared = _numbers_in_all(unturned) if len(names) > TRIAXIAL else frozenset[str]()
    heights = [_height(name, shared) for name in unturned]
    unsure = sorted({height for height, _, sure in heights if height is not None and not sure})
    steps = {high - low for low, high in pairwise(unsure)}
    counted = steps == {1.0}  # 1, 2, 3: the sensors' numbers
    placed_in_order = [
        _guess(name, place, None if counted and not sure else height, seen)
        for place, (name, (height, seen, sure)) in enumerate(
            zip(names, heights, strict=True), start=1
        )
    ]
    if _only_numbered(placed_in_order):
        placed_in_order = [
            _guess(name, place, None, name) for place, name in enumerate(names, start=1)
        ]
    return _pairs_apart(_together(placed_in_order))


def _together(channels: Sequence[GuessedChannel]) -> list[GuessedChannel]:
    """Channels without heights at their places, "top FA" and "top SS" at one."""
    places: dict[str, int] = {}
    found = []
    for each in channels:
        text = _axis(each.name)[1] or _compass(each.name)[1] or each.name
        before, seen, after = each.name.rpartition(text)
        key = before + after if each.direction_known or each.is_compass else seen
        place = float(places.setdefault(key, len(places) + 1))
        found.append(each if each.height_known else replace(each, elevation=place))
    return found


def _only_numbered(channels: Sequence[GuessedChannel]) -> bool:
    """Whether names are one letter and numbers, y1, y2, y3: a matrix y, whose letter is no axis."""
    letters = {match[1] if (match := _NUMBERED.fullmatch(each.name)) else "" for each in channels}
    alike = len(channels) > 1 and len(letters) == 1 and "" not in letters
    return alike and not any(each.height_known for each in channels)


def placed(channel: GuessedChannel, answer: str) -> GuessedChannel:
    """Return a channel where an answer puts it: a height [m] and an axis, "97 fa", "44,1 -ss".

    Raises
    ------
    InputError
        If the answer is not a number and an axis.
    """
    found = _ANSWER.fullmatch(answer.strip().lower())
    if found is None or found["axis"] not in AXIS_OF_NAME:
        raise InputError(
            f"{answer!r}: a height in metres and an axis are needed (fa, ss or up; -fa points "
            "against it), such as 97.5 fa"
        )
    (x, y, z), axis = AXIS_OF_NAME[found["axis"]]
    sign = -1.0 if found["sign"] else 1.0
    height = float(found["height"].replace(",", "."))
    return GuessedChannel(
        name=channel.name,
        elevation=height,
        direction=(sign * x + 0.0, sign * y + 0.0, sign * z + 0.0),
        reason=f"{height:g} m, {found['sign']}{axis}, as answered",
    )


def _pairs_apart(channels: Iterable[GuessedChannel]) -> tuple[GuessedChannel, ...]:
    """Take the second of two channels of one height without axes for the one across."""
    guessed = list(channels)
    for height in {each.elevation for each in guessed if each.height_known}:
        level = [i for i, each in enumerate(guessed) if each.elevation == height]
        unknown = [i for i in level if not (guessed[i].direction_known or guessed[i].is_compass)]
        others = [guessed[i].direction for i in level if i not in unknown[-1:]]
        if len(level) == PAIR and unknown and not others[0][2]:
            second = guessed[unknown[-1]]
            x, y, _ = others[0]
            across = FORE_AFT if others[0] == SIDE_SIDE else (-y + 0.0, x, 0.0)
            reason = f"{second.reason}: taken across the other one at its height"
            guessed[unknown[-1]] = replace(second, direction=across, reason=reason)
    return tuple(guessed)


def _guess(name: str, place: int, height: float | None, seen_height: str) -> GuessedChannel:
    rest = name.replace(seen_height, " ") if seen_height else name
    axis, seen_axis = _axis(rest)
    degrees, seen_compass = (None, "") if axis else _compass(rest, name if rest.strip() else "")
    direction, reason = FORE_AFT, "axis not in the name"
    if axis:
        direction, axis_name = AXIS_OF_NAME[axis]
        reason = f"{axis_name} from {seen_axis!r}"
        if _is_negative(seen_axis, name):
            x, y, z = direction
            direction = (-x + 0.0, -y + 0.0, -z + 0.0)
            reason = f"against {axis_name} from '-{seen_axis}'"
    elif degrees is not None:
        direction = _of_bearing(degrees)
        reason = f"a guess: {degrees:g}° from north by {seen_compass!r}, x taken as north"
    reasons = [
        f"{height:g} m from {seen_height!r}" if height is not None else "height not in the name",
        reason,
    ]
    return GuessedChannel(
        name=name,
        elevation=float(place) if height is None else height,
        direction=direction,
        reason=", ".join(reasons),
        height_known=height is not None,
        direction_known=bool(axis),
        is_compass=degrees is not None,
    )


def _is_negative(axis: str, name: str) -> bool:
    """Whether an axis has a sign, acc_-y or acc_y-; the hyphen of 85m-y and z145-ss is none."""
    axis = re.escape(axis)
    return bool(
        re.search(
            rf"(?<![A-Za-z\d)\]])[-−]{axis}(?![A-Za-z])|(?<![A-Za-z]){axis}[-−](?![ A-Za-z\d])",
            name,
        )
    )


def _of_bearing(degrees: float) -> tuple[float, float, float]:
    """Return the horizontal axis at a bearing, x north, y west and z up [-]."""
    angle = math.radians(degrees)
    return (round(math.cos(angle), 6) + 0.0, round(-math.sin(angle), 6) + 0.0, 0.0)


def parallel_channels(channels: Sequence[GuessedChannel]) -> list[tuple[str, ...]]:
    """Return the names of channels at one height whose guessed axes are along one line.

    Parameters
    ----------
    channels : sequence of GuessedChannel
        Of one measurement.

    Returns
    -------
    list of tuple of str
        Each of two names or more; two sensors may also be alike.
    """
    along: dict[tuple[float, tuple[float, ...]], list[str]] = {}
    for each in channels:
        line = max(each.direction, tuple(-part + 0.0 for part in each.direction))
        along.setdefault((each.elevation, line), []).append(each.name)
    return [tuple(names) for names in along.values() if len(names) > 1]


def _numbers_in_all(names: Sequence[str]) -> frozenset[str]:
    found = [frozenset(match[1] for match in _NUMBER.finditer(name)) for name in names]
    return frozenset.intersection(*found)


def _height(name: str, shared: frozenset[str]) -> tuple[float | None, str, bool]:
    """Return a name's height [m], the text it was read from and whether a unit states it."""
    found = _M_FOR_POINT.search(name)
    if found:
        return float(f"{found[1]}.{found[2]}"), found[0], True
    found = _IN_METRES.search(name)
    if found:
        factor = {"": 1.0, "c": 0.01, "m": 0.001}[found[2]]
        return round(float(found[1].replace(",", ".")) * factor, 6), found[0], True
    found = _AFTER_LETTERS.search(name)
    if found:
        value = float(found[1])
        return (value / MILLIMETRES if value > MILLIMETRES else value), found[0], False
    for each in _NUMBER.finditer(name):
        if each[1] not in shared and LOWEST <= float(each[1]) <= HIGHEST:
            return float(each[1]), each[0], False
    return None, "", False


def _axis(name: str) -> tuple[str, str]:
    in_full = _IN_FULL.search(name)
    if in_full:
        return (in_full.lastgroup or ""), in_full[0]
    if name.startswith(("V", "v")):  # a velocity, a voltage
        name = name[1:]
    for words in (_LETTERS.findall(name), _WORD.findall(name)):
        for word in reversed(words):
            if word.lower() in AXIS_OF_NAME:
                return word.lower(), word
    for pattern in (_SEED, _OPENFAST, _TRAILING):
        found = pattern.search(name)
        if found and found[1].lower() in AXIS_OF_NAME:
            return found[1].lower(), found[1]
    return "", ""


def _compass(name: str, whole: str = "") -> tuple[float | None, str]:
    """Return a name's compass direction [° from north] and the text it was read from.

    whole   the name with its height, a number of which a bearing may share
    """
    found = _BEARING.search(whole or name)
    if found and found["degrees"]:
        return float(found["degrees"].replace(",", ".")), found[0]
    if found:
        turn = float(found["turn"].replace(",", "."))
        from_south, westward = found["of"] == "S", found["to"] == "W"
        return (180.0 if from_south else 0.0) + (turn if from_south == westward else -turn), found[
            0
        ]
    pair = _COMPASS.search(name)
    if pair:
        return (COMPASS["ns"] if "N" in pair[0] else COMPASS["ew"]), pair[0]
    if name.startswith(("V", "v")):  # a velocity, a voltage
        name = name[1:]
    for words in (_LETTERS.findall(name), _WORD.findall(name)):
        for word in reversed(words):
            if word.lower() in COMPASS and word.lower() not in ("s", "w"):
                return COMPASS[word.lower()], word
    for pattern in (_SEED, _ALONE):
        found = pattern.search(name)
        if found:
            return COMPASS[found[1].lower()], found[1]
    return None, ""


def other_quantity(name: str, unit: str) -> str:
    """Return what a channel measures where it is no motion of the structure; "" where it may be.

    Parameters
    ----------
    name : str
        Such as "WindSpeed", "BattV", "LAT097_FA".
    unit : str
        After conversion, "" where none is stated. An acceleration is one, whatever its name.

    Returns
    -------
    str
        For people: "the wind", "measured in kW".
    """
    quantity = quantity_of(unit) if unit else quantity_named(name)
    if quantity == "acceleration":
        return ""
    if unit != "g" and _OTHER_UNIT.fullmatch(unit.lower().strip()):
        return f"measured in {unit}"
    if name.startswith("YawBr"):  # OpenFAST's tower top
        return ""
    if _LOAD.search(name):
        return "a load"
    return next((CONDITIONS[word] for word in words_of(name) if word in CONDITIONS), "")


def words_of(name: str) -> tuple[str, ...]:
    """Return a name's neighbouring words as one, then its words: "windspeed", "wind", "speed"."""
    words = [word.lower() for word in _WORD.findall(name)]
    return (*(first + second for first, second in pairwise(words)), *words)


@dataclass(frozen=True, slots=True)
class UnusedChannel:
    """A channel that is not used, and why."""

    name: str
    reason: str
    """For people, such as "measured in kW"."""

    def __str__(self) -> str:
        return f"{self.name} ({self.reason})"


def split_motions(
    table: ChannelTable, origin: str = "the measurement"
) -> tuple[list[int], tuple[UnusedChannel, ...]]:
    """Return the columns that may be motions of the structure, and the channels that are none.

    Beside accelerometers, files of controllers and loggers have wind, power and supplies, whose
    columns are no response of the structure and often constant.

    Parameters
    ----------
    table : ChannelTable
        Names and units; with samples, a column that is constant is left out too.
    origin : str
        What to call it in an error.

    Returns
    -------
    columns : list of int
        All of them where none would remain and some may be (volts of an accelerometer).
    left_out : tuple of UnusedChannel

    Raises
    ------
    FileError
        If every channel is a condition: wind, power, weather, an angle, the sea.
    """
    reasons = [other_quantity(*each) for each in zip(table.names, table.units, strict=True)]
    if len(table.samples):
        reasons = [
            reason or _why_still(series)
            for reason, series in zip(reasons, table.samples.T, strict=True)
        ]
    columns = [column for column, reason in enumerate(reasons) if not reason]
    if not columns and not _UNSURE & set(reasons):
        listed = ", ".join(map(str, map(UnusedChannel, table.names, reasons)))
        raise FileError(
            f"{origin}: no channel measures a motion of the structure: {listed}; a layout file "
            "takes what it lists, whatever its name (`pilewatch import FILE --layout LAYOUT`)"
        )
    if not columns:
        return list(range(len(table.names))), ()
    if scaled := {table.units[column] for column in columns if quantity_of(table.units[column])}:
        beside = f"beside channels in {', '.join(sorted(scaled))}"
        for column in columns:
            unit = table.units[column]
            if unit and quantity_of(unit) is None:
                reasons[column] = f"in {unit}, {beside}"
        columns = [column for column in columns if not reasons[column]]
    return columns, tuple(
        UnusedChannel(name, reason)
        for name, reason in zip(table.names, reasons, strict=True)
        if reason
    )


def note_unknown_units(table: ChannelTable, origin: str) -> None:
    """Log each unit that is not known, even by name: its samples are taken as they are.

    Parameters
    ----------
    origin : str
        What to call the table in the log.
    """
    named: dict[str, list[str]] = {}
    for name, unit in zip(table.names, table.units, strict=True):
        if unit and not is_unit(unit):
            named.setdefault(unit, []).append(name)
    for unit, names in named.items():
        log_once(
            f"{origin}: the unit {unit!r} of {', '.join(names)} is not known; the samples are "
            "taken as they are, unscaled (a layout file states unit and sensitivity)"
        )


def _why_still(series: FloatArray) -> str:
    if not np.isfinite(series).any():
        return NO_VALUE
    return "constant" if is_constant(series) else ""


def is_constant(series: FloatArray) -> bool:
    """Whether all of a channel's samples that are numbers are one number, or none is."""
    known = series[np.isfinite(series)]
    return not known.size or bool(known.min() == known.max())
