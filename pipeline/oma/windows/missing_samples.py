"""Few samples that are missing cost no window: what the record itself predicts there fills them.

Why not leave their lag products out: every band is filtered, and a lost second would cost each of
its filters' lengths, tens of seconds in the slow bands. A slow mode is known across a second by
what surrounds it; of a fast one the fill predicts little, so that this second adds little, too.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_toeplitz

from sensors.arrays import FloatArray

MOST_MISSING = 0.05  # share of a channel's samples that may be missing
PREDICTED_FROM = 3.0  # length of the prediction filter [s],
MOST_TAPS = 160  # and in samples
LARGEST_SYSTEM = 2000  # samples that are solved for together


def on_even_grid(
    samples: NDArray[np.floating], times: FloatArray, sampling_rate: float
) -> tuple[FloatArray, FloatArray] | None:
    """Samples and times with NaN rows where a step of several samples shows that some are missing.

    times     (n,) rising [s]
    returns   None where nothing is missing, more than may be, or the steps are not whole
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

    samples   (n, n_channels), NaN where missing
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
