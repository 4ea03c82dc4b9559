"""Band-limited interpolation: a sampled signal at other instants than it was sampled at."""

import numpy as np

from sensors.arrays import FloatArray

HALF_LENGTH = 32  # of the kernel, either side [samples of the narrower band]
KAISER = 8.0  # shape of its window: 80 dB beyond the transition
ON_A_SAMPLE = 1e-6  # distance from a sample that counts as none [samples]


def interpolated(samples: FloatArray, positions: FloatArray, *, band: float = 1.0) -> FloatArray:
    """Return the signal at fractional positions, (m, n_channels).

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Evenly spaced, each channel in its own unit; NaN spreads over the kernel's length.
    positions : ndarray, shape (m,)
        Counted in samples from the first, 0 to n − 1.
    band : float, optional
        Of the output over the input's: its sampling rate over theirs where it is lower, which keeps
        what lies above from folding back [-].

    Notes
    -----
    A windowed sinc (Kaiser), good to about 1e-3 below .45 of the narrower sampling rate; beyond
    either end the signal counts as constant.

    References
    ----------
    Smith and Gossett (1984), "A flexible sampling-rate conversion method", ICASSP.
    """
    band = min(band, 1.0)
    nearest = np.round(positions)
    if band == 1.0 and np.all(np.abs(positions - nearest) < ON_A_SAMPLE):
        return np.asarray(samples[nearest.astype(int)], dtype=np.float64)
    reach = int(np.ceil(HALF_LENGTH / band))
    first = np.floor(positions).astype(int) - reach + 1
    places = first[:, None] + np.arange(2 * reach)  # (m, taps)
    distance = positions[:, None] - places
    taps = np.sinc(band * distance) * _kaiser(distance / reach)
    taps /= taps.sum(axis=1, keepdims=True)
    held = samples[np.clip(places, 0, len(samples) - 1)]  # (m, taps, n_channels)
    return np.einsum("mt,mtc->mc", taps, held)


def _kaiser(x: FloatArray) -> FloatArray:
    """Return the window at x, 1 in the middle, from −1 to 1."""
    return np.asarray(np.i0(KAISER * np.sqrt(np.clip(1 - x**2, 0, None))) / np.i0(KAISER))
