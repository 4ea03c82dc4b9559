"""From raw samples to a band's samples: offset or drift taken off, decimated."""

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy import signal

FloatArray = NDArray[np.float64]

STOP_BAND_ATTENUATION = 70.0  # [dB]: aliases stay below the noise of a good accelerometer
PASS_BAND = 0.44  # of the decimated rate: flat to here,
STOP_BAND = 0.56  # and shut from here, so that aliases fold back above the pass band only


@lru_cache(maxsize=32)
def anti_alias_taps(decimation: int) -> FloatArray:
    """Linear-phase low-pass filter for decimation by q, symmetric, gain 1 at 0 Hz.

    Why a finite, symmetric one: every channel is delayed by the same constant, so shapes keep
    their phase; and a finite impulse response adds no poles, so neither frequency nor damping is
    moved (only the first lags see the filter at all).
    """
    if decimation == 1:
        return np.ones(1)
    width = (STOP_BAND - PASS_BAND) / decimation / 0.5  # of the original Nyquist frequency
    n_taps, beta = signal.kaiserord(STOP_BAND_ATTENUATION, width)
    n_taps |= 1  # odd: the delay is a whole number of samples
    cutoff = 0.5 * (PASS_BAND + STOP_BAND) / decimation / 0.5
    return np.asarray(signal.firwin(n_taps, cutoff, window=("kaiser", beta)))


def decimated(samples: FloatArray, decimation: int) -> FloatArray:
    """Every q-th sample after the anti-alias filter, where the filter is wholly filled.

    samples   (n, n_channels)
    returns   (n_decimated(n, q), n_channels), empty for a short record
    """
    if decimation == 1:
        return samples
    if n_decimated(len(samples), decimation) <= 0:
        return samples[:0]
    taps = anti_alias_taps(decimation)
    filtered = signal.upfirdn(taps, samples, down=decimation, axis=0)
    first = -(-(len(taps) - 1) // decimation)
    last = (len(samples) - 1) // decimation
    return np.asarray(filtered[first : last + 1])


def n_decimated(n_samples: int, decimation: int) -> int:
    """How many outputs n samples give: (n − 1) // q − ⌈(n_taps − 1) / q⌉ + 1; 0 for too few."""
    first = -(-(len(anti_alias_taps(decimation)) - 1) // decimation)
    return max(0, (n_samples - 1) // decimation - first + 1)


def without_offset(samples: FloatArray) -> FloatArray:
    """The samples less each channel's mean. samples: (n, n_channels)."""
    return samples - samples.mean(axis=0)


def without_drift(samples: FloatArray) -> FloatArray:
    """The samples less each channel's least-squares straight line. samples: (n, n_channels)."""
    return np.asarray(signal.detrend(samples, axis=0, type="linear"))
