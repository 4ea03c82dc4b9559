"""Do time stamps fit the stated rate, and are they even? What is uneven is put on an even clock."""

import numpy as np

from pipeline.oma.data_quality.input_checks import Finding
from sensors.acquisition.blocks import RATE_TOLERANCE
from sensors.arrays import FloatArray

UNEVEN_STEP = 0.01  # a step this far from the mean one, relative to it, is uneven
GAP_STEPS = 3.0  # a step longer than this many nominal ones is a gap; shorter are interpolated


def check_timestamps(times: FloatArray, sampling_rate: float) -> tuple[Finding, ...]:
    """Gaps, an uneven time base, or a rate that the stamps contradict. times: (n,) [s]."""
    steps = np.diff(times) * sampling_rate  # in nominal steps
    if not np.isfinite(steps).all() or (steps <= 0).any():
        at = int(np.argmax(~(steps > 0)))
        text = (
            f"the time stamps do not increase: sample {at + 2} is at {times[at + 1]:.6g} s, sample "
            f"{at + 1} before it at {times[at]:.6g} s; each stamp must be later than the one before"
        )
        return (Finding("uneven-clock", text, "reject"),)
    typical = float(np.median(steps))
    if (steps > GAP_STEPS * typical).any():
        at = int(np.argmax(steps > GAP_STEPS * typical))
        text = (
            f"gap of {steps[at] / sampling_rate:.3g} s at {times[at] - times[0]:.3f} s "
            f"({int((steps > GAP_STEPS * typical).sum())} in all)"
        )
        return (Finding("gap", text, "reject"),)
    return _check_rate(steps, sampling_rate) + _check_evenness(steps, sampling_rate)


def _check_rate(steps: FloatArray, sampling_rate: float) -> tuple[Finding, ...]:
    actual = sampling_rate / float(np.mean(steps))
    if abs(actual / sampling_rate - 1) <= RATE_TOLERANCE:
        return ()
    text = (
        f"the time stamps run at {actual:.6g} Hz, not at the {sampling_rate:.6g} Hz stated; "
        "the stamps are followed"
    )
    return (Finding("sampling-rate", text, "mend"),)


def _check_evenness(steps: FloatArray, sampling_rate: float) -> tuple[Finding, ...]:
    mean = float(np.mean(steps))
    largest = float(np.abs(steps / mean - 1).max())
    if largest <= UNEVEN_STEP:
        return ()
    text = (
        f"the time stamps' steps differ by up to {100 * largest:.2g} % from their mean of "
        f"{mean / sampling_rate:.6g} s: resampled to an even clock"
    )
    return (Finding("uneven-clock", text, "mend"),)


def evenly_sampled(samples: FloatArray, times: FloatArray) -> FloatArray:
    """The record on an even clock with as many samples from the first stamp to the last.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    times : ndarray, shape (n,)
        Rising [s].

    Notes
    -----
    By cubic splines, whose error stays below the noise up to a quarter of the sampling rate.
    """
    from scipy.interpolate import CubicSpline  # half a second to load, and seldom needed

    even = np.linspace(times[0], times[-1], len(times))
    return np.asarray(CubicSpline(times, samples, axis=0)(even))
