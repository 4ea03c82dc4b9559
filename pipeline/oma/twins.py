"""Two modes of one frequency: a mast or a chimney that is alike in every direction.

Where two modes coincide, any two shapes of the plane that they span are modes as well, and the two
poles of an order take complex ones that differ from order to order: each is refused for itself,
rightly, and nothing would be left to see. Here is what there was.
"""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.bands import Band
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi_cov import SystemModes

ALIKE = 0.005  # twins' frequencies differ by less: by chance, or hardly, relative
PLACE = 0.003  # and stand in every order where they stand in the others, relative
PLANE = 0.3  # of the third to the first singular value of their real and imaginary parts
LARGEST_DAMPING = 0.05  # [-]


def twin_frequencies(
    systems: Sequence[SystemModes], band: Band, settings: OmaSettings
) -> tuple[float, ...]:
    """Where two poles stand side by side in most orders, mixed in every shape [Hz].

    systems   of all orders of the band, with the phases of accelerations
    """
    by_order = [_twins(system, band) for system in systems]
    places = np.concatenate(by_order) if by_order else np.empty(0)
    needed = settings.minimum_presence * len(systems)
    found: list[float] = []
    for place in np.sort(places):
        orders = sum(bool((np.abs(twins - place) <= PLACE * place).any()) for twins in by_order)
        if orders >= needed and not any(abs(place - f) <= 2 * PLACE * f for f in found):
            near = places[np.abs(places - place) <= 2 * PLACE * place]
            found.append(float(np.median(near)))
    return tuple(found)


def _twins(system: SystemModes, band: Band) -> NDArray[np.float64]:
    """Mean frequencies of the pairs of one order."""
    f, damping = system.frequencies, system.damping_ratios
    inside = (f >= band.lowest) & (f <= band.highest) & (damping > 0)
    index = np.flatnonzero(inside & (damping < LARGEST_DAMPING))
    index = index[np.argsort(f[index])]
    return np.array(
        [
            (f[one] + f[other]) / 2
            for one, other in pairwise(index)
            if f[other] - f[one] <= ALIKE * f[one] and _in_a_plane(system.shapes[:, [one, other]])
        ]
    )


def _in_a_plane(shapes: NDArray[np.complexfloating]) -> bool:
    """Whether two complex shapes mix two real ones. shapes: (n_channels, 2)"""
    unit = shapes / np.linalg.norm(shapes, axis=0)
    values = np.linalg.svd(np.hstack([unit.real, unit.imag]), compute_uv=False)
    return len(values) < 3 or bool(values[2] <= PLANE * values[0])
