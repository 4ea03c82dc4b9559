"""AC-coupled accelerometers: each channel's high-pass, as a filter that carries its memory."""

import numpy as np

from sensors.arrays import ComplexArray, FloatArray


class ChannelCoupling:
    """First-order high-pass of each AC-coupled channel, s / (s + 2π f_corner); DC passes all.

    Parameters
    ----------
    corner_frequencies : ndarray, shape (n_channels,)
        Corner frequencies [Hz]; 0 for a DC-coupled axis.
    """

    def __init__(self, corner_frequencies: FloatArray, sampling_rate: float) -> None:
        self._filters = _high_pass(corner_frequencies, sampling_rate)
        self._memory = np.zeros((len(corner_frequencies), 1))
        self._coupled = np.flatnonzero(corner_frequencies)
        self._rate = sampling_rate

    def advance(self, readings: FloatArray) -> None:
        """Filter the next samples in place, (n_channels, n_samples)."""
        from scipy.signal import lfilter  # 75 MB that only a simulation needs

        for channel in self._coupled:
            numerator, denominator = self._filters[channel]
            readings[channel], self._memory[channel] = lfilter(
                numerator, denominator, readings[channel], zi=self._memory[channel]
            )

    def gain(self, frequencies: FloatArray) -> ComplexArray:
        """Response of each channel at frequencies [Hz], (n_frequencies, n_channels, 1)."""
        delay = np.exp(-2j * np.pi * frequencies / self._rate)
        numerator, denominator = self._filters[:, 0], self._filters[:, 1]
        gain = (numerator[:, :1] + numerator[:, 1:] * delay) / (
            denominator[:, :1] + denominator[:, 1:] * delay
        )  # (n_channels, n_frequencies)
        return gain.T[:, :, None]


def _high_pass(corner_frequencies: FloatArray, sampling_rate: float) -> FloatArray:
    """First-order high-pass of each channel by the bilinear transform, (n_channels, 2, 2).

    [channel, 0] is the numerator, [channel, 1] the denominator; a corner of 0 passes everything.
    """
    corner = np.tan(np.pi * corner_frequencies / sampling_rate)  # prewarped
    passing = corner == 0.0
    numerator = np.stack([np.ones_like(corner), np.where(passing, 0.0, -1.0)], axis=1)
    denominator = np.stack([1.0 + corner, np.where(passing, 0.0, corner - 1.0)], axis=1)
    return np.stack([numerator, denominator], axis=1)
