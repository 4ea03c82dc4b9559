"""From raw samples to a band's samples: missing ones filled, offset or drift taken off, filtered,
decimated.

The few operations are written out: to load `scipy.signal` takes as long as to identify a window.
"""

from functools import lru_cache

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import fft
from scipy.linalg import solve_toeplitz

from sensors.arrays import ComplexArray, FloatArray

MOST_MISSING = 0.05  # share of a channel's samples that may be missing
PREDICTED_FROM = 3.0  # length of the prediction filter [s],
MOST_TAPS = 160  # and in samples
LARGEST_SYSTEM = 2000  # samples that are solved for together
STOP_BAND_ATTENUATION = 70.0  # [dB]: aliases stay below the noise of a good accelerometer
DECIMATION_PASS_BAND = 0.44  # of the decimated rate: flat to here,
DECIMATION_STOP_BAND = (
    0.56  # and shut from here, so that aliases fold back above the pass band only
)
HIGH_STOP_BAND = 0.06  # of a high-passed band's rate: shut to here,
HIGH_PASS_BAND = 0.10  # and flat from here
HIGH_STOP_BAND_ATTENUATION = 60.0  # [dB]: a sea's response is no stronger than modes beside it


def on_even_grid(
    samples: NDArray[np.floating], times: FloatArray, sampling_rate: float
) -> tuple[FloatArray, FloatArray] | None:
    """Samples and times with NaN rows where a step of several samples shows that some are missing.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    times : ndarray, shape (n,)
        Rising [s].
    sampling_rate : float
        [Hz].

    Returns
    -------
    tuple of ndarray, shapes (n + n_missing, n_channels) and (n + n_missing,), or None
        None where nothing is missing, more than may be, or the steps are not whole.
    """
    steps = np.diff(times) * sampling_rate
    if not len(steps) or not np.isfinite(steps).all() or (steps < 0.5).any():
        return None
    whole = np.round(steps).astype(np.int64)
    n_missing = int((whole - 1).sum())
    n = len(samples) + n_missing
    if not 0 < n_missing <= MOST_MISSING * n or (np.abs(steps - whole) > 0.1).any():
        return None
    places = np.concatenate([[0], np.cumsum(whole)])
    filled = np.full((n, samples.shape[1]), np.nan)
    filled[places] = samples
    return filled, np.interp(np.arange(n), places, times)


def filled(samples: NDArray[np.floating], sampling_rate: float) -> FloatArray:
    """Samples with every missing one predicted from its own channel.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        NaN where missing; each channel in its own unit.
    sampling_rate : float
        [Hz].
    """
    result = np.array(samples, dtype=np.float64)
    n_taps = int(min(MOST_TAPS, max(4, PREDICTED_FROM * sampling_rate), len(result) // 10))
    for channel in result.T:
        missing = ~np.isfinite(channel)
        if missing.any():
            channel[missing] = _predicted(channel, missing, n_taps)
    return result


def _predicted(channel: FloatArray, missing: NDArray[np.bool_], n_taps: int) -> FloatArray:
    """The missing samples that leave least to an autoregressive model of the others.

    With a of order p fitted to the channel, minimise Σ_t (Σ_j a_j x_{t−j})² over the missing x: the
    normal equations have b_{i−j} = Σ_l a_l a_{l+|i−j|}; gaps farther apart than p solve alone.
    Source: Janssen, Veldhuis, Vries (1986), Adaptive interpolation of discrete-time signals that
    can be modeled as autoregressive processes, IEEE Trans. Acoust. Speech Signal Process. 34.
    """
    mean = channel[~missing].mean()
    x = np.where(missing, 0.0, channel - mean)
    n = len(x)
    spectrum = np.abs(np.fft.rfft(x, 2 * n)) ** 2
    r = np.fft.irfft(spectrum)[: n_taps + 1] / n
    if not r[0] > 0:
        return np.full(int(missing.sum()), mean)
    r[0] *= 1 + 1e-6
    a = np.concatenate([[1.0], -solve_toeplitz(r[:-1], r[1:])])
    b = np.correlate(a, a, mode="full")  # lags −p to p
    padded = np.pad(x, n_taps)
    places = np.flatnonzero(missing)
    around = np.convolve(padded, b, mode="valid")[places]  # Σ b_{i−k} x_k over the known
    fill = np.empty(len(places))
    cuts = np.flatnonzero(np.diff(places) > n_taps) + 1
    for part in np.split(np.arange(len(places)), cuts):
        for piece in np.array_split(part, max(1, -(-len(part) // LARGEST_SYSTEM))):
            lags = np.abs(places[piece][:, None] - places[piece][None, :])
            system = np.where(lags <= n_taps, b[n_taps + np.minimum(lags, n_taps)], 0.0)
            fill[piece] = -np.linalg.solve(system, around[piece])
    return fill + mean


@lru_cache(maxsize=32)
def anti_alias_taps(decimation: int) -> FloatArray:
    """Linear-phase low-pass filter for decimation by q, symmetric, gain 1 at 0 Hz.

    Why a finite, symmetric one: every channel is delayed by the same constant, so shapes keep
    their phase; and a finite impulse response adds no poles, so neither frequency nor damping is
    moved (only the first lags see the filter at all).
    """
    if decimation == 1:
        return np.ones(1)
    return _low_pass(
        DECIMATION_PASS_BAND / decimation, DECIMATION_STOP_BAND / decimation, STOP_BAND_ATTENUATION
    )


@lru_cache(maxsize=1)
def high_pass_taps() -> FloatArray:
    """Linear-phase high-pass filter at a band's own rate, symmetric as that, gain 0 at 0 Hz."""
    taps = -_low_pass(HIGH_STOP_BAND, HIGH_PASS_BAND, HIGH_STOP_BAND_ATTENUATION)
    taps[len(taps) // 2] += 1.0
    return taps


def _low_pass(flat_to: float, shut_from: float, attenuation: float) -> FloatArray:
    """Of an odd number of taps: the delay is a whole number of samples. Frequencies × Δt."""
    width = 2 * (shut_from - flat_to)  # of the transition, over the Nyquist frequency
    n_taps = int(np.ceil((attenuation - 7.95) / (2.285 * np.pi * width) + 1)) | 1
    cutoff = flat_to + shut_from  # middle of the transition, likewise
    k = np.arange(n_taps) - (n_taps - 1) / 2
    taps = cutoff * np.sinc(cutoff * k) * np.kaiser(n_taps, _kaiser_beta(attenuation))
    return np.asarray(taps / taps.sum())


def _kaiser_beta(attenuation: float) -> float:
    """β of Kaiser's window for an attenuation of more than 50 dB.

    Source: Kaiser (1974), Nonrecursive digital filter design using the I0-sinh window function,
    Proc. IEEE Int. Symp. Circuits and Systems; Oppenheim and Schafer, Discrete-Time Signal
    Processing, §7.5.
    """
    return 0.1102 * (attenuation - 8.7)


def decimated(samples: FloatArray, decimation: int) -> FloatArray:
    """Every q-th sample after the anti-alias filter, where that is wholly filled.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    decimation : int
        q [-].

    Returns
    -------
    ndarray, shape (n_decimated(n, q), n_channels)
        Empty for a short record.
    """
    if n_decimated(len(samples), decimation) <= 0:
        return samples[:0]
    if decimation > 1:
        taps = anti_alias_taps(decimation)
        first = -(-(len(taps) - 1) // decimation)
        begin = first * decimation - (len(taps) - 1)
        windows = sliding_window_view(samples[begin:], len(taps), axis=0)[::decimation]
        samples = windows @ taps  # which are symmetric
    return np.asarray(samples)


def above(samples: FloatArray) -> FloatArray:
    """A band's samples, (n, n_channels), after its high pass, where that is wholly filled."""
    taps = high_pass_taps()[:, None]
    n, n_taps = len(samples), len(taps)
    if n < n_taps:
        return samples[:0]
    length = fft.next_fast_len(n, real=True)
    product = fft.rfft(samples, length, axis=0) * fft.rfft(taps, length, axis=0)
    # the first n_taps - 1 wrap round; the others are those that the taps lie wholly in
    return np.asarray(fft.irfft(product, length, axis=0)[n_taps - 1 : n])


def n_decimated(n_samples: int, decimation: int) -> int:
    """How many outputs n samples give: (n − 1) // q − ⌈(n_taps − 1) / q⌉ + 1; 0 for too few."""
    first = -(-(len(anti_alias_taps(decimation)) - 1) // decimation)
    return max(0, (n_samples - 1) // decimation - first + 1)


def lines_of_channels(
    samples: FloatArray, scales: FloatArray, taper: FloatArray | None = None
) -> ComplexArray:
    """Fourier lines of each channel over its scale, (n // 2 + 1, n_channels).

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    scales : ndarray, shape (n_channels,)
        By which each channel is divided, in its unit.
    taper : ndarray, shape (n,), optional
        None: none [-].

    Notes
    -----
    One channel is transformed after the other: all at once would hold three copies of the samples.
    """
    lines = np.empty((len(samples) // 2 + 1, len(scales)), dtype=np.complex128)
    for place, scale in enumerate(scales):
        channel = samples[:, place] / scale
        lines[:, place] = fft.rfft(channel if taper is None else taper * channel)
    return lines


def without_offset(samples: FloatArray) -> FloatArray:
    """The samples less each channel's mean. samples: (n, n_channels)."""
    return samples - samples.mean(axis=0)


def without_drift(samples: FloatArray) -> FloatArray:
    """The samples less each channel's least-squares straight line. samples: (n, n_channels)."""
    time = np.arange(len(samples)) - (len(samples) - 1) / 2
    slope = time @ samples / max(float(time @ time), 1.0)
    return np.asarray(samples - samples.mean(axis=0) - time[:, None] * slope)
