"""A water level that nothing reports, from the frequencies that it moves.

With the line of each track as it was, ŷ_j(l) = β_j + a_j l + b_j l² and its variance v_j, a and b
the model's (learned ones would leave the scale of l open), the level of a window is where

    Σ_j ρ((y_j − ŷ_j(l)) / √v_j) + (l − l₀)² / (2 q²),   q = 2 s sin(π Δt / M₂), at most 2 s,

is least: ρ Huber's, s the standard deviation of a level that nothing reports, l₀ the level Δt ago
and M₂ the period of the moon's tide, so that q is what the level can have moved. It counts from the
water of the first windows.

Source: Huber (1964), Annals of Mathematical Statistics 35, 73.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.change.sufficient_statistics import (
    CUT_MOMENTS,
    MODEL_SLOPE_PRIOR,
    ChangeSums,
    Regression,
    Seen,
    WatchedWindow,
)
from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray

MOON_TIDE = 44714.0  # period of M₂ [s]
ITERATED = 8  # times least squares
LEAST_MOBILITY = 0.02  # between two windows: waves, wind [m]
HUBER = 1.5  # standard deviations beyond which an error counts less [-]


@dataclass(frozen=True, slots=True)
class LastLevel:
    """The level of the last window."""

    level: float = 0.0
    """Level above the mean water level [m]."""
    time_ns: int | None = None
    """Start of that window; None: there was none."""

    def mobility(self, start_ns: int, level_std: float) -> float:
        """q, standard deviation of what the level has moved until start_ns [m].

        Parameters
        ----------
        start_ns : int
            Of the next window [ns].
        level_std : float
            s, of a level that nothing reports [m].
        """
        if self.time_ns is None:
            return level_std
        turns = abs(start_ns - self.time_ns) / NANOSECONDS / MOON_TIDE
        return 2 * level_std * float(np.sin(np.pi * min(turns, 0.5)))


def with_level_from_modes(
    window: WatchedWindow, sums: ChangeSums, seen: Seen, water: FloatArray, last: LastLevel
) -> WatchedWindow:
    """The window at the level that its frequencies imply; as the last one where none depends on it.

    Parameters
    ----------
    window : WatchedWindow
        Whose level nothing reports.
    sums : ChangeSums
        Of the windows before it.
    seen : Seen
        The window by the sums' columns.
    water : ndarray, shape (J, 2)
        The model's slope a [1/m] and curvature b [1/m²] of every track.
    last : LastLevel
        Level of the last window and its time.
    """
    window = replace(window, water_level=last.level)
    mobility = max(last.mobility(window.start_ns, window.level_std), LEAST_MOBILITY)
    moved = water[seen.columns].any(axis=1)
    if not moved.any():
        return window
    columns, values, stated = seen.columns[moved], seen.values[moved], seen.variances[moved]
    line = Regression.of(seen.totals, water, CUT_MOMENTS, MODEL_SLOPE_PRIOR)
    slope, curvature = water[columns].T
    level = window.water_level
    for _ in range(ITERATED):
        z = replace(window, water_level=level).surroundings
        off = values - z @ line.coefficients[:, columns] - (slope + curvature * level) * level
        variances = line.variance(z)[columns] + stated * sums.scatter_factor[columns]
        rises = slope + 2 * curvature * level
        weights = np.minimum(1.0, HUBER * np.sqrt(variances) / np.maximum(np.abs(off), 1e-300))
        pull = weights * rises / variances
        information = pull @ rises + mobility**-2
        level += float((pull @ off - (level - last.level) / mobility**2) / information)
    return replace(window, water_level=level)
