"""Modes that the poles know vaguely, fitted to the lines of their resonance.

In much noise, of few channels and of heavily damped modes, a subspace method knows a mode three to
ten times worse than the samples allow, and refuses it or places it wrongly. The likelihood of its
lines (`fit.py`) knows it to about the attainable bound: with its neighbours (`neighbours.py`) where
it is reported, alone in a flat background where the poles refuse it. The model is believed only
where it leaves little to explain and its colour is one of a structure's response; otherwise the
mode stays as the poles have it. Its std holds for stationary loads: of a ring-down it would be too
small.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.fit import cost_of_background
from pipeline.oma.whittle.groups import Group, Suspect, band_of, modes_of_group
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import (
    AroundMode,
    around_mode,
    first_mode,
    half_bandwidth,
    left_near_first,
)
from pipeline.oma.whittle.spectral_peaks import KnownPeak, UnseenPeak, unseen_peaks

VAGUE = 1.5  # frequency std over the attainable bound from which the lines may know more [-]
SHARPER = 0.8  # std by the lines over that of the pole; what gains less stays [-]
NARROWEST, WIDEST = 3.0, 300.0  # half bandwidth [lines]: below, `close_modes`; above, the
# background of a band is no longer flat
RESONANCE_WIDTH = (
    1.5  # half bandwidth of a resonance by its lines; a steady harmonic has less [lines]
)
ALONE_WIDTHS, ALONE_LINES = 3.0, 3.0  # half bandwidths and lines to the next mode
NOTHING_LEFT = 6.0  # rise of ln p that a mode more may promise: of 59 fits of `structures` (seeds
# 76001 to 76060) the rms error fell from 2.5 to 1.3 attainable std, 95 % intervals held .95; with
# 10, of 73, to 1.45, held .92
LEAST_COLOUR, MOST_COLOUR = -3.0, 5.5  # displacements have −1, accelerations 3; beyond, a slope of
# the background
SAME_SHAPE = 0.8  # MAC of the shapes by the poles and by the lines
# √(var(pole) − var(lines)) that the two may differ by: the std of their difference where the lines
# know most (Hausman 1978, Econometrica 46); of 180 modes of `structures` (seeds 140001 to 140120)
# two differed by more, both were 6 and 9 attainable std wrong
SHIFTED = 3.5
POLES_SHARE = (
    0.3  # of the pole's std: of 64 modes of `records` (seeds 5021 to 5090) a 95 % interval
)
# of the lines alone held .88
LEFT_BY_NEIGHBOURS = 50.0  # rise of ln p that a mode more may promise near one fitted with others:
# of 145 such fits (`structures`, seeds 110001 to 110060) three left 21 to 42, all right; of a
# parked tower (seed 8500) those with a hidden partner left 85 to 265
NEAR_WIDTHS = 2.5  # half bandwidths within which another mode shares a resonance
ANOTHER = 2.5  # power over flank of a direction that belongs to another mode [-]
FLANK_WIDTHS = 5.0  # half bandwidths of a mode within which another of its shape is its flank
FLANK_SHAPE = 0.9  # MAC of these
STANDS_OUT = 5.0  # frequency std over the attainable bound of a resonance that stands out of its
# background: of 8 refused modes that the lines confirmed it was 1.2 to 4.6, of 8 flanks 3 to 9
FLANK_BEGINS = 3.0  # half bandwidths from a resonance
STEEPEST = 1.2  # ln of a channel's power beside a resonance, below it over above it: of 46 bands of
# a parked tower that no fit described nine in ten had more, of 108 that one did one in five
MOST_FAILURES = 2  # bands that the model does not describe, after which the window's modes stand
# too densely for any
CONFIRMED_SHARE = (
    0.3  # of the half bandwidth: what f and ζ of a refused mode beside others are known to
)
MOST_UNSEEN = 6  # peaks without a pole that are tried, the clearest first
MOST_UNSEEN_FAILURES = 3  # of them that are none, after which the others are flanks, too
EVIDENCE_OF_UNSEEN = 12.0  # for a mode that no pole shows, ln of the Bayes factor [nats]
VAGUEST_UNSEEN, UNSEEN_SHARE = 0.7, 0.5  # std of its shape's components; of the half bandwidth,
# what its f and ζ are known to
MOST_UNCONFIRMED = 4  # refused modes, the best known first, that the lines do not show either


@dataclass(frozen=True, slots=True, eq=False)
class Sharpened:
    """The modes of a window after those that the lines know better, and what stays refused."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]
    too_dense: bool = False
    """Whether modes stand too densely for the model of a band."""


def sharpened(
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
    doubtful: Sequence[tuple[Mode, RefusedMode]],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
) -> Sharpened:
    """The modes, those that are known vaguely by their lines.

    Parameters
    ----------
    modes : sequence of Mode
        That are reported.
    refused : sequence of RefusedMode
    doubtful : sequence of (Mode, RefusedMode)
        Modes that were refused because they are known too vaguely, each with its reason.
    spectrum : WindowSpectrum
    settings : OmaSettings
    """
    result, reasons = list(modes), list(refused)
    reported = [mode for mode in modes if not mode.pair_id and mode.n_block_columns]
    failures = 0
    for mode in sorted(reported, key=lambda each: -_over_bound(each, spectrum)):
        others = [each for each in result if each is not mode]
        if failures >= MOST_FAILURES or not _all_known(mode, others, spectrum):
            continue
        fitted = with_neighbours(mode, others, spectrum, settings)
        if fitted is None:
            failures += 1
        elif fitted.frequency_std < SHARPER * mode.frequency_std:
            gusty = _with_gusts(fitted, mode)
            result = [gusty if each is mode else each for each in result]
    too_dense, failures = failures >= MOST_FAILURES, 0
    for mode, reason in sorted(doubtful, key=lambda each: bandwidth_share(each[0])):
        if not any(reason is each for each in refused) or failures >= MOST_UNCONFIRMED:
            continue
        if _worth_a_fit(mode, result, spectrum):
            fitted = by_its_lines(mode, result, spectrum, settings)
        elif not too_dense and _all_known(mode, result, spectrum):
            fitted = with_neighbours(mode, result, spectrum, settings)
            if fitted is not None and bandwidth_share(fitted) > CONFIRMED_SHARE:
                fitted = None
        else:
            continue
        if fitted is None or not _stands_out(fitted, result, spectrum):
            failures += 1
        else:
            result.append(_with_gusts(fitted, mode))
            reasons = [each for each in reasons if each is not reason]
    found = tuple(sorted(result, key=lambda each: each.frequency))
    return Sharpened(found, tuple(reasons), too_dense)


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
        around = around_mode(start, [*result, *harmonics], spectrum)
        found = None if around is None else _by_evidence(around, settings)
        if found is not None and _stands_out(found, result, spectrum):
            result.append(found)
        else:
            failures += 1
    return sorted(result, key=lambda each: each.frequency)


def _by_evidence(around: AroundMode, settings: OmaSettings) -> Mode | None:
    """A mode that no pole shows, where the lines hold strong evidence of it and know it."""
    fit, without = around.fitted(), around.without_first()
    mode = first_mode(fit, around.band)
    n_lines = around.band.n_lines
    evidence = (
        cost_of_background(around.band) if without is None else without.bayes_cost(n_lines)
    ) - fit.bayes_cost(n_lines)
    width = mode.damping_ratio * mode.frequency * around.band.duration
    known = (
        fit.converged
        and evidence > EVIDENCE_OF_UNSEEN
        and width >= RESONANCE_WIDTH
        and mode.damping_ratio + mode.damping_ratio_std < settings.maximum_damping
        and mode.frequency_std < settings.maximum_frequency_std * mode.frequency
        and mode.shape_std.max() <= VAGUEST_UNSEEN
        and bandwidth_share(mode) <= UNSEEN_SHARE
        and LEAST_COLOUR <= fit.modes.colours[0] <= MOST_COLOUR
        and left_near_first(fit, around.band) <= LEFT_BY_NEIGHBOURS
    )
    return mode if known else None


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


def by_its_lines(
    mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum, settings: OmaSettings
) -> Mode | None:
    """The mode as the lines around it have it; None where they hold more than one, or where one
    mode in a flat background does not describe them.

    Parameters
    ----------
    mode : Mode
        As the poles have it.
    others : sequence of Mode
        That surround it.
    spectrum : WindowSpectrum
    settings : OmaSettings
    """
    around = [Suspect(each.frequency, each.damping_ratio) for each in others]
    found = modes_of_group(_place(mode), spectrum, around, settings, most_modes=1)
    if found is None or len(found.modes) != 1:
        return None
    (fitted,) = found.modes
    believed = (
        found.unexplained <= NOTHING_LEFT
        and LEAST_COLOUR <= found.colour <= MOST_COLOUR
        and _is_of_pole(fitted, mode, spectrum, settings)
    )
    return _of_pole(fitted, mode) if believed else None


def with_neighbours(
    mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum, settings: OmaSettings
) -> Mode | None:
    """The mode as the lines around it have it, fitted with its neighbours; None where that model
    does not describe them.

    Parameters
    ----------
    mode : Mode
        As the poles have it.
    others : sequence of Mode
        All that surround it.
    spectrum : WindowSpectrum
    settings : OmaSettings
    """
    around = around_mode(mode, others, spectrum)
    if around is None:
        return None
    fit = around.fitted()
    fitted = first_mode(fit, around.band)
    believed = (
        fit.converged
        and fitted.damping_ratio < settings.maximum_damping
        and fitted.frequency_std < settings.maximum_frequency_std * fitted.frequency
        and LEAST_COLOUR <= fit.modes.colours[0] <= MOST_COLOUR
        and _is_of_pole(fitted, mode, spectrum, settings)
        and left_near_first(fit, around.band) <= LEFT_BY_NEIGHBOURS
    )
    return _of_pole(fitted, mode) if believed else None


def _is_of_pole(fitted: Mode, pole: Mode, spectrum: WindowSpectrum, settings: OmaSettings) -> bool:
    """Whether a mode of the lines is a resonance, of a shape that is known, and that of a pole."""
    width = fitted.damping_ratio * fitted.frequency
    least = (1 - SHARPER**2) * pole.frequency_std**2
    spread = max(pole.frequency_std**2 - fitted.frequency_std**2, least)
    return bool(
        width * spectrum.duration >= RESONANCE_WIDTH
        and fitted.shape_std.max() <= settings.maximum_shape_std
        and abs(fitted.frequency - pole.frequency) <= SHIFTED * np.sqrt(spread)
        and _mac(fitted, pole) > SAME_SHAPE
    )


def _of_pole(fitted: Mode, pole: Mode) -> Mode:
    """A mode of the lines with what only poles know of it."""
    return replace(
        fitted,
        phase_collinearity=pole.phase_collinearity,
        presence=pole.presence,
        quality=pole.quality,
    )


def _with_gusts(fitted: Mode, pole: Mode) -> Mode:
    """The mode with a share of the pole's std of f and ζ added to its own: these come from the
    scatter over the window's blocks, which gusty loads widen, as they do the lines' unseen."""
    columns = np.zeros((len(fitted.covariance_factor), 2))
    columns[0, 0] = min(POLES_SHARE * pole.frequency_std, fitted.frequency_std)
    columns[1, 1] = min(POLES_SHARE * pole.damping_ratio_std, fitted.damping_ratio_std)
    factor = np.hstack([fitted.covariance_factor, columns])
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return replace(
        fitted,
        covariance_factor=factor,
        frequency_std=float(frequency_std),
        damping_ratio_std=float(damping_std),
    )


def _worth_a_fit(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode is known vaguely, and stands alone in a band that a fit can describe."""
    width = half_bandwidth(mode)
    if not _vague(mode, spectrum) or width * spectrum.duration > WIDEST:
        return False
    clear = ALONE_WIDTHS * width + ALONE_LINES / spectrum.duration
    alone = all(abs(each.frequency - mode.frequency) > clear for each in others)
    return alone and _flat_beside(mode, others, spectrum)


def _vague(mode: Mode, spectrum: WindowSpectrum) -> bool:
    """Whether a resonance that the lines show is known vaguely."""
    resolved = half_bandwidth(mode) * spectrum.duration >= NARROWEST
    return resolved and _over_bound(mode, spectrum) > VAGUE


def _all_known(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode is known vaguely, and no direction stands out at its resonance that belongs to
    no mode."""
    if not _vague(mode, spectrum):
        return False
    width = half_bandwidth(mode)
    powers = spectrum.powers_over_flank(mode.frequency, mode.frequency, width)
    near = sum(
        abs(each.frequency - mode.frequency) < NEAR_WIDTHS * max(width, half_bandwidth(each))
        for each in others
    )
    return int(np.sum(powers > ANOTHER)) <= 1 + near


def _flat_beside(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether every channel has about as much power below a resonance as above it."""
    group = _place(mode)
    around = [Suspect(each.frequency, each.damping_ratio) for each in others]
    band = band_of(group, spectrum, around)
    if band is None:
        return False
    width = FLANK_BEGINS * group.half_bandwidth * band.duration
    below = band.powers[band.numbers < group.low * band.duration - width]
    above = band.powers[band.numbers > group.high * band.duration + width]
    if not len(below) or not len(above):
        return True
    ratio = np.log(below.mean(axis=0) / above.mean(axis=0))
    return bool(np.abs(ratio).max() <= STEEPEST)


def _place(mode: Mode) -> Group:
    return Group(mode.frequency, mode.frequency, half_bandwidth(mode))


def _over_bound(mode: Mode, spectrum: WindowSpectrum) -> float:
    """Std of f over the attainable √(ζ/(2π f T)) f [-]"""
    cycles = 2 * np.pi * mode.frequency * spectrum.duration
    return float(mode.frequency_std / mode.frequency / np.sqrt(mode.damping_ratio / cycles))


def bandwidth_share(mode: Mode) -> float:
    """What f and ζ are known to, of the half bandwidth ζ f and ζ [-]"""
    relative_std = mode.frequency_std / mode.frequency
    return max(relative_std, mode.damping_ratio_std) / mode.damping_ratio


def _stands_out(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode of the lines explains what no other mode's flank does."""
    flank = any(_flank_of(mode, each) for each in others)
    return not flank and _over_bound(mode, spectrum) <= STANDS_OUT


def _flank_of(mode: Mode, other: Mode) -> bool:
    """Whether what is taken for a mode may be the flank of another one."""
    width = max(mode.damping_ratio * mode.frequency, other.damping_ratio * other.frequency)
    near = abs(mode.frequency - other.frequency) < FLANK_WIDTHS * width
    return near and _mac(mode, other) > FLANK_SHAPE


def _mac(one: Mode, other: Mode) -> float:
    return float(modal_assurance_criterion(one.shape[None], other.shape[None])[0, 0])
