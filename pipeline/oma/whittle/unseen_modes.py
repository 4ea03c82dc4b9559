"""Modes that no pole shows: what stands out of the lines, or beside a mode that hides it.

Each is fitted with what surrounds it and believed where the lines hold strong evidence of it, know
it, and leave next to nothing to explain. What they hold strong evidence of and is not believed is
refused with its reason.

Where two modes are nearer than the window resolves, the two poles of a model order mix their shapes
in complex ones, another mixture in every order, and each is refused for itself. The lines show the
pair all the same: a peak that stands out in two directions.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import Mode, RefusedMode
from pipeline.modal_assurance import mac
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.fit import WhittleFit, modes_of_fit
from pipeline.oma.whittle.narrow_band import WindowSpectrum, far_reach, peaks_and_flanks
from pipeline.oma.whittle.neighbours import (
    AroundMode,
    around_mode,
    bounded_half_bandwidth,
    first_mode,
    hidden_by_first,
    left_near_first,
)
from sensors.arrays import FloatArray, IntArray

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
WIDE_UNSEEN = 100.0  # half bandwidth from which all places are [lines]: they are few, and of a wide
# mode among stronger ones no channel need show more than their flanks
STANDS_OUT_UNSEEN = 1.8  # power over flank across the shapes of what is known there
REACHES_WIDTHS = 3.0  # half bandwidths that a known mode reaches into a stretch of lines
FLANK_REACH = 10.0  # half bandwidths of a known mode within which a peak of its shape is its flank
LEAST_GAIN = 40.0  # of a peak; the highest of noise has 30 [nats]
PEAK_WIDTHS = 1.5  # half bandwidths of a peak to either side (`peaks_and_flanks`)
WIDTHS_BETWEEN_PEAKS = 2.0  # half bandwidths of the wider one between two peaks
RESONANCE_WIDTH = (
    1.5  # half bandwidth of a resonance by its lines; a steady harmonic has less [lines]
)
LEAST_COLOUR, MOST_COLOUR = -3.0, 5.5  # displacements have −1, accelerations 3; beyond, a slope of
# the background
LEFT_BY_NEIGHBOURS = 50.0  # rise of ln p that a mode more may promise near one fitted with others:
# of 145 such fits (`structures`, seeds 110001 to 110060) three left 21 to 42, all right; of a
# parked tower (seed 8500) those with a hidden partner left 85 to 265
LEFT_OF_EVIDENCE = (
    0.02  # of a mode with so strong an evidence, the share of it that may be left: its
)
# model is no more exact; of 26 such fits of `structures` (seeds 110001 to 110060, 160001 to 160048)
# one left 61 of 3796 nats [-]
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
    if width < WIDE_UNSEEN:
        ratio = np.einsum("kii->ki", at) / np.einsum("kii->ki", beside)
        worth = ratio.max(axis=1) > STANDS_OUT_OF_CHANNEL
        centres, at, beside = centres[worth], at[worth], beside[worth]
    into = np.linalg.inv(np.linalg.cholesky(beside))
    white = into @ at @ into.transpose(0, 2, 1)
    # across what is known the strongest direction has no more power
    strongest = np.asarray(np.linalg.eigvalsh(white)[:, -1], dtype=np.float64)
    clear = (strongest > STANDS_OUT_UNSEEN) & (_gain(strongest, width) > LEAST_GAIN)
    centres, white, into = centres[clear] / T, white[clear], into[clear]
    powers, directions = _strongest_across(white, into, _reaching(known, centres, width / T, T))
    gains = _gain(powers, width)
    found: list[UnseenPeak] = []
    for place in np.flatnonzero((powers > STANDS_OUT_UNSEEN) & (gains > LEAST_GAIN)):
        shape = np.linalg.solve(into[place], directions[place])
        peak = UnseenPeak(float(centres[place]), width / T, shape, float(gains[place]))
        if not _is_flank(peak, known):
            found.append(peak)
    return found


def _gain(powers: FloatArray, width: float) -> FloatArray:
    """Rise of ln p if a power over flank were fitted. width: half bandwidth [lines]"""
    return np.asarray(3 * width * (powers - 1 - np.log(np.maximum(powers, 1.0))))


def _reaching(
    known: Sequence[KnownPeak], centres: FloatArray, half_bandwidth: float, duration: float
) -> list[tuple[IntArray, FloatArray]]:
    """Places among the centres that the same known peaks reach, and the shapes of these,
    (n_channels, n_shapes)."""
    frequencies = np.array([each.frequency for each in known])
    widths = np.array([each.half_bandwidth for each in known])
    reach = 1.5 * half_bandwidth + 2 / duration + REACHES_WIDTHS * widths
    reached = np.abs(frequencies - centres[:, None]) < reach  # (n_centres, n_known)
    sets, which = np.unique(reached, axis=0, return_inverse=True)
    return [
        (
            np.flatnonzero(which.ravel() == number),
            np.array([known[each].shape for each in np.flatnonzero(members).tolist()]).T,
        )
        for number, members in enumerate(sets)
    ]


def _is_flank(peak: UnseenPeak, known: Sequence[KnownPeak]) -> bool:
    """Whether what stands out has the shape of a known mode that is not far."""
    return any(
        abs(each.frequency - peak.frequency)
        < 1.5 * peak.half_bandwidth + FLANK_REACH * each.half_bandwidth
        and mac(each.shape, peak.shape) > FLANK_SHAPE
        for each in known
    )


def _strongest_across(
    white: FloatArray, into: FloatArray, reached: Sequence[tuple[IntArray, FloatArray]]
) -> tuple[FloatArray, FloatArray]:
    """Power of the strongest direction across the shapes that reach each place, (n_places,), and
    the direction, whitened, (n_places, n_channels); 0 where the shapes leave no direction."""
    powers, directions = np.zeros(len(white)), np.zeros(white.shape[:2])
    for places, shapes in reached:
        n_shapes = shapes.shape[-1]
        if n_shapes >= white.shape[-1]:
            continue
        across = np.broadcast_to(np.eye(white.shape[-1]), white[places].shape)
        if n_shapes:
            across = np.linalg.qr(into[places] @ shapes, mode="complete")[0][..., n_shapes:]
        values, vectors = np.linalg.eigh(across.transpose(0, 2, 1) @ white[places] @ across)
        powers[places] = values[:, -1]
        directions[places] = (across @ vectors[:, :, -1:])[:, :, 0]
    return powers, directions


def with_unseen(
    modes: Sequence[Mode],
    harmonics: Sequence[Mode],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    reach: tuple[float, float],
    too_dense: Callable[[float], bool] = lambda _: False,
) -> tuple[list[Mode], list[RefusedMode]]:
    """The modes with those that stand out of the lines where no pole shows one; what stands out and
    is not believed, the clearest first.

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
    too_dense : callable, optional
        Whether modes stand too densely at a frequency [Hz] for a fit: nothing is sought there.
    """
    result = list(modes)
    refused: list[RefusedMode] = []
    known = [_known_peak(each, spectrum) for each in (*modes, *harmonics)]
    failures = 0
    peaks = [
        each for each in unseen_peaks(spectrum, known, *reach) if not too_dense(each.frequency)
    ]
    for peak in peaks[:MOST_UNSEEN]:
        if failures >= MOST_UNSEEN_FAILURES:
            break
        start = _at_peak(peak, spectrum)
        found = _believed(start, [*result, *harmonics], spectrum, settings)
        if isinstance(found, list):
            if (reason := _why_not_standing_out(found[0], result, spectrum)) is None:
                result.append(found[0])
                continue
            found = reason
        failures += 1
        if found and abs(found.frequency - peak.frequency) <= PEAK_WIDTHS * peak.half_bandwidth:
            refused.append(found)  # a fit that leaves its peak is of something else
    return sorted(result, key=lambda each: each.frequency), refused


def _believed(
    start: Mode, others: Sequence[Mode], spectrum: WindowSpectrum, settings: OmaSettings
) -> list[Mode] | RefusedMode | None:
    """A mode that no pole shows and its neighbours, in the lines that its own width asks for; why
    it is not believed, if they hold strong evidence of it.

    A peak may be sought ten times as wide as the mode behind it: the bins of its band are then too
    coarse for the resonance, and the band reaches over whatever lies there.
    """
    around = around_mode(start, others, spectrum)
    found = None if around is None else _by_evidence(around, settings)
    if not isinstance(found, list) or _as_wide(found[0], start):
        return found
    around = around_mode(found[0], others, spectrum)
    return None if around is None else _by_evidence(around, settings)


def _as_wide(mode: Mode, start: Mode) -> bool:
    """Whether the band of what a fit begins with is about that of what it ends with."""
    ratio = bounded_half_bandwidth(mode) / bounded_half_bandwidth(start)
    return 1 / MOST_OFF_WIDTH <= ratio <= MOST_OFF_WIDTH


def _by_evidence(around: AroundMode, settings: OmaSettings) -> list[Mode] | RefusedMode | None:
    """A mode that no pole shows and its neighbours as one fit has them; why not, where the lines
    do not know it; None where they hold no strong evidence of it."""
    fit = around.fitted()
    if fit.off_colour:
        return None
    evidence = around.evidence_of_first(fit)
    if not evidence > EVIDENCE_OF_UNSEEN:
        return None
    modes = modes_of_fit(fit, around.band)
    most_left = max(LEFT_BY_NEIGHBOURS, LEFT_OF_EVIDENCE * evidence)
    why = _why_not_known(modes[0], fit, around, settings, most_left)
    return modes if why is None else _refused(modes[0], why)


def _why_not_known(
    mode: Mode, fit: WhittleFit, around: AroundMode, settings: OmaSettings, most_left: float
) -> str | None:
    """Why the lines do not know the first mode of a fit. most_left: beside it [nats]"""
    width = mode.half_bandwidth * around.band.duration
    share, shape_std = bandwidth_share(mode), float(mode.shape_std.max())
    left = left_near_first(fit, around.band)
    if not (
        mode.damping_ratio + mode.damping_ratio_std < settings.maximum_damping
        and LEAST_COLOUR <= fit.modes.colours[0] <= MOST_COLOUR
    ):
        return "its fit is as wide or as steep as a slope of the background"
    if not left <= most_left:
        return (
            f"what a fit of one mode leaves there is not noise ({left:.0f} nats, "
            f"{most_left:.3g} is the most): perhaps two, or channels out of phase"
        )
    if not width >= RESONANCE_WIDTH:
        return (
            f"its half bandwidth is {width:.2g} lines, {RESONANCE_WIDTH:g} is the least: perhaps a "
            "tone"
        )
    if not fit.converged:
        return "a fit of one mode does not converge there: perhaps two, or a tone"
    if not (
        mode.frequency_std < settings.maximum_frequency_std * mode.frequency
        and shape_std <= VAGUEST_UNSEEN
        and share <= UNSEEN_SHARE
    ):
        return (
            f"f and ζ are known to {share:.2g} of the half bandwidth and its shape to "
            f"{shape_std:.2g}: too badly"
        )
    return None


def _known_peak(mode: Mode, spectrum: WindowSpectrum) -> KnownPeak:
    scales = spectrum.accelerations(mode.frequency)
    return KnownPeak(mode.frequency, bounded_half_bandwidth(mode), mode.shape / scales)


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
    if fit.off_colour or left_near_first(fit, of_mode.band) <= LEFT_BY_HIDDEN:
        return None
    known = [first_mode(fit, of_mode.band), *others]
    found = _believed(hidden_by_first(of_mode, fit), known, spectrum, settings)
    if not isinstance(found, list) or over_bound(found[0], spectrum) > STANDS_OUT:
        return None
    shared = any(_alike_within(NEAR_WIDTHS, found[0], each) for each in found[1:])
    return None if shared else found[0]


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
    flank = any(_alike_within(FLANK_WIDTHS, mode, each) for each in others)
    return not flank and over_bound(mode, spectrum) <= STANDS_OUT


def _why_not_standing_out(
    mode: Mode, others: Sequence[Mode], spectrum: WindowSpectrum
) -> RefusedMode | None:
    """Why a mode of the lines, which hold strong evidence of it, is no mode all the same."""
    if stands_out(mode, others, spectrum):
        return None
    why = "it has the shape of a mode beside it: perhaps its flank"
    if (ratio := over_bound(mode, spectrum)) > STANDS_OUT:
        why = (
            f"its frequency std is {ratio:.2g} times the attainable bound, {STANDS_OUT:g} is the "
            "most: perhaps a flank"
        )
    return _refused(mode, why)


def _refused(mode: Mode, why: str) -> RefusedMode:
    text = f"lines show a resonance of {100 * mode.damping_ratio:.2g} % that no pole shows, but "
    return mode.refused("uncertain", text + why)


def _alike_within(half_bandwidths: float, mode: Mode, other: Mode) -> bool:
    """Whether two modes of nearly one shape lie within so many half bandwidths of the wider one."""
    width = max(mode.half_bandwidth, other.half_bandwidth)
    near = abs(mode.frequency - other.frequency) < half_bandwidths * width
    return near and mac(mode.shape, other.shape) > FLANK_SHAPE
