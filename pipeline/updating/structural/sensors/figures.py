"""Sensors that are not quite where, or as, their layout states: gains, headings and heights.

A channel of gain 1 + g, whose sensor is turned by α about the vertical and sits δ higher, reads

    r = (1 + g) (cos α r_c(z + δ) + sin α r_⊥(z + δ)),

r_c and r_⊥ what the model reads along the stated axis and across it (`placed_readings`). One angle
and one height belong to all channels at one elevation, the angle to the horizontal ones: a sensor
has its axes in one housing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.placed_readings import Placement

# Engineering judgement, all three: no standard states them.
GAIN_STD = 0.01  # of a channel, as usual data sheets of accelerometers have it [-]
HEADING_STD = 2.0  # of a sensor: alignment by eye to the nacelle's or the door's axis [deg]
HEIGHT_STD = 0.1  # of a sensor: flanges and platforms are built to centimetres, its bracket is
# measured from them by tape [m]


@dataclass(frozen=True, slots=True)
class SensorFigure:
    """One figure of the sensors."""

    kind: str
    """ "gain", "heading" or "height"."""
    target: str
    """Channel, or the elevation of a sensor: "z145-fa", "145 m"."""
    unit: str
    std: float
    """Of its prior [unit]; 1 of its coordinate."""
    channels: tuple[int, ...]
    """That it changes."""

    @property
    def name(self) -> str:
        """ "gain z145-fa", "heading 145 m"."""
        return f"{self.kind} {self.target}"


def sensor_figures(
    layout: SensorLayout,
    *,
    gain: float = GAIN_STD,
    heading: float = HEADING_STD,
    height: float = HEIGHT_STD,
) -> tuple[SensorFigure, ...]:
    """The figures of a layout's sensors; those with a standard deviation of 0 are exact."""
    elevations = sorted({channel.elevation for channel in layout.channels})
    found = [
        SensorFigure("gain", channel.name, "-", gain, (number,))
        for number, channel in enumerate(layout.channels)
    ]
    for elevation in elevations:
        here = tuple(n for n, c in enumerate(layout.channels) if c.elevation == elevation)
        level = tuple(n for n in here if any(layout.channels[n].direction[:2]))
        if level:
            found.append(SensorFigure("heading", f"{elevation:g} m", "deg", heading, level))
        found.append(SensorFigure("height", f"{elevation:g} m", "m", height, here))
    return tuple(figure for figure in found if figure.std > 0)


class SensorReadings:
    """Gains and places of the sensors by their figures, and derivatives of what channels read."""

    def __init__(self, figures: Sequence[SensorFigure], n_channels: int) -> None:
        self.figures = tuple(figures)
        self._stds = np.array([figure.std for figure in figures])
        shape = (len(self.figures), n_channels)
        self._gain, self._heading, self._height = (np.zeros(shape) for _ in range(3))
        for row, figure in enumerate(self.figures):
            table = {"gain": self._gain, "heading": self._heading, "height": self._height}
            scale = np.radians(figure.std) if figure.kind == "heading" else figure.std
            table[figure.kind][row, list(figure.channels)] = scale

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the figures."""
        return tuple(figure.name for figure in self.figures)

    def placement(self, z: FloatArray) -> Placement:
        """Where the sensors are at coordinates z, (r,), in prior standard deviations."""
        return Placement(z @ self._heading, z @ self._height)

    def gains(self, z: FloatArray) -> FloatArray:
        """(n_channels,) what channels read over what they should."""
        return np.asarray(1 + z @ self._gain)

    def slopes(
        self,
        z: FloatArray,
        readings: NDArray[Any],
        by_heading: NDArray[Any],
        by_height: NDArray[Any],
    ) -> NDArray[Any]:
        """Derivatives by z, (n_modes, n_channels, r), of what channels read with their gains.

        Parameters
        ----------
        z : ndarray, shape (r,)
            Figures of the sensors [prior standard deviations].
        readings, by_heading, by_height : ndarray, shape (n_modes, n_channels)
            What placed sensors of gain 1 read, and its derivatives by heading and height.
        """
        gains = self.gains(z)
        return np.asarray(
            readings[..., None] * self._gain.T
            + (by_heading * gains)[..., None] * self._heading.T
            + (by_height * gains)[..., None] * self._height.T
        )
