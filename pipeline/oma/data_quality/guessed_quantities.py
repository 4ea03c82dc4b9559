"""Which channels of a file without units are velocities beside accelerations."""

import numpy as np

from pipeline.oma.data_quality.input_checks import without_spikes
from pipeline.oma.preprocessing import MOST_MISSING, filled
from sensors.arrays import FloatArray
from sensors.files.table import Quantity

FEWEST_FOR_PHASES = 1000  # fewer say nothing about phases
MOST_FOR_PHASES = 100_000  # more say nothing new
SHARPNESS = 3  # power of the coherence that lines are weighted by
LOUDEST_LINES = 0.01  # share of the lines that stand out alike, however loud: mains hum is one [-]
CLEARLY = 0.7  # mean −cos 2φ of two groups that differ by a quarter of a period


def guessed_quantities(samples: FloatArray, sampling_rate: float) -> tuple[Quantity, ...] | None:
    """Which channels are velocities beside accelerations, by how the channels move together.

    samples   (n, n_channels)
    returns   None where all channels share one phase, or nothing can be concluded

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
    scaled = (whole[:MOST_FOR_PHASES] - whole.mean(axis=0)).T
    from scipy.signal import csd  # slow to load, and few records measure several quantities

    f, spectra = csd(
        scaled[:, None], scaled[None, :], fs=sampling_rate, nperseg=min(len(scaled.T) // 8, 4096)
    )
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
