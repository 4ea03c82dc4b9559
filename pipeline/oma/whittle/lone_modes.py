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
from dataclasses import dataclass, field, replace

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import mac
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.fit import WhittleFit
from pipeline.oma.whittle.groups import Group, Suspect, band_of, modes_of_group
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import (
    AroundMode,
    around_mode,
    bounded_half_bandwidth,
    first_mode,
    left_near_first,
    reach_of,
)
from pipeline.oma.whittle.unseen_modes import (
    LEAST_COLOUR,
    LEFT_BY_NEIGHBOURS,
    MOST_COLOUR,
    NEAR_WIDTHS,
    RESONANCE_WIDTH,
    bandwidth_share,
    hidden_beside,
    over_bound,
    stands_out,
)

VAGUE = 1.15  # frequency std over the attainable bound from which the lines may know more [-]
SHARPER = 0.9  # std by the lines over that of the pole; what gains less stays [-]; with 1.5 and .8
# the rms error of `structures` (seeds 160001 to 160060) was 1.38 attainable std, with these 1.25
NARROWEST, WIDEST = 3.0, 300.0  # half bandwidth [lines]: below, `close_modes`; above, the
# background of a band is no longer flat
ALONE_WIDTHS, ALONE_LINES = 3.0, 3.0  # half bandwidths and lines to the next mode
NOTHING_LEFT = 6.0  # rise of ln p that a mode more may promise: of 59 fits of `structures` (seeds
# 76001 to 76060) the rms error fell from 2.5 to 1.3 attainable std, 95 % intervals held .95; with
# 10, of 73, to 1.45, held .92
SAME_SHAPE = 0.8  # MAC of the shapes by the poles and by the lines
# √(var(pole) − var(lines)) that the two may differ by: the std of their difference where the lines
# know most (Hausman 1978, Econometrica 46); of 180 modes of `structures` (seeds 140001 to 140120)
# two differed by more, both were 6 and 9 attainable std wrong
SHIFTED = 3.5
SURELY_COMPLEX = (
    10.0  # |Im φ|² of a pole over the variance of its shape: beyond chance by far; of 57 poles
)
# of real shapes the most was 6, of 32 beside dampers or unequal clocks 13 had more [-]
POLES_SHARE = (
    0.3  # of the pole's std: of 64 modes of `records` (seeds 5021 to 5090) a 95 % interval
)
# of the lines alone held .88
ANOTHER = 2.5  # power over flank of a direction that belongs to another mode [-]
FLANK_BEGINS = 3.0  # half bandwidths from a resonance
STEEPEST = 1.2  # ln of a channel's power beside a resonance, below it over above it: of 46 bands of
# a parked tower that no fit described nine in ten had more, of 108 that one did one in five
MOST_FAILURES = 2  # bands that the model does not describe, after which modes stand too densely for
# any within one of them; after one more for any in the window, which takes 1.1 s of CPU then in the
# shipped record, without that limit 2.2
CONFIRMED_SHARE = (
    0.3  # of the half bandwidth: what f and ζ of a refused mode beside others are known to
)
UNFOUNDED_SHARE = 0.4  # of the half bandwidth: what f and ζ of a reported mode are known to, from
# which its lines are asked. Of 251 windows of four modes each (`close_modes`, seeds 60001 to 60085,
# 111001 to 111100, 185000 to 185024, 208000 to 208040) six reported one that is none, known to .52
# to .84, which the lines refuted by 14 to 38 nats; of the true modes one was known to .44, and the
# lines bore it out by 135; of `structures` (seeds 18900 to 18929) seven, by 38 to 350
SEEN_OVER_FLANK = 10.0  # power over flank of a peak that needs no fit: those six had 1.1 to 4.2,
# the seven 22 and more [-]
MOST_UNCONFIRMED = 4  # refused modes, the best known first, that the lines do not show either


@dataclass(frozen=True, slots=True)
class DenseBands:
    """Bands that the model does not describe."""

    bands: tuple[tuple[float, float], ...] = ()
    """Lowest and highest frequency of each [Hz]."""

    def holds(self, frequency: float) -> bool:
        """Whether modes stand too densely at a frequency [Hz] for the model of any band there.

        A pair in a sea or three blades' modes under one peak say nothing of a mode elsewhere; a
        third band says that the window is dense, and fits of all the others would take a second.
        """
        if len(self.bands) > MOST_FAILURES:
            return True
        several = len(self.bands) == MOST_FAILURES
        return several and any(low <= frequency <= high for low, high in self.bands)

    def with_band(self, band: tuple[float, float]) -> "DenseBands":
        """Return them and one more."""
        return DenseBands((*self.bands, band))


@dataclass(frozen=True, slots=True, eq=False)
class Sharpened:
    """The modes of a window after those that the lines know better, and what stays refused."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]
    too_dense: "DenseBands" = field(default_factory=lambda: DenseBands())
    """Where modes stand too densely for the model of a band."""
    unseen: tuple[RefusedMode, ...] = ()
    """What stands out of the lines, no pole shows, and is not believed; the clearest first."""


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
    result, dense = list(modes), DenseBands()
    found_hidden: list[Mode] = []
    reported = [mode for mode in modes if not mode.pair_id and mode.n_block_columns]
    for mode in sorted(reported, key=lambda each: -over_bound(each, spectrum)):
        others = [each for each in result if each is not mode]
        if dense.holds(mode.frequency) or not _all_known(mode, others, spectrum):
            continue
        if _has_phases(mode, spectrum):
            continue
        merged = any(_near(mode, each) for each in found_hidden)
        fitted, hidden = _with_hidden(mode, others, spectrum, settings, merged=merged)
        result += hidden
        found_hidden += hidden
        if fitted is None:
            dense = dense.with_band(reach_of(mode, spectrum.duration))
            better = _perhaps_merged(mode, found_hidden)
        elif hidden or merged or fitted.frequency_std < SHARPER * mode.frequency_std:
            better = _with_gusts(fitted, mode)
        else:
            continue
        result = [better if each is mode else each for each in result]
    doubted = [each for each in doubtful if any(each[1] is other for other in refused)]
    confirmed = _confirmed(doubted, result, spectrum, settings, dense)
    found = sorted([*result, *(mode for mode, _ in confirmed)], key=lambda each: each.frequency)
    reasons = [each for each in refused if not any(each is reason for _, reason in confirmed)]
    return Sharpened(tuple(found), tuple(reasons), dense)


def borne_out(
    modes: Sequence[Mode], refused: Sequence[RefusedMode], spectrum: WindowSpectrum
) -> Sharpened:
    """The modes less those, known vaguely, without which their lines are explained as well.

    Noise has poles, too: a few of them are stable, and alike in all orders and blocks.
    """
    result, reasons = list(modes), list(refused)
    for mode in sorted(modes, key=lambda each: -bandwidth_share(each)):
        if mode.pair_id or bandwidth_share(mode) <= UNFOUNDED_SHARE or _is_seen(mode, spectrum):
            continue
        others = [each for each in result if each is not mode]
        around = around_mode(mode, others, spectrum)
        if around is None:
            continue
        fit = around.fitted()
        if fit.converged and around.evidence_of_first(fit) < 0:
            result = others
            reasons.append(_unfounded(mode, around))
    return Sharpened(tuple(result), tuple(sorted(reasons, key=lambda each: each.frequency)))


def _is_seen(mode: Mode, spectrum: WindowSpectrum) -> bool:
    """Whether a peak stands so far out of the lines that no fit need say so."""
    powers = spectrum.powers_over_flank(
        mode.frequency, mode.frequency, bounded_half_bandwidth(mode)
    )
    return bool(len(powers) and powers[0] > SEEN_OVER_FLANK)


def _unfounded(mode: Mode, around: AroundMode) -> RefusedMode:
    by = "a flat background explains"
    if len(around.modes) > 1:
        by = "its neighbours and a flat background explain"
    return mode.refused("explained", f"{by} its lines as well")


def _with_hidden(
    mode: Mode,
    others: Sequence[Mode],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    merged: bool,
) -> tuple[Mode | None, list[Mode]]:
    """The mode as the lines around it have it, and what it hides or is merged with.

    merged   another mode was found to hide one near it
    """
    around = around_mode(mode, others, spectrum)
    if around is None:
        return None, []
    fit = around.fitted()
    fitted = _believed(mode, around, fit, spectrum, settings, merged=merged)
    hidden = hidden_beside(around, fit, others, spectrum, settings)
    if hidden is None:
        return fitted, []
    around = around_mode(mode, [*others, hidden], spectrum)
    if around is None:
        return None, [hidden]
    fit, merged = around.fitted(), merged or _near(mode, hidden)
    return _believed(mode, around, fit, spectrum, settings, merged=merged), [hidden]


def _has_phases(pole: Mode, spectrum: WindowSpectrum) -> bool:
    """Whether the channels surely have phases of their own, as beside a discrete damper.

    Shapes of the lines' model are real: the correlated forces of its neighbours, or a second mode
    beside it, take what is imaginary, and ζ moves. Of a shape that is nearly real (of the scaled
    channels) MPC is 1 − 4 |Im φ|²/|φ|², and the imaginary part is known as the real one is.
    """
    scales = spectrum.accelerations(pole.frequency)
    shape, std = pole.shape / scales, pole.shape_std / scales
    imaginary = 0.25 * (1 - pole.phase_collinearity) * float(shape @ shape)
    return imaginary > SURELY_COMPLEX * float(std @ std)


def _near(mode: Mode, hidden: Mode) -> bool:
    """Whether the poles of a mode may be those of another one, too."""
    return abs(mode.frequency - hidden.frequency) < NEAR_WIDTHS * bounded_half_bandwidth(mode)


def _confirmed(
    doubtful: Sequence[tuple[Mode, RefusedMode]],
    modes: Sequence[Mode],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    dense: DenseBands,
) -> list[tuple[Mode, RefusedMode]]:
    """Refused modes that the lines confirm, each with its reason."""
    confirmed: list[tuple[Mode, RefusedMode]] = []
    failures = 0
    for mode, reason in sorted(doubtful, key=lambda each: bandwidth_share(each[0])):
        if failures >= MOST_UNCONFIRMED:
            break
        known = [*modes, *(each for each, _ in confirmed)]
        if _worth_a_fit(mode, known, spectrum):
            fitted = by_its_lines(mode, known, spectrum, settings)
        elif not dense.holds(mode.frequency) and _all_known(mode, known, spectrum):
            fitted = with_neighbours(mode, known, spectrum, settings)
            if fitted is not None and bandwidth_share(fitted) > CONFIRMED_SHARE:
                fitted = None
        else:
            continue
        if fitted is None or not stands_out(fitted, known, spectrum):
            failures += 1
        else:
            confirmed.append((_with_gusts(fitted, mode), reason))
    return confirmed


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
    return _believed(mode, around, around.fitted(), spectrum, settings)


def _believed(
    mode: Mode,
    around: AroundMode,
    fit: WhittleFit,
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    merged: bool = False,
) -> Mode | None:
    """The first mode of a fit, where it describes the lines and is that of the pole.

    merged   the pole may stand between it and another mode
    """
    fitted = first_mode(fit, around.band)
    believed = (
        fit.converged
        and fitted.damping_ratio < settings.maximum_damping
        and fitted.frequency_std < settings.maximum_frequency_std * fitted.frequency
        and LEAST_COLOUR <= fit.modes.colours[0] <= MOST_COLOUR
        and _is_of_pole(fitted, mode, spectrum, settings, merged=merged)
        and left_near_first(fit, around.band) <= LEFT_BY_NEIGHBOURS
    )
    return _of_pole(fitted, mode) if believed else None


def _is_of_pole(
    fitted: Mode,
    pole: Mode,
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    merged: bool = False,
) -> bool:
    """Whether a mode of the lines is a resonance, of a shape that is known, and that of a pole.

    A fit that widens a resonance beyond what the pole knows of ζ explains something else with it.
    """
    width = fitted.half_bandwidth
    shift = SHIFTED * _std_of_difference(pole.frequency_std, fitted.frequency_std)
    wider = SHIFTED * _std_of_difference(pole.damping_ratio_std, fitted.damping_ratio_std)
    if merged:
        shift, wider = NEAR_WIDTHS * bounded_half_bandwidth(pole), np.inf
    return bool(
        width * spectrum.duration >= RESONANCE_WIDTH
        and fitted.shape_std.max() <= settings.maximum_shape_std
        and abs(fitted.frequency - pole.frequency) <= shift
        and fitted.damping_ratio - pole.damping_ratio <= wider
        and mac(fitted.shape, pole.shape) > SAME_SHAPE
    )


def _std_of_difference(by_pole: float, by_lines: float) -> float:
    """√(var(pole) − var(lines)), no less than where the lines are hardly sharper."""
    least = (1 - SHARPER**2) * by_pole**2
    return float(np.sqrt(max(by_pole**2 - by_lines**2, least)))


def _of_pole(fitted: Mode, pole: Mode) -> Mode:
    """A mode of the lines with what only poles know of it."""
    return replace(
        fitted,
        phase_collinearity=pole.phase_collinearity,
        presence=pole.presence,
        quality=pole.quality,
    )


def _perhaps_merged(mode: Mode, hidden: Sequence[Mode]) -> Mode:
    """The mode with half the distance to what it may hide added to its std: where no fit parts the
    two, its poles may stand between them."""
    distances = [each.frequency - mode.frequency for each in hidden if _near(mode, each)]
    if not distances:
        return mode
    return mode.with_frequency_spread(max(distances, key=abs) / 2)


def _with_gusts(fitted: Mode, pole: Mode) -> Mode:
    """The mode with a share of the pole's std of f and ζ added to its own: these come from the
    scatter over the window's blocks, which gusty loads widen, as they do the lines' unseen."""
    columns = np.zeros((len(fitted.covariance_factor), 2))
    columns[0, 0] = min(POLES_SHARE * pole.frequency_std, fitted.frequency_std)
    columns[1, 1] = min(POLES_SHARE * pole.damping_ratio_std, fitted.damping_ratio_std)
    return fitted.with_factor(np.hstack([fitted.covariance_factor, columns]))


def _worth_a_fit(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode is known vaguely, and stands alone in a band that a fit can describe."""
    width = bounded_half_bandwidth(mode)
    if not _vague(mode, spectrum) or width * spectrum.duration > WIDEST:
        return False
    clear = ALONE_WIDTHS * width + ALONE_LINES / spectrum.duration
    alone = all(abs(each.frequency - mode.frequency) > clear for each in others)
    return alone and _flat_beside(mode, others, spectrum)


def _vague(mode: Mode, spectrum: WindowSpectrum) -> bool:
    """Whether a resonance that the lines show is known vaguely."""
    resolved = bounded_half_bandwidth(mode) * spectrum.duration >= NARROWEST
    return resolved and over_bound(mode, spectrum) > VAGUE


def _all_known(mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether a mode is known vaguely, and no direction stands out at its resonance that belongs to
    no mode."""
    if not _vague(mode, spectrum):
        return False
    width = bounded_half_bandwidth(mode)
    powers = spectrum.powers_over_flank(mode.frequency, mode.frequency, width)
    near = sum(
        abs(each.frequency - mode.frequency)
        < NEAR_WIDTHS * max(width, bounded_half_bandwidth(each))
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
    return Group(mode.frequency, mode.frequency, bounded_half_bandwidth(mode))
