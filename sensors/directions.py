"""Directions in degrees, of which 360 is 0 again: their mean, and how far they are from it.

359.7, 0.3  ──►  unit vectors  ──►  resultant  ──►  mean 0, deviations −0.3 and 0.3
"""

import math
from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray

_DECIMALS = 9  # of a mean [deg]: beyond them is what sine and cosine have rounded


@dataclass(frozen=True, slots=True)
class DirectionSum:
    """Directions added up as unit vectors."""

    resultant: complex = 0j
    """Sum of exp(iθ) [-]."""
    lowest: float = math.inf
    """Smallest direction as it was given [deg]."""

    def plus(self, directions: FloatArray) -> "DirectionSum":
        """Return the sum with more directions, (n,) [deg]."""
        if not len(directions):
            return self
        added = complex(np.sum(np.exp(1j * np.radians(directions))))
        return DirectionSum(self.resultant + added, min(self.lowest, float(np.min(directions))))

    @property
    def mean(self) -> float:
        """Direction of the resultant [deg]: 0 to 360 as all that were given, −180 to 180 if one
        was below 0; NaN if none was given or one is unknown."""
        if not math.isfinite(self.lowest):
            return math.nan
        direction = round(math.degrees(np.angle(self.resultant)), _DECIMALS)
        return direction % 360.0 if self.lowest >= 0.0 else direction


def mean_direction(directions: FloatArray) -> float:
    """Return the mean of directions, (n,), as `DirectionSum.mean` has it [deg]."""
    return DirectionSum().plus(directions).mean


def turned_from(directions: FloatArray, reference: float) -> FloatArray:
    """Return how far directions are turned from another, the shorter way, (n,) [deg]."""
    return (np.asarray(directions) - reference + 180.0) % 360.0 - 180.0
