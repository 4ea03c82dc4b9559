"""Two modes of one frequency: a mast or a chimney that is alike in every direction.

Where two modes coincide, any two shapes of the plane that they span are modes as well, and the two
poles of an order take complex ones that differ from order to order: each is refused for itself,
rightly, and nothing would be left to see. What the orders agree upon is the mean of the two
(`twins_in`); the window's lines show their plane (`twin_pairs`). Where mean frequencies tell the
two directions of the plane apart, the two entries have these for shapes; else the directions that
shake most and least.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pipeline.messages import Mode
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import Band
from pipeline.oma.ssi.ssi_cov import SystemModes
from pipeline.oma.whittle.pairs import Partner, joint_pair
from sensors.arrays import FloatArray, IntArray

ALIKE = 0.005  # twins' frequencies differ by less: by chance, or hardly, relative
PLACE = 0.003  # and stand in every order where they stand in the others, relative
FLAT_SHAPE = 0.3  # of the third to the first singular value of their real and imaginary parts
LARGEST_DAMPING = 0.05  # [-]
HALF_WIDTH = 2.0  # of the narrow band, in lines 1/T
ABOVE_REST = 20.0  # a partner's eigenvalue over the next one [-]
TOLD_APART_FROM = (
    3.0  # half bandwidth from which mean frequencies tell two directions apart [lines]
)
APART_WIDTHS = 3.0  # half bandwidths to either side of the lines that do
# Of two resonances' distance, what the means of their power within R half bandwidths show: of a
# Lorentzian 1 − R / ((1 + R²) atan R), .76 at R = 3 [-].
SEEN_OF_DISTANCE = 1 - APART_WIDTHS / ((1 + APART_WIDTHS**2) * float(np.arctan(APART_WIDTHS)))
LARGEST_ANGLE = 0.5  # std of the turn between directions that are known apart [rad]


@dataclass(frozen=True, slots=True)
class CoincidentModes:
    """Two modes of one frequency, as the orders see them."""

    frequency: float
    """Mean of the two [Hz]."""
    damping_ratio: float
    """Mean of the two [-]."""
    frequency_scatter: float
    """Over the orders, standard deviation [Hz]."""
    damping_scatter: float
    """Likewise [-]."""


def twins_in(
    systems: Sequence[SystemModes], band: Band, settings: OmaSettings
) -> tuple[CoincidentModes, ...]:
    """Where two poles stand side by side in most orders, mixed in every shape.

    Parameters
    ----------
    systems : sequence of SystemModes
        Of all orders of the band, with the phases of accelerations.
    band : Band
        Whose poles are compared.
    settings : OmaSettings
        `minimum_presence` is the share of the orders that have to show the two.
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


@dataclass(frozen=True, slots=True, eq=False)
class Plane:
    """The two directions that shake at a frequency."""

    shape: FloatArray
    """Of the stronger one, (n_channels,), its largest component 1, in the samples' units."""
    partner: Partner
    """The weaker one."""
    half_distance: float = 0.0
    """Of the two resonances by the mean frequencies of their power; 0 where the window is too
    short for these [Hz]."""


class NarrowBandSpectrum:
    """Spectral matrices of a window in bands a few lines wide, with accelerations' phases."""

    def __init__(
        self, samples: FloatArray, sampling_rate: float, integrations: IntArray | None = None
    ):
        """samples: (n, n_channels), free of offset;  integrations: (n_channels,)"""
        n = len(samples)
        self.duration = n / sampling_rate
        self._scales = np.sqrt(np.mean(samples**2, axis=0))
        taper = np.hanning(n)[:, None]
        self._integrations = np.zeros(samples.shape[1]) if integrations is None else integrations
        self._lines = fft.rfft(samples / self._scales * taper, axis=0) * 1j**self._integrations

    def plane_at(self, frequency: float, half_width: float) -> Plane | None:
        """The two directions that shake within so many lines of a frequency; None where there are
        not just two."""
        values, vectors = np.linalg.eigh(self._matrix(frequency, 0, half_width))
        first, second, third = values[-1], values[-2], max(values[-3], np.finfo(float).tiny)
        if second < ABOVE_REST * third:
            return None
        scales = self._scales * (2 * np.pi * frequency) ** self._integrations
        axes, turn, apart = vectors[:, [-1, -2]] * np.sqrt([first, second]), None, 0.0
        if half_width >= TOLD_APART_FROM:
            told_apart, angle, apart = self._told_apart(axes, frequency, APART_WIDTHS * half_width)
            if angle < LARGEST_ANGLE:
                axes, turn = told_apart, angle
        stronger, weaker = sorted((axes * scales[:, None]).T, key=lambda axis: -float(axis @ axis))
        share = float(weaker @ weaker / (stronger @ stronger)) if turn else float(second / first)
        shape = stronger / stronger[np.argmax(np.abs(stronger))]
        partner = Partner(weaker, share, float(third / second), turn)
        return Plane(shape, partner, apart / SEEN_OF_DISTANCE / 2 / self.duration)

    def _told_apart(
        self, axes: FloatArray, frequency: float, reach: float
    ) -> tuple[FloatArray, float, float]:
        """The directions of a plane that differ most in mean frequency, (n_channels, 2), the std of
        their turn towards each other [rad], and the difference of these means [lines].

        Of whitened coordinates y over lines k, Σ yyᴴ = I, the axes are eigenvectors of
        M = Σ (k − k̄) Re yyᴴ; by its scatter var(M₁₂) = Σ (k − k̄)² |y₁|² |y₂|² / 2 they turn by
        std(M₁₂) / |m₁ − m₂|. (`whittle.selection.told_apart_by_place` has the source.)
        """
        numbers = np.arange(len(self._lines))
        near = np.abs(numbers - frequency * self.duration) <= reach
        inside = self._lines[near] @ np.linalg.pinv(axes).T
        offsets = numbers[near] - numbers[near].mean()
        lower = np.linalg.cholesky((inside.T @ inside.conj()).real)
        white = inside @ np.linalg.inv(lower).T
        means, turn = np.linalg.eigh(((white * offsets[:, None]).T @ white.conj()).real)
        power = np.abs(white @ turn) ** 2
        scatter = float(np.sqrt(0.5 * np.sum(offsets**2 * power[:, 0] * power[:, 1])))
        apart = float(means[1] - means[0])
        return axes @ lower @ turn, scatter / apart, apart

    def _matrix(self, frequency: float, nearest: float, farthest: float) -> FloatArray:
        """Mean real spectral matrix of the lines whose distance from f, in 1/T, is in between."""
        distance = np.abs(np.arange(len(self._lines)) - frequency * self.duration)
        lines = self._lines[(distance >= nearest) & (distance <= farthest)]
        return np.asarray((lines.T @ lines.conj()).real / max(1, len(lines)))


def twin_pairs(
    twins: Sequence[CoincidentModes],
    samples: FloatArray,
    sampling_rate: float,
    integrations: IntArray | None = None,
) -> list[Mode]:
    """Two entries of one `pair_id` for each twins of which the window shows the plane.

    Parameters
    ----------
    twins : sequence of CoincidentModes
        Places of two poles side by side.
    samples : ndarray, shape (n, n_channels)
        Of the window, each channel in its own unit.
    sampling_rate : float
        [Hz].
    integrations : ndarray of int, shape (n_channels,), optional
        Of channels that measure different quantities (`quantities.py`).

    Returns
    -------
    list of Mode
        Empty for fewer than three channels.

    Notes
    -----
    The mean's std is that of one mode by the uncertainty law (δf / f)² = (δζ)² = ζ / (2π f T):
    the mean of two is known √2 times better, by a subspace method about as much worse. What the
    orders scatter by comes to it, and half the distance of the two as the lines have it: poles take
    two modes for twins that are up to .7 half bandwidths apart (.7 % at ζ = 1 %), and bring them
    together.

    References
    ----------
    Au 2014, Mechanical Systems and Signal Processing 48, 15.
    """
    if samples.shape[1] < 3 or not twins:
        return []
    spectrum = NarrowBandSpectrum(samples, sampling_rate, integrations)
    found: list[Mode] = []
    for each in twins:
        cycles = each.frequency * spectrum.duration
        plane = spectrum.plane_at(each.frequency, max(HALF_WIDTH, each.damping_ratio * cycles))
        if plane is None:
            continue
        shape = plane.shape
        law = float(np.sqrt(each.damping_ratio / (2 * np.pi * cycles)))
        factor = np.zeros((2 + len(shape), 2))
        factor[0, 0] = np.hypot(law * each.frequency, each.frequency_scatter)
        factor[1, 1] = np.hypot(law, each.damping_scatter)
        leader = Mode(
            "",
            each.frequency,
            factor[0, 0],
            each.damping_ratio,
            factor[1, 1],
            shape,
            factor,
            0,
        )
        lines = np.array([0.5, np.hypot(0.5, 1.0)]) / spectrum.duration
        spreads = np.hypot(lines, plane.half_distance)
        found += joint_pair(leader, np.full(2, each.frequency), spreads, plane.partner)
    return found
