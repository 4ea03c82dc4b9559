"""Columns of wind, rotor and sea in files of measurements → SCADA samples.

"WindSpeed" [m/s], "GenPwr" [kW] ──► means of ten seconds ──► ScadaSample
"""

import math
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.directions import DirectionSum
from sensors.files.block_builder import MeasurementFile
from sensors.files.channel_names import (
    PITCH_ANGLE,
    POWER,
    ROTOR_SPEED,
    WATER_LEVEL,
    WIND_SPEED,
    YAW_ANGLE,
    words_of,
)
from sensors.files.table import ChannelTable, plain_unit

SCADA_PERIOD = 10 * NANOSECONDS  # that one SCADA sample is the mean of [ns]
TURNING = 2.0  # a rotor that is faster is no parked or idling one [rpm]
IDLING = 0.1  # a rotor that is slower stands [rpm]
PER_MINUTE = ("rpm", "1/min", "min-1", "r/min", "u/min", "tr/min", "t/min", "omdr/min", "o/min")
_UNIT_IN_NAME = {
    **dict.fromkeys(("ms", "mps", "m/s"), "m/s"),
    **{unit: unit for unit in ("kw", "mw", "w", "rpm", "deg", "m")},
}
_NOT_A_LEVEL = {"std", "min", "max", "dir", "direction", "err", "error", "rate", "temp", "y", "z"}
_NO_ROTOR = re.compile(  # a word of a name whose turns are those of another machine, or no speed
    r"gen|gensp(?:ee)?d|genrpm|(?:generat|générat|generad)\w*|hss|highspeed|gear\w*|getriebe\w*"
    r"|fan|lüfter\w*|luefter\w*|ventilat\w*|pump\w*|motor\w*|kompressor\w*"
    r"|compressor|azimuth?|position|angle|winkel|brake|bremse|lock"
)
_OF_ROTOR = re.compile(r"rotor.*|rot|rotsp(?:ee)?d")  # a word of a name
_ROTOR = re.compile(r"rot(or|spd|speed|_|\b)|drehzahl", re.IGNORECASE)  # RotSpeed is OpenFAST's
_SPEED = re.compile(r"speed|spd|rpm|drehzahl", re.IGNORECASE)


def _either(*words: str) -> str:
    return "|".join(words)


# Field of a ScadaSample: a word of the name, and what a value of each unit is in the field's unit.
_FIELDS: dict[str, tuple[str, dict[str, float]]] = {
    "wind_speed": (_either("wind", "windspeed", "wspd", "ws", *WIND_SPEED), {"m/s": 1.0}),
    "rotor_speed": (
        _either("rotspeed", "rotorspeed", "rotor", "rpm", *ROTOR_SPEED),
        {**dict.fromkeys(PER_MINUTE, 1.0), "": 1.0},
    ),
    "pitch": (
        _either("pitch", "bldpitch", *PITCH_ANGLE),
        {"deg": 1.0, "°": 1.0, "grad": 1.0, "": 1.0},
    ),
    "yaw": (_either("yaw", "nacyaw", "yawpos", *YAW_ANGLE), {"deg": 1.0, "°": 1.0, "grad": 1.0}),
    "power": (_either("power", "pwr", "genpwr", *POWER), {"w": 1.0, "kw": 1e3, "mw": 1e6}),
    "water_level": (
        _either("waterlevel", "sealevel", "waveelev", "tide", "level", *WATER_LEVEL),
        {"m": 1.0},
    ),
}


@dataclass(frozen=True, slots=True)
class ConditionChannel:
    """A channel of a file that is a field of a SCADA sample."""

    name: str
    factor: float
    """To the unit of the field."""


def condition_channels(names: Sequence[str], units: Sequence[str]) -> dict[str, ConditionChannel]:
    """Return the channels that are fields of a ScadaSample, by the field's name; the first each.

    Of several speeds, one that is named after the rotor goes before a bare "rpm"; a generator's
    is none.

    Parameters
    ----------
    names, units : sequence of str
        As a ChannelTable has them.
    """
    found: dict[str, ConditionChannel] = {}
    ranks: dict[str, int] = {}
    for name, unit in zip(names, units, strict=True):
        words = words_of(name)
        for field, (pattern, factors) in _FIELDS.items():
            known = any(re.fullmatch(pattern, word) for word in words)
            factor = factors.get(plain_unit(unit) or _unit_in_name(name))
            rank = _rank_of_speed(name, words) if field == "rotor_speed" else 1
            if not known or factor is None or _NOT_A_LEVEL & set(words):
                continue
            if rank > ranks.get(field, 0):
                found[field], ranks[field] = ConditionChannel(name, factor), rank
    return found


def _rank_of_speed(name: str, words: Sequence[str]) -> int:
    """Return how surely a name is that of the rotor's speed; 0: it is not."""
    if any(_NO_ROTOR.fullmatch(word) for word in words):
        return 0
    of_rotor = any(_OF_ROTOR.fullmatch(word) for word in words)
    return 1 + 2 * of_rotor + bool(_SPEED.search(name))


def _unit_in_name(name: str) -> str:
    """Return the unit that a name ends in, as "power_kW" does; "" where it ends in none."""
    return _UNIT_IN_NAME.get(re.split(r"[\s_.]+", name.strip().lower())[-1], "")


def read_conditions(
    files: Sequence[MeasurementFile], channels: Mapping[str, ConditionChannel], turbine: str
) -> Iterator[ScadaSample]:
    """Yield means of ten seconds, in order of time; what is not in the files is NaN.

    Parameters
    ----------
    files : sequence of MeasurementFile
        In order of time.
    channels : mapping
        Of `condition_channels`.
    turbine : str
        Its id.

    Raises
    ------
    FileError
        If a file cannot be read, or these channels differ in rate.
    """
    if not channels:
        return
    names = tuple(dict.fromkeys(each.name for each in channels.values()))
    factors = np.array([each.factor for each in channels.values()])
    columns = [names.index(each.name) for each in channels.values()]
    yaw = list(channels).index("yaw") if "yaw" in channels else None
    sums: dict[int, np.ndarray] = {}  # by period: (2, n_fields) sum and number of values
    yaws: dict[int, DirectionSum] = {}  # by period
    for file in files:
        own = replace(file, names=names, wanted=replace(file.wanted, names=frozenset(names)))
        for chunk in own.chunks():
            if chunk.times is None:
                return
            periods = (chunk.start_ns + np.round(chunk.times * NANOSECONDS)) // SCADA_PERIOD
            values = chunk.samples[:, columns] * factors
            for period in np.unique(periods):
                inside = values[periods == period]
                counted = np.isfinite(inside)
                part = np.array([np.where(counted, inside, 0.0).sum(axis=0), counted.sum(axis=0)])
                sums[int(period)] = sums.get(int(period), np.zeros(part.shape)) + part
                if yaw is not None:
                    known = inside[counted[:, yaw], yaw]
                    yaws[int(period)] = yaws.get(int(period), DirectionSum()).plus(known)
    for period in sorted(sums):
        total, count = sums[period]
        means = np.divide(total, count, out=np.full(total.shape, math.nan), where=count > 0)
        if yaw is not None:
            means[yaw] = yaws[period].mean
        yield _sample(
            turbine, period * SCADA_PERIOD, dict(zip(channels, means.tolist(), strict=True))
        )


def _sample(turbine: str, time_ns: int, means: Mapping[str, float]) -> ScadaSample:
    fields = {field: means.get(field, math.nan) for field in _FIELDS}
    state = state_of_rotor(fields["rotor_speed"])
    return ScadaSample(turbine=turbine, time_ns=time_ns, state=state, **fields)


def state_of_rotor(rotor_speed: float) -> str:
    """Return the operating state that a rotor speed [rpm] means; "" where it is not known."""
    if math.isnan(rotor_speed):
        return ""
    if abs(rotor_speed) > TURNING:
        return "operating"
    return "idling" if abs(rotor_speed) > IDLING else "parked"


def with_rotor_speed_apart(table: ChannelTable) -> ChannelTable:
    """Return a table whose rotor speed, if it has one channel of it, is none of its channels.

    Missing values are taken straight between their neighbours.

    Returns
    -------
    ChannelTable
        The same table where no channel, or every channel, is a rotor's speed in rpm.
    """
    speeds = [i for i in range(len(table.names)) if _is_rotor_speed(table.names[i], table.units[i])]
    rest = [i for i in range(len(table.names)) if i not in speeds]
    if len(speeds) != 1 or not rest:
        return table
    column = table.samples[:, speeds[0]]
    known = np.flatnonzero(np.isfinite(column))
    if not len(known):
        return table
    return replace(
        table.only(rest), rotor_speed=np.interp(np.arange(len(column)), known, column[known])
    )


def _is_rotor_speed(name: str, unit: str) -> bool:
    in_rpm = plain_unit(unit) in PER_MINUTE and _rank_of_speed(name, words_of(name)) > 0
    return in_rpm and bool(_ROTOR.search(name)) and bool(_SPEED.search(name + unit))
