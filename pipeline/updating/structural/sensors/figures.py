"""Sensors that are not quite where, or as, their layout states: gains, headings and heights.

A channel of gain 1 + g, whose sensor is turned by α about the vertical and sits δ higher, reads

    r = (1 + g) (cos α r_c + sin α r_⊥ + δ dr_c/dz),

r_c and r_⊥ what the model reads along the stated axis and across it. One angle and one height
belong to all horizontal channels at one elevation: a sensor has both axes in one housing.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray

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
        found.append(SensorFigure("heading", f"{elevation:g} m", "deg", heading, here))
        found.append(SensorFigure("height", f"{elevation:g} m", "m", height, here))
    return tuple(figure for figure in found if figure.std > 0)


@dataclass(frozen=True, slots=True, eq=False)
class SensorState:
    """Gains, headings and heights at one point."""

    gains: FloatArray
    """(n_channels,) factors [-]"""
    headings: FloatArray
    """(n_channels,) [rad]"""
    heights: FloatArray
    """(n_channels,) above the stated ones [m]"""


class SensorReadings:
    """What channels read with their sensors' figures, and the derivatives by them."""

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

    def state(self, z: FloatArray) -> SensorState:
        """At coordinates z, (r,), in prior standard deviations."""
        return SensorState(1 + z @ self._gain, z @ self._heading, z @ self._height)

    def read(
        self,
        z: FloatArray,
        along: NDArray[Any],
        across: NDArray[Any],
        by_height: NDArray[Any],
    ) -> tuple[NDArray[Any], NDArray[Any]]:
        """Readings, (n_modes, n_channels), and their derivatives by z, (n_modes, n_channels, r).

        along, across, by_height   (n_modes, n_channels) r_c, r_⊥ and dr_c/dz of the model
        """
        state = self.state(z)
        cosine, sine = np.cos(state.headings), np.sin(state.headings)
        bare = cosine * along + sine * across + state.heights * by_height
        turned = (-sine * along + cosine * across) * state.gains
        raised = by_height * state.gains
        slopes = (
            bare[..., None] * self._gain.T
            + turned[..., None] * self._heading.T
            + raised[..., None] * self._height.T
        )
        return bare * state.gains, slopes

    def derived(self, z: FloatArray) -> FloatArray:
        """(n_channels,) factor from a derivative of r_c to one of the reading."""
        state = self.state(z)
        return np.asarray(state.gains * np.cos(state.headings))
