"""A blow that rings down, a rotor stop: what a mode does that loads of one strength do not.

A lightly damped mode holds a window's energy for so long that its loudness varies by itself, and a
window of a few of its decay times says little of it. What drives it varies independently from
sample to sample. So the response of each octave is whitened: with y_k the complex envelope of the
octave, sampled at its bandwidth, a linear prediction leaves

    e_k = y_k − a_1 y_{k−1} − … − a_p y_{k−p},   E|e_k|² = σ²

of which |e_k|²/σ² is exponentially distributed under Gaussian loads, however long the modes ring. A
ring-down begins with one e_k far beyond that, which holds a share of the octave's whole energy; a
stop leaves the rest of the window with another σ² than before.
Source: linear prediction of ambient response by least squares (Makhoul 1975, Linear prediction: a
tutorial review, Proc. IEEE 63).
"""

from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy import fft

from pipeline.oma.ssi.preprocessing import lines_of_channels
from sensors.arrays import ComplexArray, FloatArray

PREDICTORS = 3  # p: one for each of two modes and the response of the sea
PRINCIPAL_DIRECTIONS = 2  # principal ones of the channels: fore-aft and side-side
FEWEST_LINES = 60  # of an octave
MOST_LINES = 700  # beyond, modes are resolved: `transients`
LEAST_OF_CHANNEL = 1e-4  # of a channel's power in an octave; less is the instrument
PARTS = 6  # of a window whose loads are compared
OUTLIER = 12.0  # of |e|²/σ² in both directions, above which a sample is cut for that comparison
# Chosen on 1000 windows of a tower with gusts of 10 % turbulence, and 400 with decays of five times
# (seeds 20001 to 21200): the largest of the quiet ones, 28 and 6.4, and room for wilder gusts.
BLOW = 35.0  # |e|²/σ² in both directions
SHARE_OF_BLOW = 1.0  # |e|² over the octave's mean energy: a blow that the window's estimates feel
STOP = 12.0  # ratio of σ² of the loudest and the quietest part


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
    driven = np.column_stack([_innovations(each) for each in envelope.T])
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
        RingDown("blow", low, (at + PREDICTORS) * step, float(np.sqrt(share)), blow),
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
