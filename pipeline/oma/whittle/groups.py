"""Modes of a window that are too near each other, or too slow, for poles: fitted to its lines.

A group is a stretch of frequencies with suspects: a mode that the window does not resolve
(ζ f T < 3), neighbours whose resonances overlap, a mixture of neighbours that was refused. The
number of modes that the evidence supports replaces what the poles say there.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from pipeline.messages import Mode
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.fit import WhittleFit, covariance_root, modes_of_fit
from pipeline.oma.whittle.narrow_band import NarrowBand, WindowSpectrum
from pipeline.oma.whittle.pair_axes import along_axes, along_perpendicular_axes
from pipeline.oma.whittle.selection import FEWEST_BAND_LINES, Needed, best_fit, left_unexplained
from sensors.arrays import FloatArray

REACH_LINES = 30.0  # of a band beyond its group, so that a flat background is resolved from a mode,
REACH_WIDTHS = 9.0  # and half bandwidths ζ f more
SLOW_REACH_LINES = 15.0  # of modes a line wide: a sea's spectrum bends within 30 lines
LEAST_LINES = 8.0  # of a band beyond its group, whatever its neighbours,
LEAST_WIDTHS = 3.0  # and half bandwidths more
TOUCHING_WIDTHS = 2.5  # half bandwidths between neighbours of one group,
TOUCHING_LINES = 5.0  # and lines 1/T more
MOST_BINS = 60  # of a band; more lines are taken together
FEWEST_BINS_A_WIDTH = 2.0  # in which half a resonance must still show
MOST_GROUP_MODES = 4  # that a band is fitted with
RESOLVED = 3.0  # half bandwidth of modes whose own shapes a window knows [lines]
FEW_LINES = 3.5  # between modes whose axes a window may not know [lines]; with 2.5, of 30 triplets
# (seeds 60056 to 60085) 25 were found or one group, with 3.5 28
PERPENDICULAR_LINES = 4.0  # between modes that may be perpendicular ones [lines]
CLOSE = 2.0  # std of the difference within which two modes are a pair
ONE_FORCE = 0.95  # correlation of two modes' forces of three or more: one of them only bends the
# background of the others; of 24 triplets (`close_modes`, seeds 60001 to 60024) it was .18 to .51
HARMONIC_WIDTH = 0.1  # half bandwidth below which a line is a harmonic [lines]


@dataclass(frozen=True, slots=True)
class Suspect:
    """A frequency at which something may be hidden."""

    frequency: float
    """Frequency [Hz]."""
    damping_ratio: float
    """Damping ratio [-]."""

    @property
    def half_bandwidth(self) -> float:
        """ζ f [Hz]"""
        return self.damping_ratio * self.frequency


@dataclass(frozen=True, slots=True)
class Group:
    """Suspects in one stretch of frequencies."""

    low: float
    """Of the lowest suspect [Hz]."""
    high: float
    """Of the highest suspect [Hz]."""
    half_bandwidth: float
    """ζ f, median of the suspects [Hz]."""

    def holds(self, frequency: float, duration: float) -> bool:
        """Whether a frequency [Hz] lies in the band, by a window of that duration [s]."""
        margin = _margin(self.half_bandwidth, duration)
        return self.low - margin <= frequency <= self.high + margin


def _margin(half_bandwidth: float, duration: float) -> float:
    """How far a group reaches beyond a suspect [Hz]."""
    return TOUCHING_WIDTHS * half_bandwidth + TOUCHING_LINES / duration


def grouped(suspects: Sequence[Suspect], duration: float) -> list[Group]:
    """Suspects whose resonances touch, lowest frequency first. duration: T [s]"""
    runs: list[list[Suspect]] = []
    for suspect in sorted(suspects, key=lambda each: each.frequency):
        last = runs[-1][-1] if runs else None
        if last is not None:
            reach = _margin(max(last.half_bandwidth, suspect.half_bandwidth), duration)
            if suspect.frequency - last.frequency <= reach:
                runs[-1].append(suspect)
                continue
        runs.append([suspect])
    return [
        Group(
            run[0].frequency, run[-1].frequency, float(np.median([s.half_bandwidth for s in run]))
        )
        for run in runs
    ]


def band_of(group: Group, spectrum: WindowSpectrum, others: Sequence[Suspect]) -> NarrowBand | None:
    """Lines of a group and of what surrounds it, as far as other modes leave it alone.

    Parameters
    ----------
    group : Group
        Suspects that overlap.
    spectrum : WindowSpectrum
        Fourier lines of the window.
    others : sequence of Suspect
        Modes outside the group.

    Returns
    -------
    NarrowBand or None
        None for fewer than twelve lines.
    """
    T = spectrum.duration
    width = group.half_bandwidth
    lines = REACH_LINES if width * T >= RESOLVED else SLOW_REACH_LINES
    reach = lines / T + REACH_WIDTHS * width
    least = LEAST_LINES / T + LEAST_WIDTHS * width
    low, high = max(group.low - reach, 0.5 * group.low), group.high + reach
    for other in others:
        clear = 4 * other.half_bandwidth + 2 / T
        if other.frequency < group.low:
            low = max(low, min(other.frequency + clear, group.low - least))
        else:
            high = min(high, max(other.frequency - clear, group.high + least))
    n_lines = (high - low) * T
    together = max(1, int(min(n_lines / MOST_BINS, width * T / FEWEST_BINS_A_WIDTH)))
    band = spectrum.band(low, high, together)
    return band if len(band.numbers) >= FEWEST_BAND_LINES else None


@dataclass(frozen=True, slots=True, eq=False)
class GroupModes:
    """What the lines of a group say."""

    modes: tuple[Mode, ...]
    """Inside the group, lowest frequency first."""
    mixed: float
    """Largest correlation of two of its modes' forces [-]."""
    colour: float
    """c of the mode with the largest absolute one [-]."""
    unexplained: float
    """Rise of ln p that one mode more would promise [nats]."""
    weaker_share: float = 1.0
    """Power along the weaker axis of its pair over that along the stronger one [-]."""
    flat: bool = False
    """Whether a background without a mode explains the lines as well."""


def modes_of_group(
    group: Group,
    spectrum: WindowSpectrum,
    others: Sequence[Suspect],
    settings: OmaSettings,
    *,
    most_modes: int = MOST_GROUP_MODES,
) -> GroupModes | None:
    """The modes of a group by evidence, none where a flat background explains the lines as well;
    None where the window has too few lines there."""
    band = band_of(group, spectrum, others)
    if band is None:
        return None
    half_width = _round_width(max(0.3, group.half_bandwidth * band.duration))
    margin = LEAST_LINES + LEAST_WIDTHS * group.half_bandwidth * band.duration
    needed = Needed(group.low * band.duration - margin, group.high * band.duration + margin)
    resolved = group.half_bandwidth * band.duration >= RESOLVED
    found = best_fit(
        band, needed, most_modes=most_modes, half_width=half_width, one_colour=resolved
    )
    if found is None:
        return GroupModes((), mixed=0.0, colour=0.0, unexplained=0.0, flat=True)
    best, band = found.fit, found.band
    perpendicular = None
    if not resolved:
        perpendicular = _perpendicular(best, band, group)
        best = best if perpendicular is None else perpendicular
    covariance = best.covariance
    root = covariance_root(covariance)
    modes = {
        place: mode
        for place, mode in enumerate(modes_of_fit(best, band))
        if group.holds(mode.frequency, band.duration)
        and mode.damping_ratio < settings.maximum_damping
        and best.modes.half_widths[place] > HARMONIC_WIDTH
        and mode.frequency_std < settings.maximum_frequency_std * mode.frequency
    }
    order = sorted(modes, key=lambda place: modes[place].frequency)
    mixed = _largest_correlation(best, order)
    if len(order) > 2 and mixed > ONE_FORCE:
        fewer = len(order) - 1
        return modes_of_group(group, spectrum, others, settings, most_modes=fewer)
    pairs = [
        (one, other)
        for one, other in pairwise(order)
        if (perpendicular is not None and (one, other) in ((0, 1), (1, 0)))
        or _is_pair(best, one, other, covariance)
        or _of_vague_axes(best, one, other, modes, settings)
    ]
    share = 1.0
    if len(pairs) == 1:
        ((one, other),) = pairs
        if not resolved:
            axes = along_axes(best, band, (one, other), root)
            modes[one], modes[other], share = axes.stronger, axes.weaker, axes.share
        else:
            modes |= _named_as_pair(modes, one, other, band.duration)
    elif pairs:
        joint = sorted({place for pair in pairs for place in pair})
        modes |= _as_one_group([modes[place] for place in joint], joint, band.duration)
    inside_group = sorted(modes.values(), key=lambda mode: mode.frequency)
    colour = float(max(best.modes.colours, key=abs))
    left = left_unexplained(best.modes, band, half_width)[0].gain
    return GroupModes(tuple(inside_group), mixed, colour, left, share)


def _largest_correlation(fit: WhittleFit, places: Sequence[int]) -> float:
    """Of the forces of any two modes of a fit, absolute [-]."""
    forces = fit.modes.forces @ fit.modes.forces.conj().T
    correlation = np.abs(forces / np.sqrt(np.outer(np.diag(forces), np.diag(forces)).real))
    np.fill_diagonal(correlation, 0.0)
    chosen = np.array(places, dtype=np.intp)
    return float(correlation[np.ix_(chosen, chosen)].max(initial=0.0))


def _perpendicular(fit: WhittleFit, band: NarrowBand, group: Group) -> WhittleFit | None:
    """The fit with the group's two modes along perpendicular axes, where there are two, hardly
    resolved, and the evidence allows it."""
    inside = [
        place
        for place, position in enumerate(fit.modes.positions)
        if group.holds(float(position) / band.duration, band.duration)
        and fit.modes.half_widths[place] > HARMONIC_WIDTH
    ]
    if len(inside) != 2 or abs(np.diff(fit.modes.positions[inside])[0]) > PERPENDICULAR_LINES:
        return None
    return along_perpendicular_axes(fit, band, inside)


def _round_width(half_width: float) -> float:
    """The nearest step of a scale of four to the octave: where a fit begins, and so where its
    iteration ends, may not depend on the last digits of the poles, which a session's warm
    decomposition changes."""
    return float(2.0 ** (round(4 * np.log2(half_width)) / 4))


def _is_pair(fit: WhittleFit, one: int, other: int, covariance: FloatArray) -> bool:
    """Whether the window hardly resolves two modes: their frequencies lie within a line 1/T, or
    within so many std of their difference."""
    gap = abs(fit.modes.positions[one] - fit.modes.positions[other])
    variance = covariance[one, one] + covariance[other, other] - 2 * covariance[one, other]
    return bool(gap < max(1.0, CLOSE * np.sqrt(max(variance, 0.0))))  # rounding may leave less


def _of_vague_axes(
    fit: WhittleFit, one: int, other: int, modes: dict[int, Mode], settings: OmaSettings
) -> bool:
    """Whether two modes lie within a few lines 1/T and the window does not know their axes."""
    gap = abs(fit.modes.positions[one] - fit.modes.positions[other])
    vaguest = max(float(modes[place].shape_std.max()) for place in (one, other))
    return bool(gap < FEW_LINES and vaguest > settings.maximum_shape_std)


def _named_as_pair(
    modes: dict[int, Mode], one: int, other: int, duration: float
) -> dict[int, Mode]:
    """Two modes whose shapes the window knows and whose frequencies it does not tell apart: half
    a line and a quarter of their distance are added to the std, since two of chance seem to
    repel each other."""
    first, second = modes[one], modes[other]
    pair_id = f"{(first.frequency + second.frequency) / 2:.4f} Hz"
    spread = float(np.hypot(0.5 / duration, (first.frequency - second.frequency) / 4))
    return {
        place: replace(_spread_about(modes[place], modes[place].frequency, spread), pair_id=pair_id)
        for place in (one, other)
    }


def _as_one_group(modes: Sequence[Mode], places: Sequence[int], duration: float) -> dict[int, Mode]:
    """Three modes or more that the window hardly resolves under one `pair_id`: each at the
    mean, with their spread and half a line added to the std."""
    frequencies = [mode.frequency for mode in modes]
    mean = float(np.mean(frequencies))
    spread = float(np.hypot(np.std(frequencies), 0.5 / duration))
    return {
        place: _spread_about(mode, mean, spread) for place, mode in zip(places, modes, strict=True)
    }


def _spread_about(mode: Mode, mean: float, spread: float) -> Mode:
    spread_out = mode.with_frequency_spread(spread)
    return replace(spread_out, frequency=mean, pair_id=f"{mean:.4f} Hz")
