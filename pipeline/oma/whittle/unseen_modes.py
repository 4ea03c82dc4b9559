"""Modes that no pole shows: what stands out of the lines, or beside a mode that hides it.

Each is fitted with what surrounds it and believed where the lines hold strong evidence of it, know
it, and leave next to nothing to explain.
"""

from collections.abc import Sequence

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.fit import WhittleFit, modes_of_fit
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import (
    AroundMode,
    around_mode,
    first_mode,
    half_bandwidth,
    hidden_by_first,
    left_near_first,
)
from pipeline.oma.whittle.spectral_peaks import KnownPeak, UnseenPeak, unseen_peaks

RESONANCE_WIDTH = (
    1.5  # half bandwidth of a resonance by its lines; a steady harmonic has less [lines]
)
LEAST_COLOUR, MOST_COLOUR = -3.0, 5.5  # displacements have −1, accelerations 3; beyond, a slope of
# the background
LEFT_BY_NEIGHBOURS = 50.0  # rise of ln p that a mode more may promise near one fitted with others:
# of 145 such fits (`structures`, seeds 110001 to 110060) three left 21 to 42, all right; of a
# parked tower (seed 8500) those with a hidden partner left 85 to 265
LEFT_BY_HIDDEN = 15.0  # that makes one more worth a fit: `EVIDENCE_OF_UNSEEN` and a margin
MOST_OFF_WIDTH = 2.0  # of a half bandwidth over that which a fit's bins and band are made for [-]
NEAR_WIDTHS = 2.5  # half bandwidths within which another mode shares a resonance
FLANK_WIDTHS = 5.0  # half bandwidths of a mode within which another of its shape is its flank
FLANK_SHAPE = 0.9  # MAC of these
STANDS_OUT = 5.0  # frequency std over the attainable bound of a resonance that stands out of its
# background: of 8 refused modes that the lines confirmed it was 1.2 to 4.6, of 8 flanks 3 to 9
MOST_UNSEEN = 6  # peaks without a pole that are tried, the clearest first
MOST_UNSEEN_FAILURES = 3  # of them that are none, after which the others are flanks, too
EVIDENCE_OF_UNSEEN = 12.0  # for a mode that no pole shows, ln of the Bayes factor [nats]
VAGUEST_UNSEEN, UNSEEN_SHARE = 0.7, 0.5  # std of its shape's components; of the half bandwidth,
# what its f and ζ are known to


def with_unseen(
    modes: Sequence[Mode],
    harmonics: Sequence[Mode],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    reach: tuple[float, float],
) -> list[Mode]:
    """The modes, and those that stand out of the lines where no pole shows one.

    Parameters
    ----------
    modes : sequence of Mode
        That are reported.
    harmonics : sequence of Mode
        Of machines, whose peaks are no modes.
    spectrum : WindowSpectrum
    settings : OmaSettings
    reach : (float, float)
        Lowest and highest frequency at which they are sought [Hz].
    """
    result = list(modes)
    known = [_known_peak(each, spectrum) for each in (*modes, *harmonics)]
    failures = 0
    for peak in unseen_peaks(spectrum, known, *reach)[:MOST_UNSEEN]:
        if failures >= MOST_UNSEEN_FAILURES:
            break
        start = _at_peak(peak, spectrum)
        found = _believed(start, [*result, *harmonics], spectrum, settings)
        if found and stands_out(found[0], result, spectrum):
            result.append(found[0])
        else:
            failures += 1
    return sorted(result, key=lambda each: each.frequency)


def _believed(
    start: Mode, others: Sequence[Mode], spectrum: WindowSpectrum, settings: OmaSettings
) -> list[Mode]:
    """A mode that no pole shows and its neighbours, in the lines that its own width asks for.

    A peak may be sought ten times as wide as the mode behind it: the bins of its band are then too
    coarse for the resonance, and the band reaches over whatever lies there.
    """
    around = around_mode(start, others, spectrum)
    found = [] if around is None else _by_evidence(around, settings)
    if not found or _as_wide(found[0], start):
        return found
    around = around_mode(found[0], others, spectrum)
    return [] if around is None else _by_evidence(around, settings)


def _as_wide(mode: Mode, start: Mode) -> bool:
    """Whether the band of what a fit begins with is about that of what it ends with."""
    ratio = half_bandwidth(mode) / half_bandwidth(start)
    return 1 / MOST_OFF_WIDTH <= ratio <= MOST_OFF_WIDTH


def _by_evidence(around: AroundMode, settings: OmaSettings) -> list[Mode]:
    """A mode that no pole shows and its neighbours as one fit has them; none where the lines hold
    no strong evidence of it or do not know it."""
    fit = around.fitted()
    modes = modes_of_fit(fit, around.band)
    mode = modes[0]
    width = mode.damping_ratio * mode.frequency * around.band.duration
    known = (
        fit.converged
        and width >= RESONANCE_WIDTH
        and mode.damping_ratio + mode.damping_ratio_std < settings.maximum_damping
        and mode.frequency_std < settings.maximum_frequency_std * mode.frequency
        and mode.shape_std.max() <= VAGUEST_UNSEEN
        and bandwidth_share(mode) <= UNSEEN_SHARE
        and LEAST_COLOUR <= fit.modes.colours[0] <= MOST_COLOUR
        and left_near_first(fit, around.band) <= LEFT_BY_NEIGHBOURS
    )
    return modes if known and around.evidence_of_first(fit) > EVIDENCE_OF_UNSEEN else []


def _known_peak(mode: Mode, spectrum: WindowSpectrum) -> KnownPeak:
    scales = spectrum.accelerations(mode.frequency)
    return KnownPeak(mode.frequency, half_bandwidth(mode), mode.shape / scales)


def _at_peak(peak: UnseenPeak, spectrum: WindowSpectrum) -> Mode:
    """A mode for a fit to begin with; nothing is known of it."""
    shape = peak.shape * spectrum.accelerations(peak.frequency)
    return Mode(
        name="",
        frequency=peak.frequency,
        frequency_std=peak.half_bandwidth,
        damping_ratio=peak.half_bandwidth / peak.frequency,
        damping_ratio_std=0.0,
        shape=shape / shape[np.argmax(np.abs(shape))],
        covariance_factor=np.zeros((2 + len(shape), 1)),
        n_block_columns=0,
    )


def hidden_beside(
    of_mode: AroundMode,
    fit: WhittleFit,
    others: Sequence[Mode],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
) -> Mode | None:
    """A mode that the poles merge with another one, or that it hides; None where there is none.

    Parameters
    ----------
    of_mode : AroundMode
        The other one, its neighbours and their lines.
    fit : WhittleFit
        Of these.
    others : sequence of Mode
        All that surround it.
    spectrum : WindowSpectrum
    settings : OmaSettings
    """
    if left_near_first(fit, of_mode.band) <= LEFT_BY_HIDDEN:
        return None
    known = [first_mode(fit, of_mode.band), *others]
    found = _believed(hidden_by_first(of_mode, fit), known, spectrum, settings)
    if not found or over_bound(found[0], spectrum) > STANDS_OUT:
        return None
    return None if any(_shares_resonance(found[0], each) for each in found[1:]) else found[0]


def _shares_resonance(mode: Mode, other: Mode) -> bool:
    """Whether two of nearly one shape lie within each other's resonance."""
    width = max(mode.damping_ratio * mode.frequency, other.damping_ratio * other.frequency)
    near = abs(mode.frequency - other.frequency) < NEAR_WIDTHS * width
    return near and mac(mode, other) > FLANK_SHAPE


def over_bound(mode: Mode, spectrum: WindowSpectrum) -> float:
    """Std of f over the attainable √(ζ/(2π f T)) f [-]"""
    cycles = 2 * np.pi * mode.frequency * spectrum.duration
    return float(mode.frequency_std / mode.frequency / np.sqrt(mode.damping_ratio / cycles))


def bandwidth_share(mode: Mode) -> float:
    """What f and ζ are known to, of the half bandwidth ζ f and ζ [-]"""
    relative_std = mode.frequency_std / mode.frequency
    return max(relative_std, mode.damping_ratio_std) / mode.damping_ratio


def stands_out(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode of the lines explains what no other mode's flank does."""
    flank = any(_flank_of(mode, each) for each in others)
    return not flank and over_bound(mode, spectrum) <= STANDS_OUT


def _flank_of(mode: Mode, other: Mode) -> bool:
    """Whether what is taken for a mode may be the flank of another one."""
    width = max(mode.damping_ratio * mode.frequency, other.damping_ratio * other.frequency)
    near = abs(mode.frequency - other.frequency) < FLANK_WIDTHS * width
    return near and mac(mode, other) > FLANK_SHAPE


def mac(one: Mode, other: Mode) -> float:
    """Modal assurance criterion of two modes [-]"""
    return float(modal_assurance_criterion(one.shape[None], other.shape[None])[0, 0])
