"""Modes that the poles know vaguely, fitted to the lines of their own resonance.

In much noise, and of few channels, a subspace method knows a mode three to ten times worse than
the samples allow, and refuses it or places it wrongly. Where the mode stands alone, the likelihood
of its lines (`fit.py`) knows it to about the attainable bound. The model is one mode in a flat
background; it is believed only where it leaves nothing to explain and its colour is one of a
structure's response, so that a mode beside others, on a steep sea or on a neighbour's flank stays
as the poles have it. Its std holds for stationary loads: of a ring-down it would be too small.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.groups import Group, Suspect, band_of, modes_of_group
from pipeline.oma.whittle.narrow_band import WindowSpectrum

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
LEAST_COLOUR, MOST_COLOUR = -4.0, 6.0  # displacements have −1, accelerations 3; beyond, a slope of
# the background
SAME_SHAPE = 0.8  # MAC of the shapes by the poles and by the lines
SHIFTED = 5.0  # std of the pole that the lines may differ by
POLES_SHARE = (
    0.3  # of the pole's std: of 64 modes of `records` (seeds 5021 to 5090) a 95 % interval
)
# of the lines alone held .88
FLANK_WIDTHS = 5.0  # half bandwidths of a mode within which another of its shape is its flank
FLANK_SHAPE = 0.9  # MAC of these
STANDS_OUT = 5.0  # frequency std over the attainable bound of a resonance that stands out of its
# background: of 8 refused modes that the lines confirmed it was 1.2 to 4.6, of 8 flanks 3 to 9
FLANK_BEGINS = 3.0  # half bandwidths from a resonance
STEEPEST = 1.2  # ln of a channel's power beside a resonance, below it over above it: of 46 bands of
# a parked tower that no fit described nine in ten had more, of 108 that one did one in five
MOST_FAILURES = 4  # bands that the model does not describe, after which the window's modes stand
# too densely for any
MOST_UNCONFIRMED = 4  # refused modes, the best known first, that the lines do not show either


@dataclass(frozen=True, slots=True, eq=False)
class Sharpened:
    """The modes of a window after those that the lines know better, and what stays refused."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]


def sharpened(
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
    doubtful: Sequence[tuple[Mode, RefusedMode]],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
) -> Sharpened:
    """The modes, those that stand alone and are known vaguely by their lines.

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
        if failures >= MOST_FAILURES or not _worth_a_fit(mode, others, spectrum):
            continue
        fitted = by_its_lines(mode, others, spectrum, settings)
        if fitted is None:
            failures += 1
        elif fitted.frequency_std < SHARPER * mode.frequency_std:
            gusty = _with_gusts(fitted, mode)
            result = [gusty if each is mode else each for each in result]
    failures = 0
    for mode, reason in sorted(doubtful, key=lambda each: bandwidth_share(each[0])):
        if not any(reason is each for each in refused):
            continue
        if failures >= MOST_UNCONFIRMED or not _worth_a_fit(mode, result, spectrum):
            continue
        fitted = by_its_lines(mode, result, spectrum, settings)
        if fitted is None or not _stands_out(fitted, result, spectrum):
            failures += 1
        else:
            result.append(_with_gusts(fitted, mode))
            reasons = [each for each in reasons if each is not reason]
    return Sharpened(tuple(sorted(result, key=lambda each: each.frequency)), tuple(reasons))


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
    width = fitted.damping_ratio * fitted.frequency
    allowed = max(SHIFTED * mode.frequency_std, width)
    believed = (
        width * spectrum.duration >= RESONANCE_WIDTH
        and found.unexplained <= NOTHING_LEFT
        and LEAST_COLOUR <= found.colour <= MOST_COLOUR
        and fitted.shape_std.max() <= settings.maximum_shape_std
        and abs(fitted.frequency - mode.frequency) <= allowed
        and _mac(fitted, mode) > SAME_SHAPE
    )
    if not believed:
        return None
    return replace(
        fitted,
        phase_collinearity=mode.phase_collinearity,
        presence=mode.presence,
        quality=mode.quality,
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
    width = _half_bandwidth(mode)
    if not NARROWEST <= width * spectrum.duration <= WIDEST:
        return False
    clear = ALONE_WIDTHS * width + ALONE_LINES / spectrum.duration
    alone = all(abs(each.frequency - mode.frequency) > clear for each in others)
    vague = _over_bound(mode, spectrum) > VAGUE
    return vague and alone and _flat_beside(mode, others, spectrum)


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
    return Group(mode.frequency, mode.frequency, _half_bandwidth(mode))


def _half_bandwidth(mode: Mode) -> float:
    """ζ f; of a mode whose damping is hardly known, no less than half its std makes it [Hz]."""
    return max(mode.damping_ratio, 0.5 * mode.damping_ratio_std) * mode.frequency


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
