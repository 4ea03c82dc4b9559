"""Section [calibration] of a description: what measurements have reported of its figures.

    [calibration]
    source = "week-1.mcap, week-2.mcap: 1008 windows at 9 water levels"
    springs_sign = "published"
    names = ["steel_modulus", "rna_mass", "gain z41-fa"]
    stds = [0.01, 0.02, 0.01]

    [[calibration.alternatives]]
    name = "converged blades"
    weight = 0.8
    mean = [0.4, -0.1, 0.2]
    covariance = [0.5, -0.3, 0.6, 0.0, 0.0, 0.9]

Mean and covariance are in the figures' coordinates, standard normal before the calibration; `stds`
are the standard deviations of the priors that it began with.
"""

from dataclasses import dataclass

import numpy as np

from sensors.arrays import FloatArray
from sensors.errors import InputError


@dataclass(frozen=True, slots=True)
class AlternativeFigures:
    """What one of the structure's alternatives makes of the measurements."""

    name: str
    """Of the alternative."""
    weight: float
    """Its probability [-]."""
    mean: tuple[float, ...]
    """(n,) [prior standard deviations]."""
    covariance: tuple[float, ...]
    """Lower triangle by rows, (n (n + 1) / 2,)."""

    def __post_init__(self) -> None:
        n = len(self.mean)
        if len(self.covariance) != n * (n + 1) // 2:
            raise InputError(
                f"calibration of {self.name!r}: covariance has {len(self.covariance)} values; the "
                f"lower triangle of {n} figures has {n * (n + 1) // 2}"
            )
        if not 0 < self.weight <= 1:
            raise InputError(
                f"calibration of {self.name!r}: weight is {self.weight:g}; a probability is needed"
            )
        if np.any(np.linalg.eigvalsh(self.matrix) <= 0):
            raise InputError(
                f"calibration of {self.name!r}: the covariance is not positive definite"
            )

    @property
    def matrix(self) -> FloatArray:
        """Return the covariance, (n, n)."""
        n = len(self.mean)
        found = np.zeros((n, n))
        found[np.tril_indices(n)] = self.covariance
        return found + np.tril(found, -1).T


@dataclass(frozen=True, slots=True)
class Calibration:
    """The joint posterior of a structure's figures after a first period of measurements."""

    springs_sign: str
    """Sign of k12 in the model of the calibration."""
    names: tuple[str, ...]
    """(n,) of the figures of the structure and of the sensors."""
    stds: tuple[float, ...]
    """(n,) of their priors, each in its figure's unit."""
    alternatives: tuple[AlternativeFigures, ...]
    """The likeliest first."""
    source: str = ""
    """Which sessions, windows and water levels."""

    def __post_init__(self) -> None:
        if not self.alternatives:
            raise InputError("calibration: it has no alternative")
        for each in self.alternatives:
            if len({len(self.names), len(self.stds), len(each.mean)}) > 1:
                raise InputError(
                    f"calibration of {each.name!r}: {len(self.names)} names, {len(self.stds)} stds "
                    f"and {len(each.mean)} means; one of each for every figure is needed"
                )
        for name, std in zip(self.names, self.stds, strict=True):
            if not std > 0:
                raise InputError(f"calibration: the std of {name} is {std:g}; it is positive")
