"""A rotor stop, a blow that rings down, a passing ship, a yaw: energy or axes that a stationary
window has not by chance.

A lightly damped mode under stationary load swells and fades by itself, the more the fewer of its
own decay times the window holds. So each octave is judged by its own number of independent values
(`loudest_octave`): with B the equivalent bandwidth of what shakes there, energy averaged over Δt
has k = max(1, B Δt) of them and follows a gamma distribution of shape k; the window of length T
holds n = T / max(Δt, 1/B) such averages.

Where a window holds a few of a mode's decay times only, its loudness says little of the loads. What
drives it varies independently from sample to sample. So the response of each lower octave is
whitened too (`ring_down`): with y_k the complex envelope of the octave, sampled at its bandwidth, a
linear prediction leaves

    e_k = y_k − a_1 y_{k−1} − … − a_p y_{k−p},   E|e_k|² = σ²

of which |e_k|²/σ² is exponentially distributed under Gaussian loads, however long the modes ring. A
ring-down begins with one e_k far beyond that, which holds a share of the octave's whole energy; a
stop leaves the rest of the window with another σ² than before.
Source: linear prediction of ambient response by least squares (Makhoul 1975, Linear prediction: a
tutorial review, Proc. IEEE 63).

A nacelle that yaws takes the directions of its modes along (`turning_axes`). What shakes in a
narrow band moves along the axes of the modes there, however strong the loads on each are. With S_j
the real part of the mean y yᴴ of a band's lines in the j-th part of the window, along the two
directions of the channels in which most moves, and B a rotation of these,

    L = Σ_j n_j ln(|diag(Bᵀ S_j B)| / |S_j|)

at its least over B is χ² distributed with one degree of freedom for each part but one, where all
parts have the same axes, whatever moves along each of them. n_j is twice the number of independent
lines, of which a band with a sharp peak has few.
Source: common principal components (Flury 1984, J. Am. Stat. Assoc. 79).
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import fft, special

from pipeline.oma.preprocessing import lines_of_channels
from sensors.arrays import ComplexArray, FloatArray

FALSE_ALARM = 2e-4  # of one octave of one stationary window
GUSTS = 1.8  # energy that stationary wind and sea add at their loudest, over the median [-]
BLOCKS = 30  # averages over a window
EDGE = 0.03  # of a window at either end that is tapered and not judged
FEWEST_PERIODS = 10  # of an octave's lowest frequency in a window
LEAST_OCTAVE_SHARE = 1e-4  # of a channel's power in an octave; less is the instrument
PREDICTORS = 3  # p: one for each of two modes and the response of the sea
PRINCIPAL_DIRECTIONS = 2  # principal ones of the channels: fore-aft and side-side
FEWEST_LINES = 60  # of an octave
LEAKED = 2  # samples of its envelope at either end that the step between a drift's ends leaks into
MOST_LINES = 700  # beyond, modes are resolved: `loudest_octave`
LEAST_OF_CHANNEL = 1e-4  # of a channel's power in an octave; less is the instrument
PARTS = 6  # of a window whose loads are compared
OUTLIER = 12.0  # of |e|²/σ² in both directions, above which a sample is cut for that comparison
# Chosen on 1000 windows of a tower with gusts of 10 % turbulence, and 400 with decays of five times
# (seeds 20001 to 21200): the largest of the quiet ones, 28 and 6.4, and room for wilder gusts.
BLOW = 35.0  # |e|²/σ² in both directions
SHARE_OF_BLOW = 1.0  # |e|² over the octave's mean energy: a blow that the window's estimates feel
STOP = 12.0  # ratio of σ² of the loudest and the quietest part

COMPARED_PARTS = 4  # of a window whose axes are compared
BAND_RATIO = 2 ** (1 / 3)  # highest over lowest frequency
FEWEST_CYCLES_OF_BAND = 20.0  # f times a part of the lowest band
FEWEST_LINES_OF_BAND = 12  # of a band
TAPERED_LINES = 35 / 18  # lines that one independent line makes under the Hann taper
HIGHEST_BAND = 0.45  # of the sampling rate
LEAST_ACROSS = 1e-6  # of the second direction's power over the first's: less is the instrument
ROTATIONS = 90  # of B over a right angle
SURELY_TURNED = -25.0  # ln of the probability by chance


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

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset, each channel in its own unit.
    sampling_rate : float
        [Hz].

    Notes
    -----
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
    # what leaks into the octave from a tone or a drift below it gathers at the rounded ends, and
    # reaches about 1 / bandwidth beyond them
    edge = round((EDGE + 2 / len(band)) * n_times)
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


@dataclass(frozen=True, slots=True)
class RingDown:
    """The octave whose loads are least those of a stationary window."""

    kind: Literal["blow", "stop"]
    """A sudden motion, or loads of another strength than before."""
    low: float
    """Lowest frequency of the octave; the highest is twice that [Hz]."""
    time: float
    """Of the blow, or of the middle of the loudest part, from the window's start [s]."""
    loudness: float
    """Amplitude of the blow over the octave's rms, or ratio of the loads' rms [-]."""
    excess: float
    """Over what is taken for stationary; more than 1 is not [-]."""


def ring_down(samples: FloatArray, sampling_rate: float) -> RingDown | None:
    """The octave with the largest excess; None where the window is too short.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    n = len(samples)
    duration = n / sampling_rate
    rms = np.sqrt(np.mean(samples**2, axis=0))
    lines = lines_of_channels(samples, np.where(rms > 0, rms, 1.0))
    found: list[RingDown] = []
    n_lines = FEWEST_LINES
    while n_lines <= MOST_LINES and 2 * n_lines / duration <= 0.45 * sampling_rate:
        envelope = _envelope(lines, n_lines)
        if envelope is not None:
            found += _of_octave(envelope, n_lines / duration, duration)
        n_lines *= 2
    return max(found, key=lambda each: each.excess, default=None)


def _envelope(lines: ComplexArray, first: int) -> ComplexArray | None:
    """Complex envelope of lines `first` to 2 `first` along the principal directions,
    (first, PRINCIPAL_DIRECTIONS); None where no channel feels them."""
    band = lines[first : 2 * first]
    power = (np.abs(band) ** 2).sum(axis=0)
    heard = power > LEAST_OF_CHANNEL * (np.abs(lines) ** 2).sum(axis=0)
    if not heard.any():
        return None
    chosen = band[:, heard]
    _, vectors = np.linalg.eigh(chosen.conj().T @ chosen)
    return np.asarray(fft.ifft(chosen @ vectors[:, -PRINCIPAL_DIRECTIONS:], axis=0))


def _of_octave(envelope: ComplexArray, low: float, duration: float) -> list[RingDown]:
    driven = np.column_stack([_innovations(each) for each in envelope.T])[LEAKED:-LEAKED]
    energy = np.abs(driven) ** 2
    energy = np.maximum(energy, 1e-12 * energy.max())
    overall = np.median(energy, axis=0) / np.log(2)
    local = np.maximum(_local_medians(energy) / np.log(2), 0.3 * overall)
    blows = (energy / local).sum(axis=1)
    at = int(np.argmax(blows))
    share = float(energy[at].sum() / (np.abs(envelope) ** 2).sum(axis=1).mean())
    step = duration / len(envelope)
    blow = min(float(blows[at]) / BLOW, share / SHARE_OF_BLOW)
    cut = np.minimum((energy / overall).sum(axis=1), OUTLIER)
    parts = np.array([part.mean() for part in np.array_split(cut, PARTS)])
    loudest, ratio = int(np.argmax(parts)), float(parts.max() / parts.min())
    middle = (loudest + 0.5) * duration / PARTS
    return [
        RingDown("blow", low, (at + LEAKED + PREDICTORS) * step, float(np.sqrt(share)), blow),
        RingDown("stop", low, middle, float(np.sqrt(ratio)), ratio / STOP),
    ]


def _innovations(envelope: ComplexArray) -> ComplexArray:
    """What a linear prediction from the last samples leaves, (n − PREDICTORS,)."""
    n, p = len(envelope), PREDICTORS
    past = np.column_stack([envelope[p - lag : n - lag] for lag in range(1, p + 1)])
    gram = past.conj().T @ past + 1e-9 * np.vdot(envelope, envelope).real * np.eye(p)
    weights = np.linalg.solve(gram, past.conj().T @ envelope[p:])
    return np.asarray(envelope[p:] - past @ weights)


def _local_medians(energy: FloatArray) -> FloatArray:
    """Medians over a PARTS-th of the window about each sample, (n, PRINCIPAL_DIRECTIONS)."""
    halves = np.array_split(energy, 2 * PARTS)
    centres, medians, begin = [], [], 0
    for one, other in pairwise(halves):
        centres.append(begin + len(one))
        medians.append(np.median(np.concatenate([one, other]), axis=0))
        begin += len(one)
    places = np.arange(len(energy))
    return np.column_stack([np.interp(places, centres, each) for each in np.array(medians).T])


@dataclass(frozen=True, slots=True)
class TurningAxes:
    """The band whose axes differ most surely."""

    low: float
    """[Hz]"""
    high: float
    """[Hz]"""
    log_chance: float
    """ln of the probability of as much by chance [-]."""

    @property
    def is_sure(self) -> bool:
        """Whether it is no chance."""
        return self.log_chance < SURELY_TURNED


def turning_axes(samples: FloatArray, sampling_rate: float) -> TurningAxes | None:
    """The band whose axes differ most surely; None where the window is too short for any.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    n = len(samples) // COMPARED_PARTS
    if n < 2 or samples.shape[1] < 2:
        return None
    scales = np.std(samples, axis=0)
    scales, taper = np.where(scales > 0, scales, 1.0), np.hanning(n)
    parts = (samples[j * n : (j + 1) * n] for j in range(COMPARED_PARTS))
    lines = np.array([lines_of_channels(part - part.mean(axis=0), scales, taper) for part in parts])
    bands = _compared_bands(lines, n / sampling_rate, sampling_rate)
    return min(bands, key=lambda each: each.log_chance, default=None)


def _compared_bands(
    lines: ComplexArray, duration: float, sampling_rate: float
) -> Iterator[TurningAxes]:
    """lines: of each part, (COMPARED_PARTS, n_lines, n_channels). duration: of a part [s]"""
    low = FEWEST_CYCLES_OF_BAND / duration
    while BAND_RATIO * low < HIGHEST_BAND * sampling_rate:
        first, last = round(low * duration), round(BAND_RATIO * low * duration)
        if last - first >= FEWEST_LINES_OF_BAND:
            chance = _log_chance_of_axes(lines[:, first:last])
            if chance is not None:
                yield TurningAxes(low, BAND_RATIO * low, chance)
        low *= BAND_RATIO


def _log_chance_of_axes(band: ComplexArray) -> float | None:
    """ln of the probability of axes as different by chance; None where all moves along one."""
    whole = np.einsum("jla,jlb->ab", band, band.conj()).real
    powers, vectors = np.linalg.eigh(whole)
    if powers[-2] <= LEAST_ACROSS * powers[-1]:
        return None
    along = band @ vectors[:, -2:]
    spectra = np.einsum("jla,jla->jl", along, along.conj()).real
    # a periodogram's lines scatter, which alone would halve their number
    independent = 2 * spectra.sum(axis=1) ** 2 / (spectra**2).sum(axis=1)
    counts = 2 * np.minimum(independent, band.shape[1]) / TAPERED_LINES
    covariances = np.einsum("jla,jlb->jab", along, along.conj()).real
    least = _least_over_rotations(covariances, counts)
    return float(np.log(special.chdtrc(COMPARED_PARTS - 1, least) + np.finfo(float).tiny))


def _least_over_rotations(covariances: FloatArray, counts: FloatArray) -> float:
    """L for the rotation at which it is least."""
    angles = np.arange(ROTATIONS) / ROTATIONS * np.pi / 2
    cosines, sines = np.cos(angles), np.sin(angles)
    rotations = np.array([[cosines, -sines], [sines, cosines]]).transpose(2, 0, 1)
    turned = np.einsum("rba,jbc,rcd->rjad", rotations, covariances, rotations)
    diagonal = turned[..., 0, 0] * turned[..., 1, 1]
    determinants = np.maximum(np.linalg.det(covariances), 1e-12 * diagonal)
    return float((np.log(diagonal / determinants) @ counts).min())
