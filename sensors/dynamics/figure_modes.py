"""Modes of a structure whose figures depart from the described ones, as found by `FigureModel`."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class FigureModes:
    """Visible modes at n points, lowest first; fewer than n_modes at some: NaN at the end."""

    frequencies: FloatArray
    """(n, n_modes) [Hz]"""
    shapes: FloatArray
    """(n, n_modes, n_channels), as the channels read them, largest component 1 [-]"""
    admissible: NDArray[np.bool_]
    """(n,) springs positive definite, structure stable"""


@dataclass(frozen=True, slots=True, eq=False)
class Linearisation:
    """Modes at one point and their derivatives by springs, figures and level."""

    frequencies: FloatArray
    """(n_modes,) [Hz]"""
    shapes: FloatArray
    """(n_modes, n_channels), largest component 1 [-]"""
    log_frequency_slopes: FloatArray
    """∂ ln f, (n_modes, p), p: k11, k22, k12 [per N/m, …], then each figure's departure, then the
    level [1/m]"""
    readings: FloatArray
    """(n_modes, n_channels) what the channels read of the mass-normalised modes, complex for an
    AC-coupled channel"""
    reading_slopes: FloatArray
    """(n_modes, n_channels, p) their derivatives"""
    by_heading: FloatArray
    """(n_modes, n_channels) derivatives of the readings by the sensors' turn about z [1/rad]"""
    by_height: FloatArray
    """(n_modes, n_channels) derivatives of the readings by the sensors' heights [1/m]"""
    vectors: FloatArray
    """(n_modes, n_dofs) mass-normalised modes"""
