"""A rotor's speed among the channels of a file: a column in rpm that is named after the rotor.

It is no vibration: it leaves the channels and becomes the table's `rotor_speed`.
"""

import re
from dataclasses import replace

import numpy as np

from sensors.files.table import ChannelTable, plain_unit

_ROTOR = re.compile(r"rot(or|spd|speed|_|\b)|drehzahl", re.IGNORECASE)  # RotSpeed is OpenFAST's
_SPEED = re.compile(r"speed|spd|rpm|drehzahl", re.IGNORECASE)


def with_rotor_speed_apart(table: ChannelTable) -> ChannelTable:
    """Return a table whose rotor speed, if it has one channel of it, is none of its channels.

    Missing values are taken straight between their neighbours.

    Parameters
    ----------
    table : ChannelTable

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
    in_rpm = plain_unit(unit) in ("rpm", "1/min", "min-1", "r/min")
    return in_rpm and bool(_ROTOR.search(name)) and bool(_SPEED.search(name + unit))
