"""A turning rotor's harmonics, taken off a window along the rotor's own angle.

With ψ(t) = 2π ∫ Ω dt of the measured speed, what passes the tower n times a turn is

    y(t) = Re Σ_n c_n(t) e^{i n ψ(t)}

whose amplitudes c_n change slowly however the speed wanders. Each is a sum of cubic splines over
the window, found by least squares for every channel. A mode beside a harmonic keeps what it moves
by at other frequencies than the harmonic's: of its response, the splines take a share of about
their number over the lines 1/T of its resonance.
Source: order tracking by least squares (Vold and Leuridan 1993, SAE 931288), with splines for the
amplitudes in place of their differences.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, linalg

from sensors.arrays import FloatArray

ORDERS = (1, 3, 6)  # of a rotor of three blades: imbalance, blade passing and twice that
KNOTS = 8  # of each amplitude over a window: of 5, 8 and 12 (seeds 70001 to 70030) the modes found
# were .85, .85 and .82
STANDING = 0.5  # speed below which no harmonic is looked for [rpm]
NEAR_LINES = 2.0  # of a harmonic's mean frequency within which no mode is reported, in lines 1/T
NEAR_SPREADS = 1.0  # and in standard deviations of its frequency


def rotor_frequency(rotor_speed: FloatArray) -> FloatArray:
    """Turns a second, (n,) [Hz]. rotor_speed: (n,) [rpm]."""
    return np.asarray(rotor_speed, dtype=np.float64) / 60.0


@dataclass(frozen=True, slots=True, eq=False)
class WithoutHarmonics:
    """A window less what follows the rotor's angle."""

    samples: FloatArray
    """(n, n_channels)"""
    left: FloatArray
    """What the removal has left of the power of each line k/T, (n // 2 + 1,), 0 to 1 [-]."""


def without_harmonics(
    samples: FloatArray, sampling_rate: float, rotor_speed: FloatArray
) -> WithoutHarmonics:
    """The samples less what follows the rotor's angle, and what that leaves of each line.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
    sampling_rate : float
        [Hz]
    rotor_speed : ndarray, shape (n,)
        At each sample [rpm].
    """
    angle = np.cumsum(rotor_frequency(rotor_speed)) / sampling_rate
    splines = _splines(len(samples))
    columns = [
        splines * part(2 * np.pi * order * angle)[:, None]
        for order in ORDERS
        for part in (np.cos, np.sin)
    ]
    (basis,) = linalg.qr(np.hstack(columns), mode="economic", overwrite_a=True, check_finite=False)[
        :1
    ]
    taken = np.zeros(len(samples) // 2 + 1)
    for column in basis.T:
        taken += np.abs(fft.rfft(column)) ** 2
    return WithoutHarmonics(
        samples - basis @ (basis.T @ samples), np.clip(1 - taken / len(samples), 0.0, 1.0)
    )


def turns(rotor_speed: FloatArray) -> bool:
    """Whether a rotor turns whose speed is known throughout. rotor_speed: (n,) [rpm]."""
    return bool(np.isfinite(rotor_speed).all() and np.mean(rotor_speed) > STANDING)


def follows_rotor(frequency: float, duration: float, rotor_speed: FloatArray) -> bool:
    """Whether a frequency [Hz] is a harmonic's, over a window of that duration [s]."""
    turning = rotor_frequency(rotor_speed)
    mean, spread = float(turning.mean()), float(turning.std())
    return any(
        abs(frequency - order * mean) < max(NEAR_LINES / duration, NEAR_SPREADS * order * spread)
        for order in ORDERS
    )


def _splines(n: int) -> FloatArray:
    """Cubic B-splines of even knots over n samples, (n, KNOTS)."""
    place = np.linspace(0.0, KNOTS - 3.0, n)[:, None] - np.arange(KNOTS) + 3.0
    x = np.abs(place - 2.0)
    inner = 2 / 3 - x**2 + x**3 / 2
    return np.asarray(np.where(x < 1, inner, np.where(x < 2, (2 - x) ** 3 / 6, 0.0)))
