"""Fourier lines of a window's channels."""

import numpy as np
from scipy import fft

from sensors.arrays import ComplexArray, FloatArray


def lines_of_channels(
    samples: FloatArray, scales: FloatArray, taper: FloatArray | None = None
) -> ComplexArray:
    """Fourier lines of each channel over its scale, (n // 2 + 1, n_channels).

    One channel is transformed after the other: all at once would hold three copies of the samples.

    samples   (n, n_channels)
    scales    (n_channels,)
    taper     (n,); None: none
    """
    lines = np.empty((len(samples) // 2 + 1, len(scales)), dtype=np.complex128)
    for place, scale in enumerate(scales):
        channel = samples[:, place] / scale
        lines[:, place] = fft.rfft(channel if taper is None else taper * channel)
    return lines
