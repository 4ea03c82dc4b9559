"""Accelerometer and SensorLayout: what each channel of an acquisition unit measures, and where.

Tower axes: x downwind in the parked position (fore-aft), y to the side (side-side), z up from
the mean water level.
"""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from sensors.errors import InputError

Coupling = Literal["dc", "ac"]

FORE_AFT = (1.0, 0.0, 0.0)
SIDE_SIDE = (0.0, 1.0, 0.0)
HIGHEST = 1000.0  # above or below mean water level; a height beyond it is in another unit [m]


class LayoutError(InputError):
    """A sensor layout that cannot be right; the message names the channel."""


def require_height(name: str, elevation: float) -> None:
    """Raise LayoutError for a channel whose elevation [m] no structure reaches."""
    if not abs(elevation) <= HIGHEST:
        raise LayoutError(
            f"channel {name}: elevation {elevation:g} m; heights are in metres above mean water "
            f"level, at most {HIGHEST:g}"
        )


@dataclass(frozen=True, slots=True)
class Accelerometer:
    """One measuring axis: one channel of a block.

    A DC-coupled axis tilts with the tower and reads u'' − g·ψ, ψ = du/dz the tower's rotation in
    the axis' vertical plane; an AC-coupled one does so only above its corner frequency.
    """

    name: str
    """Unique in its layout, e.g. "z145-fa"."""
    elevation: float
    """Above mean water level [m]."""
    direction: tuple[float, float, float]
    """Direction cosines (x, y, z) of the positive axis [-]."""
    coupling: Coupling = "dc"
    corner_frequency: float = 0.0
    """Of an AC-coupled axis [Hz]."""
    serial: str = ""
    unit: str = "m/s²"

    def __post_init__(self) -> None:
        require_height(self.name, self.elevation)
        length = math.hypot(*self.direction)  # of untrusted numbers: no overflow
        if not abs(length - 1.0) < 1e-6:
            raise LayoutError(
                f"channel {self.name}: direction {self.direction} has length {length:.6g}; "
                "direction cosines have length 1"
            )
        if self.coupling not in ("dc", "ac"):
            raise LayoutError(
                f"channel {self.name}: coupling {self.coupling!r} is neither 'dc' nor 'ac'"
            )
        if self.coupling == "ac" and not self.corner_frequency > 0:
            raise LayoutError(
                f"channel {self.name}: an AC-coupled axis needs its corner_frequency [Hz], "
                f"not {self.corner_frequency}"
            )


@dataclass(frozen=True, slots=True)
class SensorLayout:
    """The channels of one acquisition unit, in the order of a block's columns."""

    layout_id: str
    turbine: str
    unit: str
    channels: tuple[Accelerometer, ...]

    def __post_init__(self) -> None:
        for name, count in Counter(channel.name for channel in self.channels).items():
            if count > 1:
                raise LayoutError(
                    f"layout {self.layout_id}: channel name {name!r} appears more than once"
                )

    @property
    def channel_names(self) -> tuple[str, ...]:
        """Names of the channels, in their order."""
        return tuple(channel.name for channel in self.channels)

    @property
    def elevations(self) -> NDArray[np.float64]:
        """(n_channels,) [m]"""
        return np.array([channel.elevation for channel in self.channels])

    @property
    def directions(self) -> NDArray[np.float64]:
        """(n_channels, 3) direction cosines [-]"""
        return np.array([channel.direction for channel in self.channels])


def joined_layout(layouts: Sequence[SensorLayout]) -> SensorLayout:
    """Return all channels of a turbine's units as one layout; a single one is itself.

    Parameters
    ----------
    layouts : sequence of SensorLayout
        Of different units.

    Notes
    -----
    Where two units use one channel name, as loggers of one make do, every channel is called after
    its unit too: "lower/x", "upper/x".
    """
    if len(layouts) == 1:
        return layouts[0]
    channels = [(layout.unit, channel) for layout in layouts for channel in layout.channels]
    if len({channel.name for _, channel in channels}) < len(channels):
        channels = [(u, replace(channel, name=f"{u}/{channel.name}")) for u, channel in channels]
    return SensorLayout(
        "+".join(layout.layout_id for layout in layouts),
        turbine=layouts[0].turbine,
        unit="+".join(layout.unit for layout in layouts),
        channels=tuple(channel for _, channel in channels),
    )


@dataclass(frozen=True, slots=True)
class LayoutDifference:
    """The first channel that two layouts do not have in common."""

    channel: str
    before: str
    """What the first says of it: "is at 41 m"."""
    after: str
    """What the second says."""


def layout_difference(before: SensorLayout, after: SensorLayout) -> LayoutDifference | None:
    """Return the first difference of two layouts; None where one of them holds for both.

    A layout holds for another one that has fewer channels, all of them as they are in it.
    """
    if holds_for(before, after) or holds_for(after, before):
        return None
    others = {channel.name: channel for channel in after.channels}
    for channel in before.channels:
        other = others.get(channel.name)
        if other is not None and _read_at(channel) != _read_at(other):
            return _difference(channel, other)
    missing = next(name for name in before.channel_names if name not in others)
    return LayoutDifference(missing, "is there", "is not")


def holds_for(layout: SensorLayout, other: SensorLayout) -> bool:
    """Whether a layout has every channel of another one, as a model of the structure reads it."""
    own = {channel.name: _read_at(channel) for channel in layout.channels}
    return all(own.get(channel.name) == _read_at(channel) for channel in other.channels)


def _read_at(channel: Accelerometer) -> tuple[object, ...]:
    """What of a channel a model of the structure needs."""
    corner_frequency = channel.corner_frequency if channel.coupling == "ac" else 0.0
    return (channel.elevation, channel.direction, channel.coupling, corner_frequency)


def _difference(channel: Accelerometer, other: Accelerometer) -> LayoutDifference:
    if channel.elevation != other.elevation:
        texts = [f"is at {each.elevation:g} m" for each in (channel, other)]
    elif channel.direction != other.direction:
        texts = [f"points along {list(each.direction)}" for each in (channel, other)]
    else:
        texts = [
            f"is AC-coupled above {each.corner_frequency:g} Hz"
            if each.coupling == "ac"
            else "is DC-coupled"
            for each in (channel, other)
        ]
    return LayoutDifference(channel.name, *texts)


def turning_matrix(layout: SensorLayout, yaw: float) -> NDArray[np.float64]:
    """(n_channels, n_channels): readings along tower axes → along nacelle axes, yaw [deg].

    Raises InputError for a height with one axis alone, whose motion across is not known.
    """
    angle = np.radians(yaw)
    to_nacelle = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    turn = np.zeros((len(layout.channels), len(layout.channels)))
    for elevation in np.unique(layout.elevations):
        own = np.flatnonzero(layout.elevations == elevation)
        axes = layout.directions[own, :2]
        if np.linalg.matrix_rank(axes, tol=0.1) < 2:
            raise InputError(
                f"layout {layout.layout_id} has one direction only at {elevation:g} m; a nacelle "
                f"yawed by {yaw:g} deg needs two"
            )
        turn[np.ix_(own, own)] = axes @ to_nacelle @ np.linalg.pinv(axes)
    return turn


def biaxial_layout(
    layout_id: str,
    *,
    turbine: str,
    unit: str,
    elevations: Sequence[float],
    coupling: Coupling = "dc",
    corner_frequency: float = 0.0,
) -> SensorLayout:
    """Bi-axial accelerometers at the given elevations [m]: all fore-aft channels, then all
    side-side ones, each group in the order of `elevations`."""
    channels = tuple(
        Accelerometer(
            name=f"z{elevation:g}-{suffix}",
            elevation=elevation,
            direction=direction,
            coupling=coupling,
            corner_frequency=corner_frequency,
        )
        for suffix, direction in (("fa", FORE_AFT), ("ss", SIDE_SIDE))
        for elevation in elevations
    )
    return SensorLayout(layout_id, turbine=turbine, unit=unit, channels=channels)
