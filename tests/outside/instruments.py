"""Sensors that are not where, or not what, their layout states."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from sensors.acquisition.layout import Accelerometer, SensorLayout
from sensors.arrays import FloatArray

FaultKind = Literal["turned", "swapped", "flipped", "gain", "height"]


@dataclass(frozen=True, slots=True)
class SensorFault:
    """One thing that is wrong with the sensors from the first sample to the last."""

    kind: FaultKind
    """turned: both axes at an elevation about the vertical; swapped: the sensors of two
    elevations; flipped: the sign of a channel; gain: of a channel; height: both axes at an
    elevation sit higher than stated."""
    elevation: float
    """Where, as stated [m]."""
    size: float = 0.0
    """turned [deg], swapped: the other elevation [m], gain: relative error [-], height [m]."""
    axis: int = 0
    """Of a flipped or mis-scaled channel: 0 the first one at the elevation, 1 the second."""


@dataclass(frozen=True, slots=True, eq=False)
class Instruments:
    """What is stated of the sensors and what holds."""

    stated: SensorLayout
    """The layout that goes with the samples."""
    true: SensorLayout
    """Where the sensors are and where they point; names as stated."""
    gains: FloatArray
    """(n_channels,): reading over truth [-]."""


def instruments(stated: SensorLayout, faults: Iterable[SensorFault] = ()) -> Instruments:
    """Apply faults to a layout.

    Raises
    ------
    ValueError
        If a fault names an elevation that has no sensor.
    """
    true, gains = list(stated.channels), np.ones(len(stated.channels))
    for fault in faults:
        places = _at(stated, fault.elevation)
        if fault.kind == "gain":
            gains[places[fault.axis]] *= 1 + fault.size
        elif fault.kind == "flipped":
            true[places[fault.axis]] = _flipped(true[places[fault.axis]])
        elif fault.kind == "turned":
            for i in places:
                true[i] = _turned(true[i], np.radians(fault.size))
        elif fault.kind == "height":
            for i in places:
                true[i] = replace(true[i], elevation=true[i].elevation + fault.size)
        else:
            for i in places:
                true[i] = replace(true[i], elevation=fault.size)
            for i in _at(stated, fault.size):
                true[i] = replace(true[i], elevation=fault.elevation)
    return Instruments(stated, replace(stated, channels=tuple(true)), gains)


def _at(layout: SensorLayout, elevation: float) -> list[int]:
    places = np.flatnonzero(np.abs(layout.elevations - elevation) < 1e-6).tolist()
    if not places:
        raise ValueError(f"no sensor of {layout.layout_id} is at {elevation:g} m")
    return places


def _flipped(axis: Accelerometer) -> Accelerometer:
    x, y, z = axis.direction
    return replace(axis, direction=(-x, -y, -z))


def _turned(axis: Accelerometer, angle: float) -> Accelerometer:
    """About the vertical, from x towards y."""
    x, y, z = axis.direction
    c, s = float(np.cos(angle)), float(np.sin(angle))
    return replace(axis, direction=(c * x - s * y, s * x + c * y, z))
