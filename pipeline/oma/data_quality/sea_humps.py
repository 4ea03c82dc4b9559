"""Whether a wide resonance below .2 Hz is the sea's spectrum, which sensors show as a hump.

Waves move a tower quasi-statically at their own frequencies: the response has the shape of the
first bending mode and, between a sea's peak and the tower's first frequency, a hump that a
subspace method takes for a mode of some percent of damping. Two models of the power along its shape
are compared by the lines around it, both with a level, a colour and a background:

    resonance   p_k = a (f_k/f)^c / ((1 − r²)² + (2 ζ r)²) + b,  r = f_k / f
    sea         p_k = a (f_k/f)^c JONSWAP(f_k; f, γ) + b

A resonance has two flanks alike; a sea has next to no power below its peak, exp(−5/4 (f/f_k)⁴).
Source of the spectrum: `sensors/sea_spectrum.py`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from pipeline.messages import Mode, QualityWarning, RefusedMode
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from sensors.arrays import FloatArray, IntArray
from sensors.sea_spectrum import jonswap

SLOWEST, FASTEST = 0.04, 0.2  # frequencies of a sea's peak [Hz]
NARROWEST = 1.5  # half bandwidth of what may be a hump [lines]
PLACE_STD = 0.05  # of the ln of what a model has for a frequency over the identified one [-]
LOW, HIGH = 0.6, 1.7  # of the frequency, between which lines are compared
CLEAR_WIDTHS, CLEAR_LINES = 5.0, 4.0  # between these lines and another mode
FEWEST_LINES_OF_HUMP = 15
LOWER_FLANK = 0.8  # of the frequency, down to which lines must reach: there a sea has no power
SURE = 1.0  # ln of the ratio of a sea to a resonance from which a mode is none [nats]
POSSIBLE = -3.0  # and from which a warning says that it may be none [nats]: of 28 simulated humps
# (`sea_humps`, seeds 203300 to 203480) it was −1 to 12, of 80 first modes of 2 to 8 % damping
# beside such a sea below −1
MODAL_COLOUR, SEA_COLOUR = (3.0, 2.0), (2.0, 2.0)  # mean and std of c: white to red forces on
# accelerations; from displacements or tilt (0) to accelerations (4)
DAMPING = (np.log(0.02), 1.2)  # mean and std of ln ζ
ENHANCEMENT = (np.log(2.5), 0.7)  # of ln γ
HIGHEST_LEVEL = 500.0  # ln of a power that a step too far may try: what floats hold [nats]
BACKGROUND_STD = 10.0  # of the ln of the background's power: hardly known [-]
STEP = 1e-7  # of the ln of a model's frequency and form, for its derivatives [-]
ENHANCEMENTS = np.array([1.2, 4.0, 7.0])  # γ that fits begin with: of wind seas and of swell


@dataclass(frozen=True, slots=True)
class WithoutHumps:
    """The modes of a window but those whose lines are a sea's."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]
    warnings: tuple[QualityWarning, ...]
    """Of modes that may be the sea's."""


def is_candidate(mode: Mode, duration: float) -> bool:
    """Whether a mode is as slow and as wide as a sea's hump. duration: T of the window [s]"""
    width = mode.half_bandwidth * duration
    return SLOWEST <= mode.frequency <= FASTEST and width >= NARROWEST


def without_sea_humps(
    modes: Sequence[Mode],
    samples: FloatArray,
    sampling_rate: float,
    integrations: IntArray | None = None,
) -> WithoutHumps:
    """The modes; what a sea's spectrum explains better than a resonance is refused, and what it
    explains about as well has a warning.

    Parameters
    ----------
    modes : sequence of Mode
        Lowest frequency first.
    samples : ndarray, shape (n, n_channels)
        Free of offset.
    sampling_rate : float
        [Hz]
    integrations : ndarray, shape (n_channels,), optional
        How often each channel's acceleration is integrated.
    """
    if not any(is_candidate(mode, len(samples) / sampling_rate) for mode in modes):
        return WithoutHumps(tuple(modes), (), ())
    spectrum = WindowSpectrum(samples, sampling_rate, integrations)
    kept: list[Mode] = []
    refused: list[RefusedMode] = []
    warnings: list[QualityWarning] = []
    for mode in modes:
        evidence = sea_evidence(mode, [each for each in modes if each is not mode], spectrum)
        if evidence is not None and evidence > SURE:
            refused.append(_hump(mode, evidence))
            continue
        kept.append(mode)
        if evidence is not None and evidence > POSSIBLE:
            warnings.append(_perhaps(mode))
    return WithoutHumps(tuple(kept), tuple(refused), tuple(warnings))


def _hump(mode: Mode, evidence: float) -> RefusedMode:
    return mode.refused(
        "sea",
        f"the spectrum of a sea explains its lines better than a resonance does (by {evidence:.2g} "
        "nats): waves, and no mode",
    )


def _perhaps(mode: Mode) -> QualityWarning:
    return QualityWarning(
        "sea",
        f"the mode at {mode.frequency:.3g} Hz may be the sea's spectrum: its lines do not tell "
        "waves from a resonance",
    )


def sea_evidence(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> float | None:
    """ln of how much likelier a sea's spectrum makes the lines around a mode than a resonance.

    None where the lines are too few, or the mode is no candidate: too fast, too slow or too sharp.

    Parameters
    ----------
    mode : Mode
    others : sequence of Mode
        All other modes of the window.
    spectrum : WindowSpectrum
    """
    T = spectrum.duration
    if not is_candidate(mode, T):
        return None
    low, high = LOW * mode.frequency, HIGH * mode.frequency
    apart = [each for each in others if abs(each.frequency - mode.frequency) > _clear(each, T)]
    for each in apart:
        if mode.frequency < each.frequency:
            high = min(high, each.frequency - _clear(each, T))
        else:
            low = max(low, each.frequency + _clear(each, T))
    band = spectrum.band(low, high)
    if low > LOWER_FLANK * mode.frequency or len(band.numbers) < FEWEST_LINES_OF_HUMP:
        return None
    shape = mode.shape / band.accelerations(mode.frequency)
    row = shape / (shape @ shape)
    powers = np.asarray((row @ band.matrices @ row).real)
    relative = band.numbers / (mode.frequency * T)
    flanks = np.zeros(len(relative))
    for each in apart:
        far = relative * mode.frequency / each.frequency
        flanks += far**4 * _resonance(far, 0.0, np.log(each.damping_ratio))
    start = np.log(max(mode.damping_ratio, 0.02))
    resonance = _least_cost(
        _resonance, powers, relative, flanks, (start,), prior=(DAMPING, MODAL_COLOUR)
    )
    sea = _least_cost(
        _sea, powers, relative, flanks, np.log(ENHANCEMENTS), prior=(ENHANCEMENT, SEA_COLOUR)
    )
    return resonance - sea


def _clear(mode: Mode, duration: float) -> float:
    """Where the lines of a mode begin to be another one's [Hz]. duration: T of the window [s]"""
    return CLEAR_WIDTHS * mode.damping_ratio * mode.frequency + CLEAR_LINES / duration


def _resonance(relative: FloatArray, place: float, log_damping: float) -> FloatArray:
    """Power of displacements under a white force, any scale."""
    r = relative * np.exp(-place)
    return np.asarray(1 / ((1 - r**2) ** 2 + (2 * np.exp(log_damping) * r) ** 2))


def _sea(relative: FloatArray, place: float, log_enhancement: float) -> FloatArray:
    """JONSWAP's spectrum, any scale."""
    return jonswap(
        relative,
        peak_frequency=float(np.exp(place)),
        peak_enhancement=float(np.exp(log_enhancement)),
    )


def _least_cost(
    model: Callable[[FloatArray, float, float], FloatArray],
    powers: FloatArray,
    relative: FloatArray,
    flanks: FloatArray,
    starts: Sequence[float] | FloatArray,
    *,
    prior: tuple[tuple[float, float], tuple[float, float]],
) -> float:
    """Least −ln p of the lines, and of what is known beforehand, over a model's parameters.

    The cost has several minima where a hump stands on the flank of other modes: a start at one
    colour may end beside the hump, with the background in its place.
    """
    from scipy.optimize import minimize  # slow to load, and few records show a hump

    (mean, std), (colour, colour_std) = prior
    floor = float(np.quantile(powers, 0.1)) + 1e-12 * float(powers.max())
    beside = flanks / max(float(flanks.max()), 1e-300)
    slope = np.log(relative)

    def cost(x: FloatArray) -> tuple[float, FloatArray]:
        """The cost and its gradient."""
        level, place, form, c, background, flank = x
        free = level + c * slope
        scale = np.exp(np.minimum(free, HIGHEST_LEVEL))
        shape = model(relative, place, form)
        hump, flat, far = scale * shape, np.exp(background), np.exp(flank) * beside
        by_place = scale * (model(relative, place + STEP, form) - shape) / STEP
        by_form = scale * (model(relative, place, form + STEP) - shape) / STEP
        by_level = np.where(free < HIGHEST_LEVEL, hump, 0.0)
        moved = np.array(
            [by_level, by_place, by_form, slope * by_level, np.full(len(slope), flat), far]
        )
        expected = hump + flat + far
        off = np.array([0.0, place, form - mean, c - colour, background - np.log(floor), 0.0])
        weights = np.array(
            [0.0, 1 / PLACE_STD**2, 1 / std**2, 1 / colour_std**2, 1 / BACKGROUND_STD**2, 0.0]
        )
        lines = float(np.sum(np.log(expected) + powers / expected))
        gradient = moved @ ((1 - powers / expected) / expected) + weights * off
        return lines + 0.5 * float(weights @ off**2), gradient

    top = float(np.log(np.quantile(powers, 0.9)))
    best = np.inf
    for start, slant in product(starts, (colour, colour + colour_std)):
        at = float(np.log(model(np.ones(1), 0.0, float(start))[0]))
        x = np.array([top - at, 0.0, float(start), slant, np.log(floor), np.log(floor)])
        bounds = [
            (None, None),
            (-3 * PLACE_STD, 3 * PLACE_STD),
            (mean - 3 * std, mean + 3 * std),
            (-4, 8),
            (np.log(floor) - 8, top + 2),
            (np.log(floor) - 8, top + 4),
        ]
        best = min(best, float(minimize(cost, x, jac=True, method="L-BFGS-B", bounds=bounds).fun))
    return best
