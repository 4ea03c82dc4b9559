"""A rotor stop, a ring-down, a passing ship: energy that a stationary window has not by chance.

A lightly damped mode under stationary load swells and fades by itself, the more the fewer of its
own decay times the window holds. So each octave is judged by its own number of independent values:
with B the equivalent bandwidth of what shakes there, energy averaged over Δt has k = max(1, B Δt)
of them and follows a gamma distribution of shape k; the window of length T holds
n = T / max(Δt, 1/B) such averages.
"""

from dataclasses import dataclass

import numpy as np
from scipy import fft, special

from pipeline.oma.ssi.preprocessing import lines_of_channels
from sensors.arrays import ComplexArray, FloatArray

FALSE_ALARM = 2e-4  # of one octave of one stationary window
GUSTS = 1.8  # energy that stationary wind and sea add at their loudest, over the median [-]
BLOCKS = 30  # averages over a window
EDGE = 0.03  # of a window at either end that is tapered and not judged
FEWEST_PERIODS = 10  # of an octave's lowest frequency in a window
LEAST_OCTAVE_SHARE = 1e-4  # of a channel's power in an octave; less is the instrument


@dataclass(frozen=True, slots=True)
class Transient:
    """The octave that stands out most."""

    low: float
    """Lowest frequency of the octave; the highest is twice that [Hz]."""
    begin: float
    """Of the loudest average, from the window's start [s]."""
    loudness: float
    """Amplitude of the loudest average over the median one [-]."""
    excess: float
    """Its energy over the largest that a stationary window would show [-]."""


def loudest_octave(samples: FloatArray, sampling_rate: float) -> Transient | None:
    """The octave whose loudest moment is least likely by chance; None for too short a window.

    samples   (n, n_channels), free of offset

    More than 1 in `excess`: not stationary, with a false alarm in at most 2e-4 of the octaves of
    windows whose load keeps its strength to GUSTS.
    """
    n = len(samples)
    duration = n / sampling_rate
    rms = np.sqrt(np.mean(samples**2, axis=0))
    # without a taper the step from the record's end to its start would shake every octave
    lines = lines_of_channels(samples, np.where(rms > 0, rms, 1.0), _rounded_edges(n))
    low = FEWEST_PERIODS / duration
    found: list[Transient] = []
    while 2 * low <= 0.45 * sampling_rate:
        octave = _judged(lines, low, duration)
        if octave is not None:
            found.append(octave)
        low *= 2
    return max(found, key=lambda each: each.excess, default=None)


def _rounded_edges(n: int) -> FloatArray:
    """1 but for the first and last EDGE of a window, which rise as half a cosine (Tukey)."""
    rise = np.arange(n) / (EDGE * (n - 1))
    inner = np.minimum(1.0, np.minimum(rise, rise[::-1]))
    return np.asarray(0.5 * (1 - np.cos(np.pi * inner)))


def _judged(lines: ComplexArray, low: float, duration: float) -> Transient | None:
    first, last = round(low * duration), min(round(2 * low * duration), len(lines))
    band = lines[first:last]
    power = (np.abs(band) ** 2).sum(axis=0)
    total = (np.abs(lines) ** 2).sum(axis=0)
    heard = power > LEAST_OCTAVE_SHARE * total
    if len(band) < BLOCKS // 3 or not heard.any():
        return None
    scaled = band[:, heard] / np.sqrt(power[heard])
    n_times = max(4 * BLOCKS, 2 * len(band))
    envelope = np.abs(fft.ifft(scaled, n_times, axis=0)) ** 2
    edge = round(EDGE * n_times)
    energy = envelope.sum(axis=1)[edge : n_times - edge]
    width = n_times // BLOCKS
    sums = np.concatenate([[0.0], np.cumsum(energy)])
    averages = (sums[width:] - sums[:-width]) / width
    spectrum = (np.abs(scaled) ** 2).sum(axis=1)
    n_values = float(spectrum.sum() ** 2 / (spectrum**2).sum()) / 2  # a periodogram's lines scatter
    k = max(1.0, n_values / BLOCKS)
    n_averages = min(float(BLOCKS), max(2.0, n_values))
    chance = special.gammaincinv(k, 1 - FALSE_ALARM / n_averages) / special.gammaincinv(k, 0.5)
    loudest = int(np.argmax(averages))
    ratio = float(averages[loudest] / max(np.median(averages), 1e-300))
    return Transient(
        low,
        (loudest + edge) / n_times * duration,
        float(np.sqrt(ratio)),
        float(ratio / (GUSTS * chance)),
    )
