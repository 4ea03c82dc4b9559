"""Damped oscillators under forces that run straight from sample to sample.

There is no integration error: the matrix exponential is written as a recursion.
"""

import numpy as np
from scipy.linalg import expm

from sensors.arrays import ComplexArray, FloatArray


class ModalOscillators:
    """The modes' equations of motion as one exact recursion, mode by mode.

    With x = (q, q')ᵀ and a force linear between its samples,

        x_{k+1} = Φ x_k + Γ0 p_k + Γ1 p_{k+1}

    Each mode then is a filter with two poles, w_k = p_k + tr(Φ) w_{k-1} − det(Φ) w_{k-2}, and q,
    q', q'' are three-tap sums of w: `displacement_taps`, `velocity_taps`, `acceleration_taps`,
    each (n_modes, 3), so that q_k = Σ_i taps_i w_{k-i}.
    """

    def __init__(
        self, frequencies: FloatArray, damping_ratios: FloatArray, sampling_rate: float
    ) -> None:
        self._dt = 1.0 / sampling_rate
        omega = 2.0 * np.pi * frequencies
        propagator, gamma_0, gamma_1 = first_order_hold(omega, damping_ratios, self._dt)
        trace = np.trace(propagator, axis1=1, axis2=2)
        determinant = np.linalg.det(propagator)
        self._denominator = np.stack([np.ones_like(trace), -trace, determinant], axis=1)
        state_taps = _state_taps(propagator, trace, gamma_0, gamma_1)
        self.displacement_taps = state_taps[:, 0]
        self.velocity_taps = state_taps[:, 1]
        self.acceleration_taps = (  # q'' = p − 2 ζ ω q' − ω² q
            self._denominator
            - (2.0 * damping_ratios * omega)[:, None] * self.velocity_taps
            - (omega**2)[:, None] * self.displacement_taps
        )
        self._memory = np.zeros((len(omega), 2))  # lfilter's state
        self._tail = np.zeros((len(omega), 2))  # w at the two last samples

    def advance(self, modal_forces: FloatArray) -> FloatArray:
        """Filtered forces w of the next samples, preceded by the two before them.

        Parameters
        ----------
        modal_forces : ndarray, shape (n_modes, n_samples)
            p [N/kg^½].

        Returns
        -------
        ndarray, shape (n_modes, 2 + n_samples)
            w.
        """
        from scipy.signal import lfilter  # 75 MB that only a simulation needs

        filtered = np.empty((len(modal_forces), modal_forces.shape[1] + 2))
        filtered[:, :2] = self._tail
        one = np.ones(1)
        for mode, force in enumerate(modal_forces):
            filtered[mode, 2:], self._memory[mode] = lfilter(
                one, self._denominator[mode], force, zi=self._memory[mode]
            )
        self._tail = filtered[:, -2:].copy()
        return filtered

    def frequency_response(self, taps: FloatArray, frequencies: FloatArray) -> ComplexArray:
        """Response per unit harmonic force sampled as above: Σ taps_i z⁻ⁱ / Σ den_i z⁻ⁱ.

        Parameters
        ----------
        taps : ndarray, shape (..., n_modes, 3)
        frequencies : ndarray, shape (n_frequencies,)
            Frequencies [Hz].

        Returns
        -------
        ndarray, shape (n_frequencies, ..., n_modes)
        """
        powers = np.exp(
            -2j * np.pi * self._dt * np.multiply.outer(frequencies, np.arange(3))
        )  # z⁻ⁱ, (n_frequencies, 3)
        numerator = np.tensordot(powers, taps, axes=([1], [taps.ndim - 1]))
        denominator = powers @ self._denominator.T
        between = tuple(range(1, numerator.ndim - 1))
        return numerator / np.expand_dims(denominator, between)


def first_order_hold(
    omega: FloatArray, damping_ratios: FloatArray, time_step: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Exact propagators of damped oscillators under a force linear between samples.

    Parameters
    ----------
    omega : ndarray, shape (n_modes,)
        Undamped circular frequencies [rad/s].
    damping_ratios : ndarray, shape (n_modes,)
        ζ [-].
    time_step : float
        T [s].

    Returns
    -------
    tuple[ndarray, ndarray, ndarray], shape (n_modes, 2, 2)
        Φ, Γ0 (n_modes, 2), Γ1 (n_modes, 2) for x = (q, q')ᵀ.

    Notes
    -----
    All three are blocks of one matrix exponential, exp([[A T, b T, 0], [0, 0, 1], [0, 0, 0]]):
    Source: Franklin, Powell and Workman, Digital Control of Dynamic Systems (triangle hold). Time
    is counted in steps inside, so that q and q' T are of the same size.
    """
    step = omega * time_step
    augmented = np.zeros((len(omega), 4, 4))
    augmented[:, 0, 1] = 1.0
    augmented[:, 1, 0] = -(step**2)
    augmented[:, 1, 1] = -2.0 * damping_ratios * step
    augmented[:, 1, 2] = time_step**2
    augmented[:, 2, 3] = 1.0
    exponential = expm(augmented)
    to_seconds = np.array([1.0, 1.0 / time_step])
    propagator = exponential[:, :2, :2] * np.outer(to_seconds, 1.0 / to_seconds)
    gamma_1 = exponential[:, :2, 3] * to_seconds
    gamma_0 = exponential[:, :2, 2] * to_seconds - gamma_1
    return propagator, gamma_0, gamma_1


def _state_taps(
    propagator: FloatArray, trace: FloatArray, gamma_0: FloatArray, gamma_1: FloatArray
) -> FloatArray:
    """Numerators of q and q' over the modes' common denominator, (n_modes, 2, 3).

    (zI − Φ)⁻¹ (Γ1 z + Γ0) with adj(zI − Φ) = zI − R, R = tr(Φ) I − Φ.
    """
    remainder = trace[:, None, None] * np.eye(2) - propagator
    return np.stack(
        [
            gamma_1,
            gamma_0 - np.einsum("mij,mj->mi", remainder, gamma_1),
            -np.einsum("mij,mj->mi", remainder, gamma_0),
        ],
        axis=2,
    )
