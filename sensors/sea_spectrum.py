"""The spectrum of a sea's surface: for loads, and to recognise the hump it makes in sensors."""

import numpy as np

from sensors.arrays import FloatArray


def jonswap(
    frequencies: FloatArray, *, peak_frequency: float, peak_enhancement: float
) -> FloatArray:
    """JONSWAP spectrum up to a constant factor.

    Parameters
    ----------
    frequencies : ndarray, shape (n_frequencies,)
        f, in the unit of the peak's.
    peak_frequency : float
        fp, e.g. [Hz].
    peak_enhancement : float
        γ [-]

    Returns
    -------
    ndarray, shape (n_frequencies,)
        Any scale; 0 at frequency 0.

    Notes
    -----
        S(f) ∝ f⁻⁵ exp(−5/4 (f/fp)⁻⁴) γ^exp(−(f/fp − 1)² / 2s²),  s = .07 up to fp, .09 above

    References
    ----------
    Hasselmann et al., Deutsche Hydrographische Zeitschrift A8 No. 12 (1973).
    """
    relative = np.maximum(np.asarray(frequencies) / peak_frequency, 1e-3)  # S(0) = 0
    width = np.where(relative <= 1.0, 0.07, 0.09)
    peak = peak_enhancement ** np.exp(-((relative - 1.0) ** 2) / (2.0 * width**2))
    return relative**-5.0 * np.exp(-1.25 * relative**-4.0) * peak
