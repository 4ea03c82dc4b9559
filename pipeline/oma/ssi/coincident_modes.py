"""Two modes of one frequency: a mast or a chimney that is alike in every direction.

Where two modes coincide, any two shapes of the plane that they span are modes as well, and the two
poles of an order take complex ones that differ from order to order: each is refused for itself,
rightly, and nothing would be left to see. What the orders agree upon is the mean of the two.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.ssi_cov import SystemModes

ALIKE = 0.005  # twins' frequencies differ by less: by chance, or hardly, relative
PLACE = 0.003  # and stand in every order where they stand in the others, relative
FLAT_SHAPE = 0.3  # of the third to the first singular value of their real and imaginary parts
LARGEST_DAMPING = 0.05  # [-]


@dataclass(frozen=True, slots=True)
class CoincidentModes:
    """Two modes of one frequency, as the orders see them."""

    frequency: float  # mean of the two [Hz]
    damping_ratio: float  # mean of the two [-]
    frequency_scatter: float  # over the orders, standard deviation [Hz]
    damping_scatter: float  # likewise [-]


def twins_in(
    systems: Sequence[SystemModes], band: Band, settings: OmaSettings
) -> tuple[CoincidentModes, ...]:
    """Where two poles stand side by side in most orders, mixed in every shape.

    systems   of all orders of the band, with the phases of accelerations
    """
    by_order = [_pairs(system, band) for system in systems]
    places = np.concatenate(by_order) if by_order else np.empty((0, 2))
    needed = settings.minimum_presence * len(systems)
    found: list[CoincidentModes] = []
    for place in np.sort(places[:, 0]).tolist():
        orders = sum(bool(_near(place, each[:, 0], PLACE).any()) for each in by_order)
        if orders < needed or any(_near(place, each.frequency, 2 * PLACE) for each in found):
            continue
        near = places[_near(place, places[:, 0], 2 * PLACE)]
        frequency, damping = np.median(near, axis=0).tolist()
        found.append(CoincidentModes(frequency, damping, *near.std(axis=0).tolist()))
    return tuple(found)


def _near(place: float, other: Any, share: float) -> Any:
    """Whether another frequency, or each of many, is there."""
    return np.abs(other - place) <= share * place


def _pairs(system: SystemModes, band: Band) -> NDArray[np.float64]:
    """(n, 2) mean frequency [Hz] and mean damping ratio of the pairs of one order."""
    f, damping = system.frequencies, system.damping_ratios
    inside = (f >= band.lowest) & (f <= band.highest) & (damping > 0)
    index = np.flatnonzero(inside & (damping < LARGEST_DAMPING))
    index = index[np.argsort(f[index])]
    found = [
        ((f[one] + f[other]) / 2, (damping[one] + damping[other]) / 2)
        for one, other in pairwise(index)
        if f[other] - f[one] <= ALIKE * f[one] and _in_a_plane(system.shapes[:, [one, other]])
    ]
    return np.array(found).reshape(-1, 2)


def _in_a_plane(shapes: NDArray[np.complexfloating]) -> bool:
    """Whether two complex shapes mix two real ones. shapes: (n_channels, 2)"""
    unit = shapes / np.linalg.norm(shapes, axis=0)
    values = np.linalg.svd(np.hstack([unit.real, unit.imag]), compute_uv=False)
    return len(values) < 3 or bool(values[2] <= FLAT_SHAPE * values[0])
