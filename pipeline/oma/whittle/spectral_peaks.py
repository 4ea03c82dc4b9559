"""Peaks of a window's spectrum that two directions share: pairs that no pole may show.

Where two modes are nearer than the window resolves, the two poles of a model order mix their shapes
in complex ones, another mixture in every order, and each is refused for itself. The lines show the
pair all the same: a peak that stands out in two directions.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.whittle.narrow_band import WindowSpectrum, far_reach, peaks_and_flanks
from sensors.arrays import FloatArray

LOWEST_PEAK = 20.0  # f T from which lines lie beside a peak on both sides
HIGHEST_PEAK = 300.0  # f T below which a mode of 1 % is not resolved
SECOND_OVER_FLANK = (
    10.0  # power of the second direction: of pairs never less (`close_modes.HIDDEN`)
)
PEAK_HALF_WIDTH = 1.0  # of such a mode's resonance [lines]
PEAK_DAMPING = 0.003  # ζ from which resolved peaks are wider than that [-]
HIGHEST_LONE_PEAK = 1500.0  # f T
FIRST_OVER_FLANK = 30.0  # power of a lone peak
MOST_LONE_PEAKS = 10
CLEAR_LINES = 6.0  # lines between a peak and a mode that is known
NARROWEST_UNSEEN = 3.0  # half bandwidth of a resonance that no pole shows [lines],
UNSEEN_STEP = 2.0  # and from one width to the next
BLOCKS_A_WIDTH = 8  # least blocks of lines summed to a half bandwidth
LEAST_DAMPED, MOST_DAMPED = 0.002, 0.1  # ζ of such a resonance [-]
STANDS_OUT_OF_CHANNEL = 1.3  # power over flank in one channel from which directions are looked at
STANDS_OUT_UNSEEN = 1.8  # power over flank across the shapes of what is known there
REACHES_WIDTHS = 3.0  # half bandwidths that a known mode reaches into a stretch of lines
FLANK_REACH = 10.0  # half bandwidths of a known mode within which its shape is its flank's
SHAPE_OF_FLANK = 0.9  # MAC of these
LEAST_GAIN = 40.0  # of a peak; the highest of noise has 30 [nats]
WIDTHS_BETWEEN_PEAKS = 2.0  # half bandwidths of the wider one between two peaks


@dataclass(frozen=True, slots=True, eq=False)
class KnownPeak:
    """What is known to shake at a frequency."""

    frequency: float
    """[Hz]"""
    half_bandwidth: float
    """ζ f [Hz]"""
    shape: FloatArray
    """(n_channels,) of the scaled channels, any scale [-]."""


def peaks_of_two(spectrum: WindowSpectrum, known: Sequence[float]) -> list[float]:
    """Frequencies [Hz] of peaks that stand out in two directions and belong to no known mode.

    Parameters
    ----------
    spectrum : WindowSpectrum
    known : sequence of float
        Frequencies of what the poles show, modes and others [Hz].
    """
    return [
        frequency
        for frequency in _peaks(spectrum, known, HIGHEST_PEAK)
        if _over_flank(spectrum, frequency, 1) > SECOND_OVER_FLANK
    ]


def lone_peaks(spectrum: WindowSpectrum) -> list[float]:
    """Frequencies [Hz] of peaks that stand out in one direction: where poles show no mode at all.

    Parameters
    ----------
    spectrum : WindowSpectrum
    """
    found = _peaks(spectrum, [], HIGHEST_LONE_PEAK)
    return [f for f in found if _over_flank(spectrum, f, 0) > FIRST_OVER_FLANK][:MOST_LONE_PEAKS]


def _over_flank(spectrum: WindowSpectrum, frequency: float, direction: int) -> float:
    half_bandwidth = max(PEAK_HALF_WIDTH / spectrum.duration, PEAK_DAMPING * frequency)
    powers = spectrum.powers_over_flank(frequency, frequency, half_bandwidth)
    return float(powers[direction]) if len(powers) > direction else 0.0


def _peaks(spectrum: WindowSpectrum, known: Sequence[float], highest: float) -> list[float]:
    """Tops of the strongest direction's power over three lines, the highest first."""
    T = spectrum.duration
    band = spectrum.band(LOWEST_PEAK / T, highest / T)
    if len(band.numbers) < 5:
        return []
    smooth = band.matrices.real
    smooth = smooth[:-2] + smooth[1:-1] + smooth[2:]
    largest = np.linalg.eigvalsh(smooth)[:, -1]
    inner = largest[1:-1]
    tops = 1 + np.flatnonzero((inner >= largest[:-2]) & (inner > largest[2:]))
    found: list[float] = []
    for top in tops[np.argsort(-largest[tops], kind="stable")].tolist():
        frequency = float(band.numbers[top + 1]) / T
        clear = max(CLEAR_LINES / T, 6 * PEAK_DAMPING * frequency)
        if all(abs(frequency - other) >= clear for other in (*known, *found)):
            found.append(frequency)
    return found


@dataclass(frozen=True, slots=True, eq=False)
class UnseenPeak:
    """A resonance in a direction that no known mode accounts for."""

    frequency: float
    """[Hz]"""
    half_bandwidth: float
    """Of the stretch of lines in which it stands out most [Hz]."""
    shape: FloatArray
    """(n_channels,) of the scaled channels, any scale [-]."""
    gain: float
    """Rise of ln p if the power in this direction were fitted there [nats]."""


def unseen_peaks(
    spectrum: WindowSpectrum, known: Sequence[KnownPeak], low: float, high: float
) -> list[UnseenPeak]:
    """Resonances that stand out across the shapes of what is known there, the clearest first.

    Parameters
    ----------
    spectrum : WindowSpectrum
    known : sequence of KnownPeak
        All that is known to shake, modes and others.
    low, high : float
        Frequencies between which they are sought [Hz].
    """
    found: list[UnseenPeak] = []
    width = NARROWEST_UNSEEN
    while width <= MOST_DAMPED * high * spectrum.duration:
        found += _unseen_of_width(spectrum, known, low, high, width)
        width *= UNSEEN_STEP
    chosen: list[UnseenPeak] = []
    for peak in sorted(found, key=lambda each: -each.gain):
        if all(
            abs(peak.frequency - other.frequency)
            > WIDTHS_BETWEEN_PEAKS * max(peak.half_bandwidth, other.half_bandwidth)
            for other in chosen
        ):
            chosen.append(peak)
    return chosen


def _unseen_of_width(
    spectrum: WindowSpectrum,
    known: Sequence[KnownPeak],
    low: float,
    high: float,
    width: float,
) -> list[UnseenPeak]:
    """width: half bandwidth [lines]"""
    T = spectrum.duration
    first = max(low * T, width / MOST_DAMPED)
    last = min(high * T, width / LEAST_DAMPED)
    centres = np.arange(first, last, max(1.0, 0.7 * width))
    if not len(centres):
        return []
    stride = max(1, int(width / BLOCKS_A_WIDTH))  # else all lines of fast channels are held at once
    sums = spectrum.running_sums(stride, last + far_reach(width) + 2 * stride)
    at, beside = peaks_and_flanks(sums, stride, centres, width)
    beside += 1e-9 * np.einsum("kii->k", beside)[:, None, None] * np.eye(len(beside[0]))
    ratio = np.einsum("kii->ki", at) / np.einsum("kii->ki", beside)
    worth = ratio.max(axis=1) > STANDS_OUT_OF_CHANNEL
    centres, at, beside = centres[worth], at[worth], beside[worth]
    into = np.linalg.inv(np.linalg.cholesky(beside))
    white = into @ at @ into.transpose(0, 2, 1)
    strongest = np.linalg.eigvalsh(white)[:, -1]
    found: list[UnseenPeak] = []
    for place, centre in enumerate(centres / T):
        near = [
            each.shape
            for each in known
            if abs(each.frequency - centre)
            < (1.5 * width + 2) / T + REACHES_WIDTHS * each.half_bandwidth
        ]
        if strongest[place] < STANDS_OUT_UNSEEN or len(near) >= len(white[place]):
            continue
        power, direction = _strongest_across(white[place], into[place], near)
        gain = 3 * width * (power - 1 - float(np.log(max(power, 1.0))))
        shape = np.linalg.solve(into[place], direction)
        peak = UnseenPeak(float(centre), width / T, shape, gain)
        if power > STANDS_OUT_UNSEEN and gain > LEAST_GAIN and not _is_flank(peak, known):
            found.append(peak)
    return found


def _is_flank(peak: UnseenPeak, known: Sequence[KnownPeak]) -> bool:
    """Whether what stands out has the shape of a known mode that is not far."""
    return any(
        abs(each.frequency - peak.frequency)
        < 1.5 * peak.half_bandwidth + FLANK_REACH * each.half_bandwidth
        and modal_assurance_criterion(each.shape[None], peak.shape[None])[0, 0] > SHAPE_OF_FLANK
        for each in known
    )


def _strongest_across(
    white: FloatArray, into: FloatArray, shapes: Sequence[FloatArray]
) -> tuple[float, FloatArray]:
    """Power of the strongest direction across some shapes, and the direction, whitened."""
    across = np.eye(len(white))
    if shapes:
        whole = np.linalg.qr(into @ np.column_stack(shapes), mode="complete")[0]
        across = whole[:, len(shapes) :]
    values, vectors = np.linalg.eigh(across.T @ white @ across)
    return float(values[-1]), across @ vectors[:, -1]
