"""Stamps of few digits → the clock that they were rounded from.

    0.00, 0.02, 0.04, 0.06, 0.08, 0.10, 0.13 …     of samples at 48.83 Hz, 20.48 ms apart

Such stamps lie up to half their last digit off, again and again alike. Samples that were moved by
that would be modulated in phase, and have lines beside their modes that no structure has.
"""

import numpy as np
from scipy.ndimage import uniform_filter1d

from sensors.arrays import FloatArray, IntArray

FINEST_DIGIT = 9  # of seconds that is looked for: nanoseconds
WHOLE_DIGIT = 1e-3  # from a whole number of digits: rounding of doubles [digits]
FINE = 0.01  # a digit of so little needs nothing: such steps count as even [steps]
LONGEST_OFF = 0.75  # from the smooth clock; half a digit and what smoothing leaves [digits]
SMOOTHED = 1001  # samples over which a clock's drift is followed


def without_rounding(times: FloatArray, rate: float) -> FloatArray:
    """Return stamps on the smooth clock that they are rounded from; others as they are.

    Parameters
    ----------
    times : ndarray, shape (n,)
        Stamps since the first [s].
    rate : float
        Sampling rate that they have [Hz].

    Notes
    -----
    They are others where one of them lies further off an even or slowly drifting clock than
    rounding moves it. Rows may be missing.
    """
    if len(times) < SMOOTHED or not (np.isfinite(times).all() and (np.diff(times) > 0).all()):
        return times
    digit = _last_digit(times)
    if digit <= FINE / rate or digit >= 1 / rate:
        return times
    if np.abs(np.diff(times) * rate - 1).max() <= FINE:
        return times
    for numbers in _numbers_of_samples(times, rate):
        smooth = _smooth_clock(times, numbers)
        if np.abs(times - smooth).max() <= LONGEST_OFF * digit:
            return smooth - smooth[0]
    return times


def _last_digit(times: FloatArray) -> float:
    """Return the power of ten of which all stamps are multiples [s]."""
    for place in range(FINEST_DIGIT):
        counts = times * 10.0**place
        if np.abs(counts - np.round(counts)).max() < WHOLE_DIGIT:
            return float(10.0**-place)
    return 0.0


def _numbers_of_samples(times: FloatArray, rate: float) -> tuple[IntArray, IntArray]:
    """Return what the stamps may number: samples without one missing, or with some."""
    passed = np.maximum(1, np.round(np.diff(times) * rate)).astype(np.int64)
    return np.arange(len(times)), np.concatenate([[0], np.cumsum(passed)])


def _smooth_clock(times: FloatArray, numbers: IntArray) -> FloatArray:
    """Return times that go through the stamps as smoothly as a clock drifts, (n,) [s]."""
    even = np.polynomial.Polynomial.fit(numbers, times, 1)(numbers)
    return np.asarray(even + uniform_filter1d(times - even, SMOOTHED, mode="nearest"))
