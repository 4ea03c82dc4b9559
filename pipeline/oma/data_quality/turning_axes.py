"""Axes that turn within a window: a nacelle that yaws takes the directions of its modes along.

What shakes in a narrow band moves along the axes of the modes there, however strong the loads on
each are. With S_j the real part of the mean y yᴴ of a band's lines in the j-th part of the window,
along the two directions of the channels in which most moves, and B a rotation of these,

    L = Σ_j n_j ln(|diag(Bᵀ S_j B)| / |S_j|)

at its least over B is χ² distributed with one degree of freedom for each part but one, where all
parts have the same axes, whatever moves along each of them (common principal components). n_j is
twice the number of independent lines, of which a band with a sharp peak has few.
Source: Flury (1984), Common principal components in k groups, J. Am. Stat. Assoc. 79.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from scipy import special

from pipeline.oma.preprocessing import lines_of_channels
from sensors.arrays import ComplexArray, FloatArray

PARTS = 4  # of a window whose axes are compared
BAND = 2 ** (1 / 3)  # highest over lowest frequency
FEWEST_CYCLES = 20.0  # f times a part of the lowest band
FEWEST_LINES = 12  # of a band
OVERLAP = 35 / 18  # lines that one independent line makes under the Hann taper
HIGHEST = 0.45  # of the sampling rate
LEAST_MOTION = 1e-6  # of the second direction's power over the first's: less is the instrument
STEPS = 90  # of B over a right angle
SURE = -25.0  # ln of the probability by chance


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
        return self.log_chance < SURE


def turning_axes(samples: FloatArray, sampling_rate: float) -> TurningAxes | None:
    """The band whose axes differ most surely; None where the window is too short for any.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    """
    n = len(samples) // PARTS
    scales = np.std(samples, axis=0)
    heard = scales > 0
    if n < 2 or heard.sum() < 2:
        return None
    scaled = samples[:, heard] / scales[heard]
    parts = [scaled[j * n : (j + 1) * n] for j in range(PARTS)]
    ones, taper = np.ones(scaled.shape[1]), np.hanning(n)
    lines = np.array([lines_of_channels(part - part.mean(axis=0), ones, taper) for part in parts])
    bands = _bands(lines, n / sampling_rate, sampling_rate)
    return min(bands, key=lambda each: each.log_chance, default=None)


def _bands(lines: ComplexArray, duration: float, sampling_rate: float) -> Iterator[TurningAxes]:
    """lines: of each part, (PARTS, n_lines, n_channels). duration: of a part [s]"""
    low = FEWEST_CYCLES / duration
    while BAND * low < HIGHEST * sampling_rate:
        first, last = round(low * duration), round(BAND * low * duration)
        if last - first >= FEWEST_LINES:
            chance = _log_chance(lines[:, first:last])
            if chance is not None:
                yield TurningAxes(low, BAND * low, chance)
        low *= BAND


def _log_chance(band: ComplexArray) -> float | None:
    """ln of the probability of axes as different by chance; None where all moves along one."""
    whole = np.einsum("jla,jlb->ab", band, band.conj()).real
    powers, vectors = np.linalg.eigh(whole)
    if powers[-2] <= LEAST_MOTION * powers[-1]:
        return None
    along = band @ vectors[:, -2:]
    spectra = np.einsum("jla,jla->jl", along, along.conj()).real
    # a periodogram's lines scatter, which alone would halve their number
    independent = 2 * spectra.sum(axis=1) ** 2 / (spectra**2).sum(axis=1)
    counts = 2 * np.minimum(independent, band.shape[1]) / OVERLAP
    covariances = np.einsum("jla,jlb->jab", along, along.conj()).real
    least = _least_over_rotations(covariances, counts)
    return float(np.log(special.chdtrc(PARTS - 1, least) + np.finfo(float).tiny))


def _least_over_rotations(covariances: FloatArray, counts: FloatArray) -> float:
    """L for the rotation at which it is least."""
    angles = np.arange(STEPS) / STEPS * np.pi / 2
    cosines, sines = np.cos(angles), np.sin(angles)
    rotations = np.array([[cosines, -sines], [sines, cosines]]).transpose(2, 0, 1)
    turned = np.einsum("rba,jbc,rcd->rjad", rotations, covariances, rotations)
    diagonal = turned[..., 0, 0] * turned[..., 1, 1]
    determinants = np.maximum(np.linalg.det(covariances), 1e-12 * diagonal)
    return float((np.log(diagonal / determinants) @ counts).min())
