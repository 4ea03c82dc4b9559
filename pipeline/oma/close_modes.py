"""Modes of a window where poles are not enough: decided by the evidence of the Fourier lines.

    modes of the poles ─┬─ resolved, alone ──────────────────────────────► as they are
    refused mixtures   ─┤
    peaks without poles ┤
    coincident modes   ─┴─ groups of suspects ─► one, two, three modes? ─► by evidence

A mode that is reported explains what the others do not: of two poles that a group's lines do not
resolve, one is left, and of poles whose lines a flat background explains as well, none.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import mac
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.bands import is_asked_for
from pipeline.oma.ssi.coincident_modes import CoincidentModes
from pipeline.oma.whittle.groups import Group, GroupModes, Suspect, grouped, modes_of_group
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import around_mode, first_mode
from pipeline.oma.whittle.pair_axes import with_leading_pole
from pipeline.oma.whittle.unseen_modes import PEAK_HALF_WIDTH, lone_peaks, peaks_of_two

UNRESOLVED = 3.0  # ζ f T below which the window does not resolve the mode's own resonance [-]
HIDDEN = 4.0  # second power over flank of a mode that hides another: of 30 single modes none had
# more than 2.2, of 60 pairs .5 to 2 % apart none less than 10
MIXED_SHAPES = (
    0.6  # correlation of two modes' forces beyond which their shapes are doubtful mixtures [-]
)
MOST_UNLIKE = 2.5  # ratio of half bandwidths of two modes of a resolved group [-]
VAGUEST_SHAPE = 1.2  # std of a component of a shape that overlapping modes leave [-]
ALIKE_SHAPES = 0.8  # MAC of one mode's shapes by poles and by lines [-]
LEAST_ALIKE = 0.6  # MAC of one mode's shapes without and with its neighbours [-]
FARTHEST_PULL = 2.0  # half bandwidths by which neighbours' flanks pull a mode at most
TINTED = 3.0  # colour of a band whose background moves with its modes: the model does not hold. Of
# 41 groups that it described it was −1.7 to 1.5, of two that it did not −3.7 and −3.8 [-]
UNEXPLAINED = 12.0  # rise of ln p that a mode more would promise: a band holds more than its
# model; of 17 groups of simulated pairs none left more than 5
WIDEST_GROUP = (
    30.0  # ζ f T above which poles have data enough, and a band would hold many modes [-]
)


FALLBACK_DAMPING = 0.01  # ζ that the fit of a peak without poles begins with [-]


@dataclass(frozen=True, slots=True, eq=False)
class ResolvedModes:
    """The modes of a window, and what was refused."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    refused: tuple[RefusedMode, ...]


def resolved_by_evidence(
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
    coincident: Sequence[CoincidentModes],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    harmonics: Sequence[Mode] = (),
) -> ResolvedModes:
    """The modes of the poles, with those of every group of suspects as the evidence has them.

    Parameters
    ----------
    modes : sequence of Mode
        Of all bands, each once.
    refused : sequence of RefusedMode
        With the reasons; a mixture of neighbours makes a suspect.
    coincident : sequence of CoincidentModes
        Places where two poles stand side by side in most orders; each makes a suspect.
    spectrum : WindowSpectrum
        Fourier lines of the window.
    settings : OmaSettings
        Limits that a mode of the lines has to keep as well.
    harmonics : sequence of Mode, optional
        Of machines, whose peaks hide no pair.

    Returns
    -------
    ResolvedModes
        Modes and refused modes after the evidence.
    """
    duration = spectrum.duration
    suspects = _suspects(modes, refused, coincident, spectrum, settings, harmonics)
    known = [Suspect(mode.frequency, mode.damping_ratio) for mode in modes]
    result, reasons = list(modes), list(refused)
    for group in grouped(suspects, duration):
        inside = [mode for mode in modes if group.holds(mode.frequency, duration)]
        others = [each for each in known if not group.holds(each.frequency, duration)]
        if _poles_suffice(group, inside, spectrum):
            continue
        found = modes_of_group(group, spectrum, others, settings)
        if found is None:
            continue
        if not found.modes:
            if found.flat and group.half_bandwidth * duration < UNRESOLVED:
                result = [mode for mode in result if not any(mode is each for each in inside)]
                reasons += [_no_peak(mode) for mode in inside]
            continue
        kept: Sequence[Mode] = found.modes
        if spectrum.is_whole(group.low, group.high, group.half_bandwidth):
            kept = with_leading_pole(kept, inside, found.weaker_share, duration)
        if group.half_bandwidth * duration >= UNRESOLVED:
            kept = _without_broken_pairs([e for e in kept if _believable(e, group)])
            alike = any(group.holds(each.frequency, duration) for each in coincident)
            if alike and any(each.pair_id for each in kept):
                continue
            if len(kept) <= len(inside) or not _holds(found):
                continue
            kept = [
                each if each.pair_id else next((m for m in inside if _same(m, each)), each)
                for each in kept
            ]
        else:
            kept = [
                e
                for e in kept
                if e.pair_id
                or _bears_out(e, inside)
                or _plausible_addition(e, group, spectrum, settings)
            ]
        if not kept:  # nothing that the lines suggest is sure: the poles stay
            reasons += _not_borne_out(found.modes, inside, group)
            continue
        result = [mode for mode in result if not any(mode is old for old in inside)]
        result += kept
        reasons = [
            each
            for each in reasons
            if not (each.code == "mixture" and group.holds(each.frequency, duration))
        ]
        reasons += _left_out(inside, kept, group)
        reasons += _not_borne_out(found.modes, [*kept, *inside], group)
    return ResolvedModes(
        tuple(sorted(beside_flanks(result, spectrum, settings), key=lambda m: m.frequency)),
        tuple(sorted(reasons, key=lambda each: each.frequency)),
    )


def beside_flanks(
    modes: Sequence[Mode], spectrum: WindowSpectrum, settings: OmaSettings
) -> list[Mode]:
    """The modes; those that the lines of a resolved group gave fitted again with all neighbours.

    Parameters
    ----------
    modes : sequence of Mode
        Of the poles and of the lines; only those of the lines are fitted again.
    spectrum : WindowSpectrum
        Fourier lines of the window.
    settings : OmaSettings
        Limits that decide whether the new fit replaces the mode.

    Notes
    -----
    The band of a group ends short of its neighbours, whose flanks it takes for a flat background.
    Of a neighbour of much the same shape these pull a mode towards it: of 36 windows of a parked
    tower (seeds 141101 to 141106) seven of 22 such modes lay 3.3 to 11 std off; after, one did (4.4
    std), whose shape is a mixture.
    """
    result = list(modes)
    for mode in modes:
        width = mode.half_bandwidth
        if mode.pair_id or mode.n_block_columns or width * spectrum.duration < UNRESOLVED:
            continue
        others = [each for each in result if each is not mode]
        around = around_mode(mode, others, spectrum)
        if around is None or len(around.modes) < 2:
            continue
        fit = around.fitted()
        fitted = first_mode(fit, around.band)
        if not fit.off_colour and _is_refined(fitted, mode, settings):
            result = [*others, fitted]
    return result


def _is_refined(fitted: Mode, mode: Mode, settings: OmaSettings) -> bool:
    """Whether a second fit is of the same mode, and knows it."""
    return bool(
        abs(fitted.frequency - mode.frequency)
        <= FARTHEST_PULL * mode.damping_ratio * mode.frequency
        and mac(fitted.shape, mode.shape) > LEAST_ALIKE
        and fitted.damping_ratio < settings.maximum_damping
        and fitted.shape_std.max() <= settings.maximum_shape_std
        and fitted.frequency_std < settings.maximum_frequency_std * fitted.frequency
    )


def with_lone_modes(
    resolved: ResolvedModes,
    vague_shapes: Sequence[tuple[Mode, RefusedMode]],
    spectrum: WindowSpectrum,
) -> ResolvedModes:
    """The modes, and those refused as mixtures where one direction alone stands out of the lines.

    Parameters
    ----------
    resolved : ResolvedModes
        Modes and refused modes so far.
    vague_shapes : sequence of (Mode, RefusedMode)
        Modes whose f and ζ are sure, each with the reason why it is refused.
    spectrum : WindowSpectrum
        Fourier lines of the window.

    Returns
    -------
    ResolvedModes
        With the modes of one direction among the modes, sorted by frequency, and no longer refused.
    """
    lone = [
        (mode, reason)
        for mode, reason in vague_shapes
        if any(reason is each for each in resolved.refused)
        and _n_directions(spectrum, mode.frequency, mode.frequency, mode.half_bandwidth) <= 1
    ]
    return ResolvedModes(
        tuple(sorted([*resolved.modes, *(m for m, _ in lone)], key=lambda each: each.frequency)),
        tuple(e for e in resolved.refused if not any(e is reason for _, reason in lone)),
    )


def _suspects(
    modes: Sequence[Mode],
    refused: Sequence[RefusedMode],
    coincident: Sequence[CoincidentModes],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    harmonics: Sequence[Mode],
) -> list[Suspect]:
    placed = [each for each in refused if each.code != "unstable"]
    named = [mode.frequency for mode in (*modes, *harmonics)]
    named += [each.frequency for each in placed] + [each.frequency for each in coincident]
    found = [
        Suspect(frequency, PEAK_HALF_WIDTH / spectrum.duration / frequency)
        for frequency in peaks_of_two(spectrum, named)
    ]
    if not modes and not harmonics:
        found += [Suspect(frequency, FALLBACK_DAMPING) for frequency in lone_peaks(spectrum)]
    found = [each for each in found if is_asked_for(each.frequency, settings)]
    found += [Suspect(each.frequency, each.damping_ratio) for each in coincident]
    found += [Suspect(e.frequency, e.damping_ratio) for e in refused if e.code == "mixture"]
    seen = [Suspect(mode.frequency, mode.damping_ratio) for mode in modes]
    seen += [Suspect(e.frequency, e.damping_ratio) for e in placed if e.code != "mixture"]
    found += [
        each
        for each in seen
        if each.half_bandwidth * spectrum.duration < UNRESOLVED
        or _n_directions(spectrum, each.frequency, each.frequency, each.half_bandwidth) > 1
    ]
    return [each for each in found if each.half_bandwidth * spectrum.duration < WIDEST_GROUP]


def _n_directions(spectrum: WindowSpectrum, low: float, high: float, half_bandwidth: float) -> int:
    """How many directions stand out of what surrounds a stretch of frequencies [Hz]."""
    return int(np.sum(spectrum.powers_over_flank(low, high, half_bandwidth) > HIDDEN))


def _poles_suffice(group: Group, inside: Sequence[Mode], spectrum: WindowSpectrum) -> bool:
    """Whether the window resolves a group, and no more directions stand out than it has poles."""
    if group.half_bandwidth * spectrum.duration < UNRESOLVED:
        return False
    directions = _n_directions(spectrum, group.low, group.high, group.half_bandwidth)
    return directions <= len(inside)


def _without_broken_pairs(modes: Sequence[Mode]) -> list[Mode]:
    """The modes but those whose partner is not among them."""
    ids = [mode.pair_id for mode in modes]
    return [mode for mode in modes if not mode.pair_id or ids.count(mode.pair_id) > 1]


def _holds(found: GroupModes) -> bool:
    """Whether the model of a band describes its lines: no shapes mixed, no background that moves
    with the modes, nothing left to explain."""
    return (
        found.mixed <= MIXED_SHAPES
        and abs(found.colour) <= TINTED
        and found.unexplained <= UNEXPLAINED
    )


def _bears_out(mode: Mode, poles: Sequence[Mode]) -> bool:
    """Whether a pole stands where a mode of the lines does."""
    return any(
        abs(pole.frequency - mode.frequency)
        < 3 * float(np.hypot(pole.frequency_std, mode.frequency_std))
        and mac(pole.shape, mode.shape) > ALIKE_SHAPES
        for pole in poles
    )


def _plausible_addition(
    mode: Mode, group: Group, spectrum: WindowSpectrum, settings: OmaSettings
) -> bool:
    """Whether a mode that no pole bears out may be one: a wide one, of which the window shows the
    resonance, has a shape that is known and a width like its neighbours'."""
    if mode.half_bandwidth * spectrum.duration < UNRESOLVED:
        return True
    return bool(
        mode.shape_std.max() <= settings.maximum_shape_std
        and mode.half_bandwidth <= MOST_UNLIKE * group.half_bandwidth
    )


def _believable(mode: Mode, group: Group) -> bool:
    """Whether a mode may be one of a group that the window resolves: damped as the others, among
    them, its shape known."""
    likeness = mode.half_bandwidth / group.half_bandwidth
    reach = 2.5 * group.half_bandwidth
    return bool(
        1 / MOST_UNLIKE < likeness < MOST_UNLIKE
        and group.low - reach <= mode.frequency <= group.high + reach
        and mode.shape_std.max() <= VAGUEST_SHAPE
    )


def _same(pole: Mode, mode: Mode) -> bool:
    """Whether a mode of the lines is one that the poles have, sharper where data are many."""
    joint_std = float(np.hypot(pole.frequency_std, mode.frequency_std))
    near = abs(pole.frequency - mode.frequency) < max(
        3 * joint_std, 0.3 * mode.damping_ratio * mode.frequency
    )
    return near and mac(pole.shape, mode.shape) > ALIKE_SHAPES


def _left_out(poles: Sequence[Mode], kept: Sequence[Mode], group: Group) -> list[RefusedMode]:
    """Poles of a group that the lines do not need: those farthest from the modes that are kept."""
    if len(poles) <= len(kept):
        return []
    by_distance = sorted(
        poles, key=lambda pole: min(abs(pole.frequency - mode.frequency) for mode in kept)
    )
    return [
        pole.refused(
            "explained",
            f"explains nothing that the {len(kept)} modes between {group.low:.4g} and "
            f"{group.high:.4g} Hz do not",
        )
        for pole in by_distance[len(kept) :]
    ]


def _no_peak(mode: Mode) -> RefusedMode:
    """An unresolved mode of the poles whose lines hold none."""
    return mode.refused("explained", "a flat background explains its lines as well")


def _not_borne_out(modes: Sequence[Mode], named: Sequence[Mode], group: Group) -> list[RefusedMode]:
    """Modes of the lines that are neither reported nor a pole's."""
    return [
        mode.refused(
            "uncertain",
            f"lines suggest it and no pole does: its shape is known to {mode.shape_std.max():.2g}, "
            f"its width is {mode.half_bandwidth / group.half_bandwidth:.2g} times "
            "its neighbours'",
        )
        for mode in modes
        if not any(mode is each for each in named) and not _bears_out(mode, named)
    ]
