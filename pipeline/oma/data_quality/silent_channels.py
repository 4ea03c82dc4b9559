"""Does a channel measure anything? A broken cable or a dead sensor often gives noise, not zeros.

A channel is silent where no line of its spectrum stands out of those around it, as a mode's do, and
no line of it follows another channel's. Of K averaged periodograms of independent noise,

    P(γ² > c) = (1 − c)^(K−1)

at each line and pair of channels. One of the two alone proves nothing: two axes of one sensor may
share no motion, and a motor's harmonics may reach a dead channel's wires.
Source: Bendat and Piersol, "Random Data" (2010), section 9.2, for the estimates' distributions.
"""

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from sensors.arrays import BoolArray

SILENT_CHANNEL = "silent-channel"  # code of the warning
SEGMENTS = 30  # K
FEWEST_LINES = 32  # of a segment: below, what stands out of what cannot be told
BACKGROUND = 21  # lines about one over which the median is the background
LOWEST = 3  # line from which on one has such a background
STANDS_OUT = 2.5  # of a line over its background: at most 2.2 in 1000 records of noise (seed 18880)
FOLLOWS = 0.5  # γ² of two channels at a line: 2e-9 of independent noise is above


def silent_channels(samples: NDArray[np.floating]) -> BoolArray:
    """Tell which channels give noise alone beside others that measure.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        In any unit, each channel in its own.

    Returns
    -------
    ndarray, shape (n_channels,)
        All False where none measures, or where there are too few samples to tell.
    """
    n = len(samples) // SEGMENTS
    none = np.zeros(samples.shape[1], dtype=bool)
    if n // 2 < FEWEST_LINES or samples.shape[1] < 2:
        return none
    parts = np.asarray(samples[: n * SEGMENTS], dtype=np.float64).reshape(SEGMENTS, n, -1)
    tapered = (parts - parts.mean(axis=1, keepdims=True)) * np.hanning(n)[:, None]
    lines = np.fft.rfft(tapered, axis=1)[:, LOWEST:]  # (K, n_lines, n_channels)
    powers = np.mean(np.abs(lines) ** 2, axis=0)
    background = ndimage.median_filter(powers, size=(BACKGROUND, 1), mode="nearest")
    quiet = powers.max(axis=0, initial=0.0, where=powers > STANDS_OUT * background) == 0
    if not quiet.any() or quiet.all():
        return none
    cross = np.einsum("kfa,kfb->fab", lines[..., quiet].conj(), lines) / SEGMENTS
    products = powers[:, quiet, None] * powers[:, None, :]
    coherence = np.abs(cross) ** 2 / np.where(products > 0, products, np.inf)
    coherence[:, np.arange(quiet.sum()), np.flatnonzero(quiet)] = 0.0  # of a channel with itself
    none[quiet] = coherence.max(axis=(0, 2)) < FOLLOWS
    return none
