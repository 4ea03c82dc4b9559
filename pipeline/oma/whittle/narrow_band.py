"""The Fourier lines of a window, and the few of them that a group of close modes is fitted to."""

from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np
from scipy import linalg

from pipeline.oma.preprocessing import lines_of_channels
from pipeline.oma.settings import HIGHEST_RELATIVE
from sensors.arrays import BoolArray, ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class NarrowBand:
    """Spectral matrices of the lines around a frequency, of scaled channels.

    Where modes are many lines wide, neighbouring lines are taken together: what their number
    costs is then the same for every mode.
    """

    matrices: ComplexArray
    """Mean of y_k y_kᴴ over the lines taken together, (n_bins, n_channels, n_channels) [-]."""
    numbers: FloatArray
    """Frequency × duration of each bin's middle, (n_bins,) [-]."""
    n_together: FloatArray
    """Lines in each bin, as far as they are left, (n_bins,)."""
    scales: FloatArray
    """Divisors of the channels, (n_channels,), in the samples' units."""
    duration: float
    """T of the window [s]."""
    integrations: IntArray
    """Of channels that measure different quantities, (n_channels,)."""

    @property
    def n_lines(self) -> float:
        """Lines of the periodogram in the band, as far as they are left."""
        return float(self.n_together.sum())

    @property
    def total(self) -> ComplexArray:
        """Sum of y_k y_kᴴ over the lines, (n_channels, n_channels)."""
        return np.asarray(np.tensordot(self.n_together, self.matrices, axes=1))

    @property
    def powers(self) -> FloatArray:
        """Of each channel at each bin, (n_bins, n_channels)."""
        return np.asarray(np.einsum("kii->ki", self.matrices).real)

    def only(self, chosen: BoolArray) -> "NarrowBand":
        """The chosen bins, which lie side by side."""
        return replace(
            self,
            matrices=self.matrices[chosen],
            numbers=self.numbers[chosen],
            n_together=self.n_together[chosen],
        )

    def accelerations(self, frequency: float) -> FloatArray:
        """Factors from the shapes of the scaled channels to those of accelerations,
        (n_channels,)."""
        return np.asarray(self.scales * (2 * np.pi * frequency) ** self.integrations)


WHOLE = 0.9  # share of a line's power of which no more was taken off than chance takes
LEAST_OF_A_LINE = 0.3  # share of its power: with less it is hardly more than what a removal missed


class WindowSpectrum:
    """Fourier transform of a window without a taper: lines k/T are nearly independent.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset, each channel in its own unit.
    sampling_rate : float
        [Hz].
    integrations : ndarray of int, shape (n_channels,), optional
        How often each channel's acceleration is integrated.
    left : ndarray, shape (n // 2 + 1,), optional
        Of each line's power, where a rotor's harmonics were taken off [-]: such a line counts as
        much as is left of it, and one of which hardly anything is left not at all. Taken for whole
        ones, they would make a mode's flank too steep: of 139 first modes 5 to 10 % off a harmonic
        (seeds 70031 to 70100) the damping came out 8 % lower than without it, and its 90 %
        intervals held .81; .88 since.

    Notes
    -----
    Lines above the frequencies at which modes are sought are in no band and no flank: there a
    recorder's filter takes a part of the background away, which a fit would lay to its modes.
    """

    def __init__(
        self,
        samples: FloatArray,
        sampling_rate: float,
        integrations: IntArray | None = None,
        left: FloatArray | None = None,
    ) -> None:
        n, n_channels = samples.shape
        self.duration = n / sampling_rate
        self.last = int(HIGHEST_RELATIVE * n)
        """Line up to which bands and flanks reach."""
        rms = np.sqrt(np.mean(samples**2, axis=0))
        self._scales = np.where(rms > 0, rms, 1.0)
        none = np.zeros(n_channels, dtype=np.int64)
        self._integrations = none if integrations is None else integrations
        self._lines = lines_of_channels(samples, self._scales)
        self._lines *= 1j**self._integrations
        self._lines /= n
        self._left = np.ones(len(self._lines)) if left is None else left[: len(self._lines)]
        self._left = np.where(self._left < LEAST_OF_A_LINE, 0.0, self._left)
        self._lines[self._left == 0] = 0.0

    def band(self, low: float, high: float, n_together: int = 1) -> NarrowBand:
        """Lines from a frequency to another [Hz], so many taken together."""
        first = max(1, round(low * self.duration))
        last = min(self.last, round(high * self.duration))
        n_bins = max(0, last - first + 1) // n_together
        stretch = slice(first, first + n_bins * n_together)
        binned = self._lines[stretch].reshape(n_bins, n_together, -1)
        return self._band_of(
            binned.transpose(0, 2, 1) @ binned.conj(),
            first + n_together * np.arange(n_bins) + (n_together - 1) / 2,
            self._left[stretch].reshape(n_bins, n_together).sum(axis=1),
        )

    def uneven_band(self, edges: IntArray) -> NarrowBand:
        """Bins from each of some lines up to the next one, the last of them left out."""
        parts = [self._lines[one:other] for one, other in pairwise(edges.tolist())]
        sums: ComplexArray = np.array([part.T @ part.conj() for part in parts])
        left = np.add.reduceat(self._left[: edges[-1]], edges[:-1])
        return self._band_of(sums, edges[:-1] + (np.diff(edges) - 1) / 2, left)

    def _band_of(self, sums: ComplexArray, numbers: FloatArray, left: FloatArray) -> NarrowBand:
        """Of bins with the sums of y_k y_kᴴ and what is left of their lines, those that are."""
        there = left > 0
        return NarrowBand(
            np.asarray(sums[there] / left[there, None, None]),
            numbers[there],
            left[there],
            self._scales,
            self.duration,
            self._integrations,
        )

    def is_whole(self, low: float, high: float, half_bandwidth: float) -> bool:
        """Whether all of the power between two resonances [Hz] and beside them is left."""
        reach = far_reach(half_bandwidth * self.duration)
        first = max(0, int(low * self.duration - reach))
        return bool((self._left[first : int(high * self.duration + reach) + 1] > WHOLE).all())

    def powers_over_flank(self, low: float, high: float, half_bandwidth: float) -> FloatArray:
        """Power at resonances over that beside them, direction by direction, largest first [-].

        Parameters
        ----------
        low, high : float
            Of the resonances [Hz].
        half_bandwidth : float
            ζ f of them [Hz].

        Returns
        -------
        ndarray, shape (n_channels,)
            Empty where the window ends.

        Notes
        -----
        A mode alone stands out in one direction, its shape; what surrounds it fills the others as
        much beside it as at it.
        """
        inner, far = 1.5 * half_bandwidth, 8 * half_bandwidth + 10 / self.duration
        near = 4 * half_bandwidth + 3 / self.duration
        centre, reach = (low + high) / 2, (high - low) / 2
        at = self._mean_matrix(centre, 0.0, reach + max(inner, 1.5 / self.duration))
        beside = self._mean_matrix(centre, reach + near, reach + far)
        if at is None or beside is None:
            return np.empty(0)
        beside += 1e-9 * np.trace(beside) * np.eye(len(beside))
        values: FloatArray = linalg.eigh(at, beside, eigvals_only=True)
        return values[::-1]

    def accelerations(self, frequency: float) -> FloatArray:
        """Factors from the shapes of the scaled channels to those of accelerations,
        (n_channels,)."""
        return np.asarray(self._scales * (2 * np.pi * frequency) ** self._integrations)

    def running_sums(self, stride: int, last: float) -> FloatArray:
        """Re y_k y_kᴴ of all lines before each block of so many lines, as far as a place [lines],
        (n_blocks + 1, n_channels, n_channels)."""
        n_blocks = min(int(last // stride) + 1, (self.last + 1) // stride)
        blocks = self._lines[: n_blocks * stride].reshape(n_blocks, stride, -1)
        sums = np.zeros((n_blocks + 1, blocks.shape[2], blocks.shape[2]))
        np.cumsum((blocks.transpose(0, 2, 1) @ blocks.conj()).real, axis=0, out=sums[1:])
        return sums

    def _mean_matrix(self, frequency: float, nearest: float, farthest: float) -> FloatArray | None:
        """Mean of Re y_k y_kᴴ over the lines whose distance from f is in between [Hz]."""
        centre, T = frequency * self.duration, self.duration
        low, high = int(np.ceil(centre - farthest * T)), int(np.floor(centre + farthest * T))
        numbers = np.arange(max(1, low), min(self.last, high) + 1)
        chosen = numbers[np.abs(numbers - centre) >= nearest * T]
        lines, left = self._lines[chosen], float(self._left[chosen].sum())
        return np.asarray((lines.T @ lines.conj()).real / left) if left > 0 else None


def peaks_and_flanks(
    sums: FloatArray, stride: int, centres: FloatArray, width: float
) -> tuple[FloatArray, FloatArray]:
    """Mean of Re y_k y_kᴴ at some places and beside them, (n, n_channels, n_channels) each.

    Parameters
    ----------
    sums : ndarray, shape (n_sums, n_channels, n_channels)
        Of `WindowSpectrum.running_sums`.
    stride : int
        Of the sums [lines].
    centres : ndarray, shape (n,)
        [lines].
    width : float
        Half bandwidth [lines].
    """

    def within(reach: float) -> tuple[FloatArray, FloatArray]:
        low = np.clip(np.ceil((centres - reach) / stride), 1, len(sums) - 2).astype(int)
        high = np.clip(np.floor((centres + reach) / stride) + 1, 1, len(sums) - 2).astype(int)
        return sums[high] - sums[low], stride * (high - low)[:, None, None]

    at, n_at = within(1.5 * width)
    near, n_near = within(4 * width + 3)
    far, n_far = within(far_reach(width))
    return at / np.maximum(n_at, 1), (far - near) / np.maximum(n_far - n_near, 1)


def far_reach(width: float) -> float:
    """How far the flanks of a peak reach [lines]."""
    return 8 * width + 10
