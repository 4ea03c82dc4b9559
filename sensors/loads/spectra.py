"""Spectra of wind and sea, and what a linear wave of one frequency does in the water.

One-sided, per Hz.
"""

import numpy as np
from scipy.optimize import brentq

from sensors.arrays import FloatArray

SEA_WATER_GRAVITY = 9.81  # [m/s²], in the dispersion relation


def wave_number(frequency: float, depth: float) -> float:
    """k [rad/m] of a linear wave: (2πf)² = g k tanh(k d). frequency [Hz], depth d [m]."""
    deep = (2.0 * np.pi * frequency) ** 2 / SEA_WATER_GRAVITY
    shallow = 2.0 * np.pi * frequency / np.sqrt(SEA_WATER_GRAVITY * depth)

    def mismatch(k: float) -> float:
        return k * np.tanh(k * depth) - deep

    return float(brentq(mismatch, 0.0, 2.0 * max(deep, shallow), xtol=1e-14))


def wave_numbers(frequencies: FloatArray, depth: float) -> FloatArray:
    """`wave_number` of many frequencies at once, (n_frequencies,) [rad/m].

    Parameters
    ----------
    frequencies : ndarray, shape (n_frequencies,)
        All > 0 [Hz].
    depth : float
        d [m].

    Notes
    -----
    Newton's iteration on k d tanh(k d) = (2πf)² d / g from Guo's explicit start.

    References
    ----------
    Guo, Coastal Engineering 45 (2002) 71, for the start.
    """
    target = (2.0 * np.pi * np.asarray(frequencies)) ** 2 * depth / SEA_WATER_GRAVITY
    x = target * (1.0 - np.exp(-(target**1.25))) ** -0.4
    for _ in range(20):
        tanh = np.tanh(x)
        step = (x * tanh - target) / (tanh + x * (1.0 - tanh**2))
        x = x - step
        if np.all(np.abs(step) <= 1e-14 * x):
            break
    return x / depth


def horizontal_motion(frequencies: FloatArray, heights: FloatArray, *, depth: float) -> FloatArray:
    """Horizontal velocity under a linear wave per unit of its elevation.

    Parameters
    ----------
    frequencies : ndarray, shape (n_frequencies,)
        Frequencies [Hz].
    heights : ndarray, shape (n_heights,)
        Heights above the sea bed over the depth, in [0, 1] [-].
    depth : float
        d [m].

    Returns
    -------
    ndarray, shape (n_heights, n_frequencies)
        [1/s], in phase with the surface.

    Notes
    -----
        u / η = ω cosh(k (z + d)) / sinh(k d);   the acceleration is iω times that
    """
    kd = wave_numbers(frequencies, depth) * depth
    up = heights[:, None] * kd
    # cosh/sinh as falling exponentials: neither overflows
    profile = np.exp(up - kd) * (1.0 + np.exp(-2.0 * up)) / (1.0 - np.exp(-2.0 * kd))
    return 2.0 * np.pi * np.asarray(frequencies) * profile


def kaimal(
    frequencies: FloatArray, *, wind_speed: float, deviation: float, length: float
) -> FloatArray:
    """Kaimal spectrum of a wind component, (n_frequencies,) [(m/s)²/Hz].

    Parameters
    ----------
    deviation : float
        σ of the component [m/s].
    length : float
        Its integral scale L [m].

    Returns
    -------
    ndarray, shape (n_frequencies,)
        In [(m/s)²/Hz].

    Notes
    -----
        S(f) = 4 σ² L/V / (1 + 6 f L/V)^(5/3)

    References
    ----------
    IEC 61400-1 ed. 3, annex B.14.
    """
    time = length / wind_speed
    return 4.0 * deviation**2 * time / (1.0 + 6.0 * np.asarray(frequencies) * time) ** (5.0 / 3.0)


def iec_coherence(
    frequencies: FloatArray, distances: FloatArray, *, wind_speed: float, length: float
) -> FloatArray:
    """Coherence of the along-wind component between two points, √(γ²).

    Parameters
    ----------
    distances : ndarray
        Distances across the wind [m], of any shape.
    length : float
        Coherence scale L_c [m].

    Returns
    -------
    ndarray, shape (n_frequencies, *distances.shape)
        Dimensionless [-].

    Notes
    -----
        Coh(r, f) = exp(−12 √((f r/V)² + (0.12 r/L_c)²))

    References
    ----------
    IEC 61400-1 ed. 3, annex B.16.
    """
    f = np.asarray(frequencies).reshape(-1, *(1 for _ in np.shape(distances)))
    return np.exp(-12.0 * distances * np.hypot(f / wind_speed, 0.12 / length))
