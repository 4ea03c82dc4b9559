"""What accelerometers read of the structure's motion: acceleration, and gravity by their tilt."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.layout import LayoutError, SensorLayout
from sensors.arrays import FloatArray, IndexArray
from sensors.structure.description import TurbineDescription
from sensors.structure.structural_model import StructuralModel


def require_on_tower(layout: SensorLayout, turbine: TurbineDescription) -> None:
    """Raise LayoutError for a channel that is not on the tower."""
    for channel in layout.channels:
        if not turbine.mudline <= channel.elevation <= turbine.tower_top:
            raise LayoutError(
                f"channel {channel.name}: elevation {channel.elevation:g} m is not on the "
                f"tower of {turbine.name}, {turbine.mudline:g} to {turbine.tower_top:g} m"
            )


@dataclass(frozen=True, slots=True, eq=False)
class ChannelReadings:
    """What the channels of a layout read from the model's coordinates.

    An axis reads u'' − g ψ. In a mode of circular frequency ω that is −ω² (φ + g ψ / ω²), times
    the gain H(f) of the channel's coupling.
    """

    displacement: FloatArray
    """Displacement, (n_channels, n_coordinates): u along each axis."""

    gravity_slope: FloatArray
    """g ψ, (n_channels, n_coordinates) [m/s² per unit coordinate]."""

    corner_frequencies: FloatArray
    """Corner frequencies of AC-coupled channels, 0 for DC, (n_channels,) [Hz]."""

    @classmethod
    def of(cls, model: StructuralModel, layout: SensorLayout) -> "ChannelReadings":
        """Return what a layout reads of a model's degrees of freedom.

        Raises
        ------
        LayoutError
            For a channel that is not on the tower.
        """
        require_on_tower(layout, model.description)
        places = [(channel.elevation, channel.direction) for channel in layout.channels]
        displacement = np.array([model.tower_displacement(*place) for place in places])
        slope = np.array([model.tower_slope(*place) for place in places])
        corners = [
            channel.corner_frequency if channel.coupling == "ac" else 0.0
            for channel in layout.channels
        ]
        return cls(displacement, model.description.gravity * slope, np.array(corners))

    def in_basis(self, basis: FloatArray) -> "ChannelReadings":
        """Return the same for coordinates of a basis, (n_coordinates, n_basis)."""
        return ChannelReadings(
            self.displacement @ basis, self.gravity_slope @ basis, self.corner_frequencies
        )

    def of_channels(self, channels: IndexArray) -> "ChannelReadings":
        """Return the same for some of the channels."""
        return ChannelReadings(
            self.displacement[channels],
            self.gravity_slope[channels],
            self.corner_frequencies[channels],
        )

    def shapes(self, vectors: FloatArray, squares: FloatArray) -> FloatArray:
        """Shapes as the channels read them, largest component 1.

        Parameters
        ----------
        vectors : ndarray, shape (..., n_coordinates)
            Modes in the model's coordinates.
        squares : ndarray
            ω², (...) [rad²/s²].

        Returns
        -------
        ndarray, shape (..., n_channels)
            Dimensionless [-].
        """
        readings = vectors @ self.displacement.T
        readings += vectors @ self.gravity_slope.T / squares[..., None]
        if np.any(self.corner_frequencies > 0):
            frequencies = np.sqrt(squares)[..., None] / (2 * np.pi)
            readings = readings / (1 - 1j * self.corner_frequencies / frequencies)
        return _normalised(readings)


def _normalised(readings: NDArray[np.float64] | NDArray[np.complex128]) -> FloatArray:
    """Real shapes whose largest component is 1 ([foundation-updating] Eq. 11); unseen ones 0."""
    places = np.argmax(np.abs(readings), axis=-1)[..., None]
    largest = np.take_along_axis(readings, places, axis=-1)
    return np.real(np.divide(readings, largest, out=np.zeros_like(readings), where=largest != 0))
