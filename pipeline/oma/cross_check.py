"""A second estimate of every mode that shares nothing with the first but the samples.

Enhanced frequency domain decomposition: around a mode's peak the strongest direction of the
smoothed spectral matrices is followed as far as it keeps its shape; the power along it, brought
back to time, is the free decay of one oscillator,

    r(τ) ∝ e^{−2π ζ f τ} e^{2π i f τ}

whose logarithm's slope is the damping and whose phase's slope the frequency. The taper's own
autocorrelation is divided out. It needs no model order, and it sees only peaks: of modes that hide
each other, and of a mode that decays as slowly as the window lasts, it says nothing.
Source: Brincker, Ventura and Andersen (2001), Damping estimation by frequency domain decomposition,
IMAC XIX; Gade et al. (2005), Frequency domain techniques for operational modal analysis, IOMAC.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import fft

from pipeline.messages import Mode, QualityWarning
from sensors.arrays import BoolArray, ComplexArray, FloatArray

BELL_WIDTHS = 8.0  # half bandwidths of a mode on either side of its peak
NARROWEST_BELL = 6  # lines on either side,
WIDEST_BELL = 200  # no more
LEAST_BELL_WIDTHS = 1.0  # half bandwidths on either side; less cuts the decay's own power off
BELL_MAC = 0.8  # of a line's strongest direction and the peak's
LEAST_HALF_WIDTH = 1.5  # ζ f T below which the decay lasts as long as the window [lines]
DECAY_FROM, DECAY_TO = 0.95, 0.5  # of the correlation at lag 0, where its slope is taken
STEPS = 256  # of lag over that part
LEAST_OVER_EDGE = 3.0  # power at the peak over the bell's edges; less is no peak
ALLOWED = 3.0  # std of the difference
# Of 702 true modes of a parked tower (seeds 8500 to 8505) the two estimates differed by 2 to 2.9
# attainable std where ζ f T < 30; beyond, the bell's neighbours decide, by shares of the bandwidth.
EXPECTED_STD = 2.5  # of its own estimates, in attainable std
SHARE_OF_BANDWIDTH = 0.15  # of ζ f and of ζ


@dataclass(frozen=True, slots=True)
class CrossCheck:
    """What a second estimator finds where a mode is."""

    frequency: float
    """f [Hz]"""
    damping_ratio: float
    """ζ [-]"""
    frequency_std: float
    """Expected, by the attainable bound [Hz]."""
    damping_ratio_std: float
    """Expected, by the attainable bound [-]."""


def cross_checks(
    modes: Sequence[Mode], samples: FloatArray, sampling_rate: float
) -> list[CrossCheck | None]:
    """A second estimate of each mode; None where the spectrum shows no peak of its own.

    Parameters
    ----------
    modes : sequence of Mode
        Lowest frequency first.
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    if not modes:
        return []
    n = len(samples)
    rms = np.sqrt(np.mean(samples**2, axis=0))
    scaled = samples / np.where(rms > 0, rms, 1.0)
    lines = fft.rfft(scaled * np.hanning(n)[:, None], axis=0)
    frequencies = np.array([mode.frequency for mode in modes])
    return [
        None if mode.pair_id else _of_mode(mode, place, frequencies, lines, n / sampling_rate)
        for place, mode in enumerate(modes)
    ]


def combined_checks(checks: Sequence[CrossCheck]) -> CrossCheck:
    """The mean over windows of one mode's second estimates, weighted by their variance."""
    stds = np.array([[each.frequency_std, each.damping_ratio_std] for each in checks])
    values = np.array([[each.frequency, each.damping_ratio] for each in checks])
    weights = stds**-2
    frequency, damping = ((weights * values).sum(axis=0) / weights.sum(axis=0)).tolist()
    frequency_std, damping_std = (weights.sum(axis=0) ** -0.5).tolist()
    return CrossCheck(frequency, damping, frequency_std, damping_std)


def disagreements(
    modes: Sequence[Mode], checks: Sequence[CrossCheck | None]
) -> list[QualityWarning]:
    """A warning of each mode whose two estimates differ by more than their std allow."""
    found = []
    for mode, check in zip(modes, checks, strict=True):
        if check is None:
            continue
        allowed = ALLOWED * float(np.hypot(mode.frequency_std, check.frequency_std))
        allowed_damping = ALLOWED * float(
            np.hypot(np.nan_to_num(mode.damping_ratio_std), check.damping_ratio_std)
        )
        apart = abs(check.frequency - mode.frequency)
        if apart > allowed or abs(check.damping_ratio - mode.damping_ratio) > allowed_damping:
            found.append(
                QualityWarning(
                    "cross-check",
                    f"mode at {mode.frequency:.4g} Hz, ζ {100 * mode.damping_ratio:.2g} %: its "
                    f"peak's decay has {check.frequency:.4g} Hz, {100 * check.damping_ratio:.2g} % "
                    f"(apart by up to {allowed:.2g} Hz, {100 * allowed_damping:.2g} % would be "
                    "chance)",
                )
            )
    return found


def _of_mode(
    mode: Mode, place: int, frequencies: FloatArray, lines: ComplexArray, duration: float
) -> CrossCheck | None:
    half_width = mode.half_bandwidth * duration
    if half_width < LEAST_HALF_WIDTH:
        return None
    low, high = _stretch(place, frequencies, half_width, duration)
    n_together = 2 * round(min(half_width, 20.0) / 2) + 1
    first, last = low - n_together // 2, high + n_together // 2
    if first < 1 or last >= len(lines) or high - low < NARROWEST_BELL:
        return None
    part = lines[first : last + 1]
    products = np.einsum("ki,kj->kij", part, part.conj()).real
    sums = np.concatenate([np.zeros((1, *products.shape[1:])), np.cumsum(products, axis=0)])
    values, vectors = np.linalg.eigh(sums[n_together:] - sums[:-n_together])
    strongest = vectors[:, :, -1]
    reach = max(2, round(half_width))
    middle = round(mode.frequency * duration) - low
    near = slice(max(0, middle - reach), middle + reach + 1)
    peak = int(np.argmax(values[near, -1])) + near.start
    alike = (strongest @ strongest[peak]) ** 2 >= BELL_MAC
    left, right = _run(alike, peak)
    edge = float(np.mean(values[[left, right], -1]))
    narrowest = max(NARROWEST_BELL / 2, LEAST_BELL_WIDTHS * half_width)
    if min(right - peak, peak - left) < narrowest or values[peak, -1] < LEAST_OVER_EDGE * edge:
        return None
    bell = lines[low + left : low + right + 1] @ strongest[peak]
    return _decay(np.abs(bell) ** 2, low + left, duration, half_width)


def _stretch(
    place: int, frequencies: FloatArray, half_width: float, duration: float
) -> tuple[int, int]:
    """Lines about a mode, halfway to its neighbours at most."""
    own = frequencies[place] * duration
    reach = float(np.clip(BELL_WIDTHS * half_width, NARROWEST_BELL, WIDEST_BELL))
    low, high = own - reach, own + reach
    if place > 0:
        low = max(low, (own + frequencies[place - 1] * duration) / 2)
    if place + 1 < len(frequencies):
        high = min(high, (own + frequencies[place + 1] * duration) / 2)
    return round(low), round(high)


def _run(alike: BoolArray, peak: int) -> tuple[int, int]:
    """First and last of the places about the peak that are alike without a break."""
    breaks = np.flatnonzero(~alike)
    before, after = breaks[breaks < peak], breaks[breaks > peak]
    return (
        int(before[-1]) + 1 if len(before) else 0,
        int(after[0]) - 1 if len(after) else len(alike) - 1,
    )


def _decay(power: FloatArray, first: int, duration: float, half_width: float) -> CrossCheck | None:
    """Frequency and damping of the oscillator whose power the lines from `first` on hold."""
    longest = min(0.4, 3.0 / (2 * np.pi * half_width))  # lag over the window's duration
    lags = np.linspace(0.0, longest, STEPS)
    offsets = np.arange(len(power)) - len(power) / 2
    correlation = np.exp(2j * np.pi * np.outer(lags, offsets)) @ power / _of_taper(lags)
    size = np.abs(correlation) / np.abs(correlation[0])
    below = np.flatnonzero(size < DECAY_TO)
    end = int(below[0]) if len(below) else STEPS
    start = int(np.argmax(size[:end] < DECAY_FROM))
    if end - start < 8:
        return None
    at, weight = lags[start:end], size[start:end]
    rate = -float(np.polyfit(at, np.log(size[start:end]), 1, w=weight)[0])
    turn = float(np.polyfit(at, np.unwrap(np.angle(correlation[start:end])), 1, w=weight)[0])
    position = first + len(power) / 2 + turn / (2 * np.pi)
    width = rate / (2 * np.pi)
    if not 0 < width < 0.2 * position:
        return None
    size_of = float(np.hypot(position, width))
    damping = width / size_of
    # a bell that its neighbours cut short has too little damping, and would seem sharper for it
    expected = max(damping, half_width / size_of)
    bound = EXPECTED_STD * float(np.sqrt(expected / (2 * np.pi * size_of)))
    std = float(np.hypot(bound, SHARE_OF_BANDWIDTH * expected))
    return CrossCheck(size_of / duration, damping, std * size_of / duration, std)


def _of_taper(lags: FloatArray) -> FloatArray:
    """Autocorrelation of the Hann taper at lags over its length, 1 at lag 0.

    ∫ sin²(πt) sin²(π(t + τ)) dt over the overlap, by its closed form.
    """
    rest = 1 - lags
    turn = 2 * np.pi * lags
    return np.asarray((rest * (2 + np.cos(turn)) / 3) + np.sin(turn) / (2 * np.pi))
