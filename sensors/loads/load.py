"""What every load has in common: its errors, its generators of randomness, its face."""

from collections.abc import Iterator
from enum import IntEnum
from typing import Protocol

import numpy as np

from sensors.arrays import ComplexArray, FloatArray
from sensors.errors import InputError


class LoadError(InputError):
    """A load that cannot be; the message names the quantity and its value."""


class RandomStream(IntEnum):
    """Each source of randomness has its own generator: adding one leaves the others' draws."""

    TOWER = 0
    BLADES = 1
    WAVES = 2
    SENSOR_NOISE = 3
    SEA = 4
    WIND_ALONG = 5
    WIND_ACROSS = 6
    ROTOR = 7
    CLOCK = 8
    FAULTS = 9
    SCADA = 10


def generator(seed: int, stream: RandomStream) -> np.random.Generator:
    """Return the generator of one source of randomness of the experiment with this seed."""
    return np.random.default_rng([seed, stream])


class Load(Protocol):
    """Random forces on the structure as series without end, each in a fixed pattern."""

    @property
    def distribution(self) -> FloatArray:
        """(n_dofs, n_series): forces on the degrees of freedom per unit of each series [N]."""
        ...

    @property
    def n_series(self) -> int:
        """Number of series."""
        ...

    def series(self, seed: int, chunk: int) -> Iterator[FloatArray]:
        """Return the series from the first step on, in chunks (chunk, n_series) [-]."""
        ...

    def response_spectrum(self, frequencies: FloatArray, gains: ComplexArray) -> FloatArray:
        """One-sided spectral density of what this load makes a linear structure do.

        Parameters
        ----------
        frequencies : ndarray, shape (n_frequencies,)
            Frequencies [Hz].
        gains : ndarray, shape (n_frequencies, n_outputs, n_series)
            Output per unit of each series.

        Returns
        -------
        ndarray, shape (n_frequencies, n_outputs)
            [unit of the gains², per Hz].

        Notes
        -----
        Of the load's linear part, where a part of it is not linear.
        """
        ...


def require_positive(what: str, value: float, unit: str) -> None:
    """Raise LoadError for a value that is not positive."""
    if not value > 0:
        raise LoadError(f"{what} is {value:g} {unit}; it must be positive")


def require_not_negative(what: str, value: float, unit: str) -> None:
    """Raise LoadError for a negative value."""
    if not value >= 0:
        raise LoadError(f"{what} is {value:g} {unit}; it must be 0 or more")
