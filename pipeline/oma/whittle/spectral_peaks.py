"""Peaks of a window's spectrum that two directions share: pairs that no pole may show.

Where two modes are nearer than the window resolves, the two poles of a model order mix their shapes
in complex ones, another mixture in every order, and each is refused for itself. The lines show the
pair all the same: a peak that stands out in two directions.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.oma.whittle.narrow_band import WindowSpectrum

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
