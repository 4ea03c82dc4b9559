"""Which channels of a file without units are velocities beside accelerations."""

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft

from pipeline.oma.data_quality.input_checks import without_spikes
from pipeline.oma.preprocessing import MOST_MISSING, filled
from sensors.arrays import ComplexArray, FloatArray
from sensors.files.table import Quantity

FEWEST_FOR_PHASES = 1000  # fewer say nothing about phases
MOST_FOR_PHASES = 100_000  # more say nothing new
SHARPNESS = 3  # power of the coherence that lines are weighted by
LOUDEST_LINES = 0.01  # share of the lines that stand out alike, however loud: mains hum is one [-]
SEGMENTS, LONGEST_SEGMENT = 8, 4096  # of the spectra, and in samples
CLEARLY = 0.7  # mean −cos 2φ of two groups that differ by a quarter of a period


def guessed_quantities(samples: FloatArray, sampling_rate: float) -> tuple[Quantity, ...] | None:
    """Which channels are velocities beside accelerations, by how the channels move together.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        NaN where missing; each channel in its own unit.
    sampling_rate : float
        [Hz].

    Returns
    -------
    tuple of Quantity or None
        None where all channels share one phase, or nothing can be concluded.

    Notes
    -----
    At a resonance two channels of one quantity are in phase or in opposition, a velocity and an
    acceleration (or a velocity and a displacement) a quarter of a period apart: cos 2φ of their
    cross-spectrum is 1 or −1. Of two groups of channels that differ so, the one whose spectrum
    rises over the other's is the derivative. A displacement beside an acceleration is not detected.

    Of 111 records of random frames (`tests/benchmarks/records.py`, seeds 4001 to 4120) all 18 with
    both kinds were distinguished from the others, 16 in the right order.
    """
    n, n_channels = samples.shape
    if n_channels < 2 or n < FEWEST_FOR_PHASES:
        return None
    known = np.isfinite(samples)
    if known.mean(axis=0).min() < 1 - MOST_MISSING:
        return None
    whole = without_spikes(filled(samples, sampling_rate))
    scaled = whole[:MOST_FOR_PHASES] - whole.mean(axis=0)
    f, spectra = cross_spectra(scaled, sampling_rate, min(len(scaled) // SEGMENTS, LONGEST_SEGMENT))
    f, spectra = f[2:], spectra[..., 2:]  # without what a drift leaves
    power = np.einsum("iif->if", spectra).real
    if not (np.quantile(power, 1 - LOUDEST_LINES, axis=1) > 0).all():
        return None
    together = np.abs(spectra) ** 2 / np.maximum(power[:, None] * power[None], np.finfo(float).tiny)
    loudest = np.quantile(power, 1 - LOUDEST_LINES, axis=1, keepdims=True)
    height = np.sqrt(np.minimum(power / loudest, 1.0))  # resonances stand out
    weights = together**SHARPNESS * height[:, None] * height[None]
    agreement = np.sum(weights * np.cos(2 * np.angle(spectra)), axis=-1)
    agreement -= np.diag(np.diag(agreement))
    sides = np.linalg.eigh(agreement)[1][:, -1] > 0
    one, other = agreement[np.ix_(sides, sides)], agreement[np.ix_(sides, ~sides)]
    if sides.all() or not sides.any() or other.mean() > 0 or one.sum() < 0:
        return None
    if -other.sum() < CLEARLY * weights[np.ix_(sides, ~sides)].sum():
        return None
    joint = weights[np.ix_(sides, ~sides)].sum(axis=(0, 1))
    ratio = np.log(power[sides]).mean(axis=0) - np.log(power[~sides]).mean(axis=0)
    steepness = np.polyfit(np.log(f), ratio, 1, w=np.sqrt(joint))[0]
    faster = sides if steepness > 0 else ~sides
    return tuple("acceleration" if each else "velocity" for each in faster)


def cross_spectra(
    samples: FloatArray, sampling_rate: float, length: int
) -> tuple[FloatArray, ComplexArray]:
    """Cross-spectral densities of every two channels, as `scipy.signal.csd` has them.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Without gaps, each channel in its own unit.
    sampling_rate : float
        [Hz].
    length : int
        Of the segments, which overlap by half, free of their means under Hann's taper [samples].

    Returns
    -------
    frequencies : ndarray, shape (n_lines,)
        [Hz].
    spectra : ndarray, shape (n_channels, n_channels, n_lines)
        conj(x_i) x_j [product of the two channels' units per Hz].

    Notes
    -----
    Written out since `scipy.signal` takes half as long to load as a window to identify.

    References
    ----------
    Welch 1967, IEEE Trans. Audio Electroacoust. 15.
    """
    taper = 0.5 - 0.5 * np.cos(2 * np.pi * np.arange(length) / length)
    segments = sliding_window_view(samples, length, axis=0)[:: length - length // 2]
    steady = segments - segments.mean(axis=-1, keepdims=True)
    lines = fft.rfft(taper * steady, axis=-1)  # (n_segments, n_channels, n_lines)
    spectra = np.einsum("sif,sjf->ijf", lines.conj(), lines) / len(lines)
    spectra *= 2 / (sampling_rate * (taper**2).sum())
    spectra[..., 0] /= 2
    if length % 2 == 0:
        spectra[..., -1] /= 2
    return fft.rfftfreq(length, 1 / sampling_rate), spectra
