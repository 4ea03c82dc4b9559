"""What channels read whose sensors are turned, or sit higher, than their layout states.

The displacement of the tower's axis near a sensor is the polynomial of the fifth degree with the
model's values and slopes at the stated height and HALF_SPAN below and above it (Hermite's),
gravity's share the parabola through its slopes there. Beyond the tower's ends the motion goes on
rigidly, as a nacelle's frame moves with the flange that carries it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import StructuralModel

HALF_SPAN = 5.0  # of the interpolation below and above a sensor's stated height [m]


@dataclass(frozen=True, slots=True, eq=False)
class Placement:
    """Where the sensors really are."""

    headings: FloatArray
    """(n_channels,) of turn about the vertical, from x towards y [rad]"""
    heights: FloatArray
    """(n_channels,) above the stated ones [m]"""

    @classmethod
    def as_stated(cls, n_channels: int) -> "Placement":
        """Return every sensor as its layout has it."""
        return cls(np.zeros(n_channels), np.zeros(n_channels))


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Displacement and gravity's tilt along the channels' axes: φ and g ψ."""

    displacement: FloatArray
    """(n_channels, n)"""
    gravity_slope: FloatArray
    """(n_channels, n) [m/s² per unit coordinate]"""

    def read(self, vectors: FloatArray, squares: FloatArray) -> FloatArray:
        """φ + g ψ / ω², (n_modes, n_channels), of modes (n, n_modes) with ω² (n_modes,)."""
        return (self.displacement @ vectors + self.gravity_slope @ vectors / squares).T

    def turned(self, across: "Motion", headings: FloatArray) -> "Motion":
        """Along axes that are turned towards those across."""
        c, s = np.cos(headings)[:, None], np.sin(headings)[:, None]
        return Motion(
            c * self.displacement + s * across.displacement,
            c * self.gravity_slope + s * across.gravity_slope,
        )


@dataclass(frozen=True, slots=True, eq=False)
class PlacedReadings:
    """What channels read at one placement, and the derivatives by it."""

    motion: Motion
    by_heading: Motion
    """[1/rad]"""
    by_height: Motion
    """[1/m]"""


@dataclass(frozen=True, slots=True, eq=False)
class MovableReadings:
    """What the channels of a layout read of n coordinates, wherever their sensors are."""

    along: tuple[FloatArray, FloatArray]
    """Coefficients of displacement, (6, n_channels, n), and of g ψ, (3, n_channels, n), in powers
    of the height above the stated one over HALF_SPAN, along the channels' axes"""
    across: tuple[FloatArray, FloatArray]
    """The same along axes turned by a right angle from x towards y."""
    corner_frequencies: FloatArray
    """(n_channels,) of AC-coupled channels, 0 for DC [Hz]"""

    @classmethod
    def of(cls, model: StructuralModel, layout: SensorLayout) -> "MovableReadings":
        """Return the readings of a model's degrees of freedom.

        Raises
        ------
        LayoutError
            For a channel that is not on the tower.
        """
        stated = ChannelReadings.of(model, layout)
        along = [(channel.elevation, channel.direction) for channel in layout.channels]
        across = [(elevation, _at_a_right_angle(axis)) for elevation, axis in along]
        return cls(
            _coefficients(model, along), _coefficients(model, across), stated.corner_frequencies
        )

    def in_basis(self, basis: FloatArray) -> "MovableReadings":
        """The same of coordinates of a basis, (n_coordinates, n)."""
        along, across = (
            (displacement @ basis, slope @ basis)
            for displacement, slope in (self.along, self.across)
        )
        return replace(self, along=along, across=across)

    @property
    def stated(self) -> Motion:
        """Return the placement of sensors that are where their layout has them."""
        displacement, slope = self.along
        return Motion(displacement[0], slope[0])

    def at(self, placement: Placement) -> PlacedReadings:
        """Return what the channels read at a placement."""
        heights, headings = placement.heights, placement.headings
        along, across = _moved(self.along, heights), _moved(self.across, heights)
        raised = _raised(self.along, heights), _raised(self.across, heights)
        return PlacedReadings(
            motion=along.turned(across, headings),
            by_heading=along.turned(across, headings + np.pi / 2),
            by_height=raised[0].turned(raised[1], headings),
        )


def _at_a_right_angle(axis: Sequence[float]) -> tuple[float, float, float]:
    """A level axis turned by a right angle about z: x becomes y, y becomes −x. An upright one has
    none, and is not turned (`sensor_figures`)."""
    x, y, _ = axis
    return (-y, x, 0.0)


def _coefficients(
    model: StructuralModel, places: Sequence[tuple[float, Sequence[float]]]
) -> tuple[FloatArray, FloatArray]:
    """Return coefficients of displacement and g ψ at heights along axes."""
    below, here, above = (
        np.array([_followed(model, z + rise, axis) for z, axis in places])
        for rise in (-HALF_SPAN, 0.0, HALF_SPAN)
    )  # (n_channels, 2, n_coordinates): displacement and slope
    f, d = here[:, 0], here[:, 1] * HALF_SPAN
    lower, upper = below[:, 1] * HALF_SPAN, above[:, 1] * HALF_SPAN
    even = (above[:, 0] + below[:, 0]) / 2 - f
    odd = (above[:, 0] - below[:, 0]) / 2 - d
    even_slope, odd_slope = (upper - lower) / 2, (upper + lower) / 2 - d
    displacement = np.stack(
        [
            f,
            d,
            2 * even - even_slope / 2,
            (5 * odd - odd_slope) / 2,
            even_slope / 2 - even,
            (odd_slope - 3 * odd) / 2,
        ]
    )
    slopes = np.stack([d, (upper - lower) / 2, (upper + lower) / 2 - d]) / HALF_SPAN
    return displacement, model.description.gravity * slopes


def _followed(model: StructuralModel, elevation: float, axis: Sequence[float]) -> FloatArray:
    """(2, n_dofs) displacement and slope at a height; beyond the tower's ends those of a rigid
    body that its end carries."""
    turbine = model.description
    inside = float(np.clip(elevation, turbine.mudline, turbine.tower_top))
    slope = model.tower_slope(inside, axis)
    return np.array([model.tower_displacement(inside, axis) + (elevation - inside) * slope, slope])


def _moved(coefficients: tuple[FloatArray, FloatArray], heights: FloatArray) -> Motion:
    return Motion(*(_polynomial(each, heights / HALF_SPAN) for each in coefficients))


def _raised(coefficients: tuple[FloatArray, FloatArray], heights: FloatArray) -> Motion:
    """Derivatives by the heights [1/m]."""
    derived = (
        each[1:] * (np.arange(1, len(each)) / HALF_SPAN)[:, None, None] for each in coefficients
    )
    return Motion(*(_polynomial(each, heights / HALF_SPAN) for each in derived))


def _polynomial(coefficients: FloatArray, x: FloatArray) -> FloatArray:
    """(n_channels, n) of coefficients (k, n_channels, n), lowest first, at x (n_channels,)."""
    found = coefficients[-1]
    for each in coefficients[-2::-1]:  # Horner's scheme
        found = found * x[:, None] + each
    return found
