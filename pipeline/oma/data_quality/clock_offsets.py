"""How far two units' clocks are apart, by the phase between their channels in the modes.

In a mode of a lightly damped structure all channels move in phase or in antiphase. A unit whose
stamps are late by τ turns its channels against another's by

    θ_j = 2π f_j τ (mod π)

in mode j; the higher modes show it best. The complex shapes come from the lag covariances, fitted
with all identified poles at once, so that neighbouring modes do not turn each other:

    R_k = Σ_j A_j λ_j^k + conj,   λ_j = exp(−2π f_j (ζ_j ∓ i √(1 − ζ_j²)) Δt),   A_j = φ_j g_jᵀ

with φ_j the first left singular vector of A_j. Source of the model: Peeters and De Roeck (2001),
"Stochastic system identification for operational modal analysis: a review", Eq. 12.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from pipeline.messages import Mode
from sensors.arrays import ComplexArray, FloatArray

NOTABLE = 0.5e-3  # offset that is worth a warning [s]
UNUSABLE = 5e-3  # offset beyond which shapes over both units are wrong [s]
CERTAIN = 3.0  # standard deviations that an offset must have to be one
LARGEST_OFFSET = 50e-3  # offset looked for [s]
LAGS = 400  # that the shapes are fitted to
FEWEST_PHASES = 4
CLEAR = 0.2  # least share of a mode's motion that each unit must see [-]
OUTLYING_PHASE = 3.0  # standard deviations beyond which a mode's phase counts no more
LEAST_SCATTER = 0.01  # of the phases, std: true shapes are a little complex themselves [rad]


@dataclass(frozen=True, slots=True)
class UnitOffset:
    """One unit's clock against another's."""

    seconds: float
    """τ, positive: its stamps are late [s]."""
    std: float
    """Standard deviation of the offset [s]."""

    def exceeds(self, limit: float) -> bool:
        """Whether it is beyond a limit [s], and is no chance."""
        return abs(self.seconds) > max(limit, CERTAIN * self.std)


def unit_offset(
    samples: FloatArray,
    sampling_rate: float,
    modes: Sequence[Mode],
    reference: Sequence[int],
    other: Sequence[int],
) -> UnitOffset | None:
    """How late the stamps of one unit's channels are against another's.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        One window, the units joined on their stamps.
    sampling_rate : float
        [Hz].
    modes : sequence of Mode
        Identified in the window, shapes over the same channels.
    reference, other : sequence of int
        Columns of the two units' channels.

    Returns
    -------
    UnitOffset or None
        None where fewer than four modes are seen by both units.
    """
    if len(modes) < FEWEST_PHASES:
        return None
    shapes = complex_shapes(samples, sampling_rate, modes)
    first = _motion(shapes, modes, reference)
    second = _motion(shapes, modes, other)
    whole = np.linalg.norm(shapes, axis=1)
    clear = np.minimum(abs(first), abs(second)) >= CLEAR**2 * whole
    if clear.sum() < FEWEST_PHASES:
        return None
    omega = 2 * np.pi * np.array([mode.frequency for mode in modes])[clear]
    return _fitted(omega, -np.angle(second[clear] / first[clear]))


def complex_shapes(
    samples: FloatArray, sampling_rate: float, modes: Sequence[Mode]
) -> ComplexArray:
    """(n_modes, n_channels), scale and phase arbitrary, of modes whose poles are known."""
    scaled = (samples - samples.mean(axis=0)) / samples.std(axis=0)
    n_lags = min(LAGS, len(samples) // 8)
    covariances = _lag_covariances(scaled, n_lags)
    f = np.array([mode.frequency for mode in modes])
    zeta = np.array([mode.damping_ratio for mode in modes])
    poles = 2 * np.pi * f * (-zeta + 1j * np.sqrt(1 - zeta**2)) / sampling_rate
    decay = np.exp(np.outer(np.arange(1, n_lags + 1), np.concatenate([poles, poles.conj()])))
    residues = np.linalg.lstsq(decay, covariances[1:].reshape(n_lags, -1), rcond=None)[0]
    n_channels = samples.shape[1]
    matrices = residues[: len(modes)].reshape(len(modes), n_channels, n_channels)
    return np.asarray(np.linalg.svd(matrices)[0][:, :, 0] * samples.std(axis=0))


def _lag_covariances(samples: FloatArray, n_lags: int) -> FloatArray:
    """R_k = Σ_n y_(n+k) y_nᵀ / N, (n_lags + 1, n_channels, n_channels)."""
    length = fft.next_fast_len(len(samples) + n_lags, real=True)
    spectra = fft.rfft(samples, length, axis=0)
    products = spectra[:, :, None] * spectra.conj()[:, None, :]
    return np.asarray(fft.irfft(products, length, axis=0)[: n_lags + 1] / len(samples))


def _motion(shapes: ComplexArray, modes: Sequence[Mode], own: Sequence[int]) -> ComplexArray:
    """(n_modes,) of one unit, its channels weighted with the mode's real shape."""
    real = np.array([mode.shape for mode in modes])[:, list(own)]
    real = real / np.linalg.norm(np.array([mode.shape for mode in modes]), axis=1)[:, None]
    return np.asarray((shapes[:, list(own)] * real).sum(axis=1))


def _fitted(omega: FloatArray, phases: FloatArray) -> UnitOffset | None:
    """The offset that fits the phases, each known but for half turns, outlying ones left out."""
    step = 0.2 / float(omega.max())
    grid = np.arange(-LARGEST_OFFSET, LARGEST_OFFSET + step, step)
    coarse = float(grid[np.argmax(np.cos(2 * (phases - np.outer(grid, omega))).sum(axis=1))])
    residual = np.angle(np.exp(2j * (phases - omega * coarse))) / 2
    scatter = max(1.4826 * float(np.median(abs(residual))), LEAST_SCATTER)
    used = abs(residual) <= OUTLYING_PHASE * scatter
    if used.sum() < FEWEST_PHASES:
        return None
    information = float(np.sum(omega[used] ** 2)) / scatter**2
    correction = float(omega[used] @ residual[used]) / scatter**2 / information
    return UnitOffset(coarse + correction, information**-0.5)
