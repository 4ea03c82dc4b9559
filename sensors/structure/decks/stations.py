"""Means between the stations of a taper, and where to cut it: tubes are uniform."""

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from sensors.arrays import FloatArray

SHORTEST = 0.1  # stations of two tables that are nearer to each other are one [m]


def mean_between(x: FloatArray, y: FloatArray, low: float, high: float) -> float:
    """Return the mean of the straight lines through (x, y) from `low` to `high`.

    Two stations at one place are a step.
    """
    places = np.unique(np.concatenate([[low, high], x[(x > low) & (x < high)]]))
    middle = np.interp((places[1:] + places[:-1]) / 2, x, y)  # of a line its mean
    return float(np.sum(middle * np.diff(places)) / (high - low))


def edges_of(stations: Iterable[float], longest: float) -> list[float]:
    """Return stations in ascending order, with cuts where two are further apart than `longest`."""
    places = np.unique(np.fromiter(stations, dtype=np.float64)).tolist()
    edges = places[:1]
    for low, high in pairwise(places):
        n = max(math.ceil((high - low) / longest - 1e-9), 1)
        edges += np.linspace(low, high, n + 1)[1:].tolist()
    return edges


def joined(first: Iterable[float], *others: Iterable[float]) -> list[float]:
    """Return all stations, those of the earlier table where two are the same but for rounding."""
    kept = list(first)
    for stations in others:
        kept += [each for each in stations if min(abs(each - other) for other in kept) > SHORTEST]
    return kept
