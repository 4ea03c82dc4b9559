"""What a data acquisition unit makes of accelerations: anti-alias decimation and ADC counts."""

import numpy as np
from numpy.typing import NDArray
from scipy.signal import fftconvolve, firwin, kaiserord

FloatArray = NDArray[np.float64]

PASS_BAND = 0.45  # end of the pass band over the output rate, as in delta-sigma converters [-]
STOP_BAND = 0.5  # begin of the stop band over the output rate: nothing folds back [-]
ATTENUATION = 80.0  # of the stop band [dB]; the pass band's ripple is then 1e-4


class Decimator:
    """Linear-phase anti-alias filter and decimation of a stream, its delay compensated.

    Output sample m belongs to the same instant as input sample m · factor. Outputs lag the inputs
    by the filter's half length; what lies before the first input counts as zero.
    """

    def __init__(self, factor: int, n_channels: int) -> None:
        self._factor = factor
        self._taps = anti_alias_taps(factor)
        self._half = len(self._taps) // 2
        self._pending = np.zeros((self._half, n_channels))

    def advance(self, samples: FloatArray) -> FloatArray:
        """Outputs that these inputs complete.

        samples   (n_in, n_channels)
        returns   (n_out, n_channels), n_out n_in / factor on average
        """
        pending = np.concatenate([self._pending, samples])
        n_out = max(0, (len(pending) - len(self._taps)) // self._factor + 1)
        self._pending = pending[n_out * self._factor :].copy()
        if n_out == 0:
            return np.empty((0, pending.shape[1]))
        filtered = fftconvolve(pending.T, self._taps[None, :], mode="valid", axes=1)
        return np.ascontiguousarray(filtered[:, :: self._factor].T)

    def gain(self, frequencies: FloatArray, input_rate: float) -> FloatArray:
        """Amplitude gain before folding, (n_frequencies,) [-]; the phase is zero."""
        lags = np.arange(-self._half, self._half + 1) / input_rate
        return np.cos(2.0 * np.pi * np.multiply.outer(frequencies, lags)) @ self._taps


def anti_alias_taps(factor: int) -> FloatArray:
    """Symmetric low-pass (Kaiser window) for decimation by `factor`, (odd,) [-].

    Flat to PASS_BAND and empty beyond STOP_BAND, both over the output rate.
    """
    if factor == 1:
        return np.ones(1)
    nyquist = factor / 2.0  # of the input, over the output rate
    n_taps, beta = kaiserord(ATTENUATION, (STOP_BAND - PASS_BAND) / nyquist)
    half = n_taps // 2
    cutoff = 0.5 * (PASS_BAND + STOP_BAND) / nyquist
    return firwin(2 * half + 1, cutoff, window=("kaiser", beta))


def quantised(samples: FloatArray, step: float) -> NDArray[np.float32]:
    """Samples as the converter counts them: the nearest multiple of its step.

    samples   any shape [m/s²]
    step      of the converter [m/s²], 0 for none; a power of two is exact in float32
    """
    if step == 0.0:
        return samples.astype(np.float32)
    return (np.round(samples / step) * step).astype(np.float32)
