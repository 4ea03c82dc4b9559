"""Blind identification of one window: samples in, modes with their uncertainty out."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import Mode, QualityWarning, RefusedMode
from pipeline.oma.band_merging import (
    between,
    harmonic,
    merged,
    not_listed,
    told_apart,
    unstable,
    unsteady,
)
from pipeline.oma.close_modes import UNRESOLVED, resolved_by_evidence, with_lone_modes
from pipeline.oma.cross_check import CrossCheck, cross_checks, disagreements
from pipeline.oma.data_quality.coupled_harmonics import without_machines
from pipeline.oma.data_quality.input_checks import (
    HARMONIC_DAMPING,
    NON_STATIONARY,
    Finding,
    check_samples,
    is_harmonic,
    mended,
)
from pipeline.oma.data_quality.sea_humps import without_sea_humps
from pipeline.oma.data_quality.timestamps import check_timestamps, evenly_sampled
from pipeline.oma.preprocessing import decimated, filled, on_even_grid, without_offset
from pipeline.oma.settings import OmaSettings
from pipeline.oma.ssi.band_identification import (
    BandIdentification,
    band_covariances,
    modes_of_covariances,
)
from pipeline.oma.ssi.bands import Band, is_asked_for, plan_bands, why_no_band
from pipeline.oma.ssi.coincident_modes import CoincidentModes, twin_pairs
from pipeline.oma.ssi.ssi_cov import References, references_among, with_bounded_references
from pipeline.oma.ssi.stabilization import PoleCloud, integrations_of
from pipeline.oma.whittle.lone_modes import Sharpened, borne_out, sharpened
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.unseen_modes import (
    LOWEST_PEAK,
    RESONANCE_WIDTH,
    bandwidth_share,
    with_unseen,
)
from sensors.arrays import FloatArray, IntArray
from sensors.files.table import Quantity

NO_BAND = "no-band"  # code of a window too short or too slow for the frequencies asked for
NO_VIBRATION = "no-vibration"  # code of a window whose matrices are singular
AT_BOUND = 2.0  # a frequency std of less, over the attainable bound, could hardly be smaller [-]
WELL_KNOWN_SHAPE = 0.1  # a largest std of a shape's components as only modes have it [-]
WELL_KNOWN_SHARE = 0.4  # of the half bandwidth: what f and ζ of a mode are known to; of 80 records
# of noise (seeds 76101 to 76110) and 60 `structures` (seeds 76001 to 76060) no pole of noise was
# known better in most orders, that was no mixture
SURE_SHARE = 0.25  # of the half bandwidth: what f and ζ of a mode are known to, whose shape is only
# vague; of 48 `structures` (seeds 74001 to 74048) no pole of noise was known better than to .5
MODERATE_SHARE = 0.75  # of the half bandwidth: what f and ζ are known to, where the shape is [-]

MOST_FITTED_CHANNELS = 20  # the noise of n channels has n (n + 1) / 2 parameters in a fit: a window
# of eight modes two of which are near took 9, 28, 58, 227 s of CPU with 8, 16, 20, 32 channels, and
# beyond two minutes it is given up; with more channels the poles stand as they are

LEAST_OF_STRUCTURES = 0.0005  # ζ with its std; bare steel in a laboratory has .001 [-]

TWINS_PLACE = 0.01  # twins this near to a mode that was found are reported by it, relative


@dataclass(frozen=True, slots=True, eq=False)
class Identification:
    """What one window says: its modes, or why it says nothing."""

    modes: tuple[Mode, ...]
    """Lowest frequency first."""
    warnings: tuple[QualityWarning, ...] = ()
    rejection: QualityWarning | None = None
    """Why the window cannot be identified; `modes` is empty then."""
    diagrams: tuple[PoleCloud, ...] = ()
    """Stabilisation diagram of each band, slowest first."""
    refused: tuple[RefusedMode, ...] = ()
    """What looked like a mode and is none, and why."""
    cross_checks: tuple[CrossCheck | None, ...] = ()
    """Of each mode, where they were asked for."""


def identify(
    samples: NDArray[np.floating],
    sampling_rate: float,
    settings: OmaSettings | None = None,
    *,
    times: FloatArray | None = None,
    channel_names: Sequence[str] | None = None,
    quantities: Sequence[Quantity] | None = None,
    rotor_speed: FloatArray | None = None,
    cross_checked: bool = False,
) -> Identification:
    """Modes of the structure that a whole array of samples, taken as one window, shows.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Any unit, channels may differ in theirs.
    sampling_rate : float
        [Hz].
    settings : OmaSettings, optional
        The defaults where left out.
    times : ndarray, shape (n,), optional
        Time stamps of the samples, if there are any [s].
    channel_names : sequence of str, optional
        For warnings and the references; "channel 1" and so on by default.
    quantities : sequence of Quantity, optional
        What each channel measures; by default all the same.
    rotor_speed : ndarray, shape (n,), optional
        At each sample [rpm]: harmonics of a turning rotor are taken off along its angle
        (`rotor_harmonics.py`), and what follows it is no mode. Where it is not known, two harmonics
        that keep one phase show it (`coupled_harmonics.py`), and weak ones warn that a rotor turns
        (`turning_rotor.py`).
    cross_checked : bool, optional
        Every mode is estimated a second time from its spectral peak (`cross_check.py`); where the
        two differ by more than their std allow, a warning says so.

    Returns
    -------
    Identification
        A rejected window has no modes and holds the reason: a rejection is a value and no
        exception.

    Raises
    ------
    OmaSettingsError
        If the sampling rate is too low for the frequencies asked for, or a reference channel is
        unknown.

    Notes
    -----
    Shapes are in the samples' own units: a channel in g beside one in m/s² reads accordingly.
    Of channels that measure different quantities, they are those of the accelerations.
    Up to 5 % of missing samples (NaN, or steps of `times`) are filled by prediction. A window that
    lacks more, or has a dead channel, is rejected.
    """
    settings = settings or OmaSettings()
    names = channel_names or default_names(samples.shape[1])
    references_among(names, settings)  # raises
    try:
        return _of_samples(
            samples, sampling_rate, settings, times, names, quantities, rotor_speed, cross_checked
        )
    except (np.linalg.LinAlgError, ArithmeticError) as error:
        return Identification((), (), _no_vibration(error))


def _of_samples(
    samples: NDArray[np.floating],
    sampling_rate: float,
    settings: OmaSettings,
    times: FloatArray | None,
    names: Sequence[str],
    quantities: Sequence[Quantity] | None,
    rotor_speed: FloatArray | None,
    cross_checked: bool,
) -> Identification:
    gridded = None if times is None else on_even_grid(samples, times, sampling_rate)
    if gridded is not None:
        if rotor_speed is not None and times is not None:
            rotor_speed = np.interp(gridded[1], times, rotor_speed)
        samples, times = gridded
    findings = check_window(samples, sampling_rate, channel_names=names, times=times)
    if rejection_in(findings) is not None:
        return Identification((), (), rejection_in(findings))
    clean = mended(filled(samples, sampling_rate), findings)
    if times is not None and any(f.code in ("uneven-clock", "sampling-rate") for f in findings):
        clean = evenly_sampled(clean, times)
        sampling_rate = (len(times) - 1) / float(times[-1] - times[0])
    settings = with_bounded_references(clean, names, settings)
    references = references_among(names, settings)
    bands = plan_bands(
        n_samples=len(samples),
        n_channels=samples.shape[1],
        sampling_rate=sampling_rate,
        settings=settings,
    )
    if not bands:
        why = why_no_band(
            n_samples=len(samples),
            n_channels=samples.shape[1],
            sampling_rate=sampling_rate,
            settings=settings,
        )
        return Identification((), (), QualityWarning(NO_BAND, why))
    steady = without_offset(clean)
    del clean  # a window of a fast recorder has gigabytes
    rest = without_machines(steady, sampling_rate, rotor_speed)
    steady = rest.samples
    integrations = integrations_of(quantities, samples.shape[1])
    by_band = _modes_by_band(steady, bands, settings, references, integrations)
    found = concluded(
        by_band, steady, sampling_rate, findings, settings, integrations, left=rest.left
    )
    found = _without_followers(found, rest.follows)
    found = replace(found, warnings=(*found.warnings, *rest.warnings))
    return _cross_checked(found, steady, sampling_rate) if cross_checked else found


def _no_vibration(error: Exception) -> QualityWarning:
    what, *_ = str(error).split(". ")
    return QualityWarning(
        NO_VIBRATION,
        f"no vibration has such samples ({what}): values beyond any sensor's range, channels that "
        "are all one pure tone, or a step or a curve a million times as large as the motion",
    )


def _modes_by_band(
    steady: FloatArray,
    bands: Sequence[Band],
    settings: OmaSettings,
    references: References,
    integrations: IntArray | None,
) -> list[BandIdentification]:
    """Each band's modes; what is decimated for them is not held any longer."""
    at_rate = {q: decimated(steady, q) for q in {band.decimation for band in bands}}
    return [
        modes_of_covariances(
            band_covariances(
                at_rate[band.decimation], band, settings, references, n_samples=len(steady)
            ),
            band,
            settings,
            integrations=integrations,
        )
        for band in bands
    ]


def _without_followers(found: Identification, follows: Callable[[float], bool]) -> Identification:
    """What is left of the rotor's harmonics is refused, not reported."""
    followers = [mode for mode in found.modes if follows(mode.frequency)]
    if not followers:
        return found
    kept = tuple(mode for mode in found.modes if not any(mode is each for each in followers))
    refused = sorted([*found.refused, *map(harmonic, followers)], key=lambda each: each.frequency)
    return replace(found, modes=kept, refused=tuple(refused))


def _cross_checked(
    found: Identification, steady: FloatArray, sampling_rate: float
) -> Identification:
    checks = cross_checks(found.modes, steady, sampling_rate)
    return replace(
        found,
        cross_checks=tuple(checks),
        warnings=(*found.warnings, *disagreements(found.modes, checks)),
    )


def concluded(
    by_band: Sequence[BandIdentification],
    steady: FloatArray,
    sampling_rate: float,
    findings: Sequence[Finding],
    settings: OmaSettings,
    integrations: IntArray | None = None,
    *,
    left: FloatArray | None = None,
) -> Identification:
    """All bands' modes as one list: each once, close pairs joined, harmonics left out.

    Parameters
    ----------
    by_band : sequence of BandIdentification
        Modes and poles of each band.
    steady : ndarray, shape (n, n_channels)
        The window's samples, free of offset, each channel in its own unit.
    sampling_rate : float
        Of `steady` [Hz].
    findings : sequence of Finding
        Of the checks of the window; their warnings are passed on.
    settings : OmaSettings
        Limits of what counts as a mode.
    integrations : ndarray of int, shape (n_channels,), optional
        Of channels that measure different quantities (`quantities.py`).
    left : ndarray, shape (n // 2 + 1,), optional
        What taking off a rotor's harmonics has left of each line's power [-].

    Notes
    -----
    What is known too vaguely for a mode is left out as well.
    """
    judged = _judged(by_band, steady, sampling_rate, settings)
    warnings = [finding.warning for finding in findings]
    by_lines = Sharpened(tuple(judged.modes), tuple(judged.refused))
    if steady.shape[1] > MOST_FITTED_CHANNELS:
        warnings.append(_too_many_channels(steady.shape[1]))
    else:
        spectrum = WindowSpectrum(steady, sampling_rate, integrations, left)
        twins = _twins_beside(by_band, [*judged.modes, *judged.harmonics])
        stationary = all(finding.code != NON_STATIONARY for finding in findings)
        reach = (
            max(LOWEST_PEAK / spectrum.duration, min(each.band.lowest for each in by_band)),
            max(each.band.highest for each in by_band),
        )
        by_lines = _fitted(judged, twins, spectrum, settings, reach=reach, stationary=stationary)
    tones = [
        each
        for each in by_lines.modes
        if not any(_is_near(each, mode) for mode in judged.modes)
        and _is_tone_of_lines(each, steady, sampling_rate)
    ]
    modes = [each for each in by_lines.modes if not any(each is tone for tone in tones)]
    harmonics = [*judged.harmonics, *tones]
    once = {mode.pair_id or f"{mode.frequency:.4g}": mode for mode in harmonics}
    warnings += [_steady_amplitude(mode) for mode in once.values()]
    alike = _twins_beside(by_band, [*modes, *harmonics])
    warnings += [_coincident(each) for each in alike]
    pairs = twin_pairs(alike, steady, sampling_rate, integrations)
    found = told_apart([*modes, *pairs], len(steady) / sampling_rate)
    reasons = [*by_lines.refused, *found.refused, *map(harmonic, harmonics)]
    reasons += unstable(by_band, found.modes, reasons)
    reasons += not_listed(by_lines.unseen, [*found.modes, *reasons])
    # A pole at the end of the bands may lead to a resonance beyond what was asked for.
    asked = [mode for mode in found.modes if is_asked_for(mode.frequency, settings)]
    structural = without_sea_humps(asked, steady, sampling_rate, integrations)
    narrower = [
        _narrower_than_any(mode)
        for mode in structural.modes
        if mode.damping_ratio + mode.damping_ratio_std < LEAST_OF_STRUCTURES
    ]
    return Identification(
        structural.modes,
        (*warnings, *narrower, *structural.warnings),
        diagrams=tuple(band.poles for band in by_band),
        refused=tuple(sorted([*reasons, *structural.refused], key=lambda each: each.frequency)),
    )


def _fitted(
    judged: "_Judged",
    twins: Sequence[CoincidentModes],
    spectrum: WindowSpectrum,
    settings: OmaSettings,
    *,
    reach: tuple[float, float],
    stationary: bool,
) -> Sharpened:
    """The modes after fits to the spectrum's lines, where those know more than the poles."""
    resolved = resolved_by_evidence(
        judged.modes, judged.refused, twins, spectrum, settings, harmonics=judged.harmonics
    )
    resolved = with_lone_modes(resolved, judged.vague_shapes, spectrum)
    if not stationary:
        return Sharpened(resolved.modes, resolved.refused)
    founded = borne_out(resolved.modes, resolved.refused, spectrum)
    by_lines = sharpened(founded.modes, founded.refused, judged.doubtful, spectrum, settings)
    modes, unseen = with_unseen(
        by_lines.modes,
        judged.harmonics,
        spectrum,
        settings,
        reach=reach,
        too_dense=by_lines.too_dense.holds,
    )
    return Sharpened(tuple(modes), by_lines.refused, unseen=tuple(unseen))


@dataclass(frozen=True, slots=True, eq=False)
class _Judged:
    """What the poles of all bands show, each for itself."""

    modes: list[Mode] = field(default_factory=list)
    harmonics: list[Mode] = field(default_factory=list)
    refused: list[RefusedMode] = field(default_factory=list)
    doubtful: list[tuple[Mode, RefusedMode]] = field(default_factory=list)
    """Modes that are known too vaguely, each with its reason."""
    vague_shapes: list[tuple[Mode, RefusedMode]] = field(default_factory=list)
    """Those of them whose f and ζ are sure."""


def _judged(
    by_band: Sequence[BandIdentification],
    steady: FloatArray,
    sampling_rate: float,
    settings: OmaSettings,
) -> _Judged:
    judged, duration = _Judged(), len(steady) / sampling_rate
    for each in merged([band.modes for band in by_band], [band.band for band in by_band]):
        mode = each.mode
        if _is_tone(mode, steady, sampling_rate):
            judged.harmonics.append(mode)
        elif each.between:
            judged.refused.append(between(mode, each.between))
        elif not each.steady:
            reason = unsteady(mode, settings.minimum_presence)
            judged.refused.append(reason)
            judged.doubtful.append((mode, reason))
        elif (why := why_refused(mode, duration, settings, alone=each.alone)) is None:
            judged.modes.append(_at_least_attainable(mode, duration))
        else:
            reason = mode.refused(*why)
            judged.refused.append(reason)
            judged.doubtful.append((mode, reason))
            if why[0] == "mixture" and each.n_bands > 1 and bandwidth_share(mode) <= SURE_SHARE:
                judged.vague_shapes.append((mode, reason))
    return judged


def _at_least_attainable(mode: Mode, duration: float) -> Mode:
    """The mode with stds of f and ζ no less than attainable: a smaller one is luck.

    No unbiased estimate is sharper than about δf/f = δζ = √(ζ/(2π f T)) (Au 2014, Mech. Syst.
    Signal Process. 48); ζ may be as much as its std higher than it was estimated.
    """
    damping = mode.damping_ratio + float(np.nan_to_num(mode.damping_ratio_std))
    bound = float(np.sqrt(damping / (2 * np.pi * mode.frequency * duration)))
    columns = np.zeros((len(mode.covariance_factor), 2))
    columns[0, 0] = np.sqrt(max(0.0, (bound * mode.frequency) ** 2 - mode.frequency_std**2))
    columns[1, 1] = np.sqrt(max(0.0, bound**2 - mode.damping_ratio_std**2))
    if not columns.any():
        return mode
    return replace(
        mode,
        covariance_factor=np.hstack([mode.covariance_factor, columns]),
        frequency_std=max(mode.frequency_std, bound * mode.frequency),
        damping_ratio_std=max(mode.damping_ratio_std, bound),
    )


def _twins_beside(
    by_band: Sequence[BandIdentification], known: Sequence[Mode]
) -> list[CoincidentModes]:
    """Each place once where two modes are too alike to be resolved, and neither was."""
    found: list[CoincidentModes] = []
    for twins in sorted((t for band in by_band for t in band.twins), key=lambda t: t.frequency):
        others = [*(each.frequency for each in found), *(mode.frequency for mode in known)]
        if not any(abs(twins.frequency - f) <= TWINS_PLACE * twins.frequency for f in others):
            found.append(twins)
    return found


def _too_many_channels(n_channels: int) -> QualityWarning:
    return QualityWarning(
        "many-channels",
        f"of {n_channels} channels modes side by side are not told apart, one may stand for two "
        f"(of {MOST_FITTED_CHANNELS} or fewer they are): leave some out of the layout",
    )


def _steady_amplitude(mode: Mode) -> QualityWarning:
    return QualityWarning(
        "harmonic",
        f"what shakes at {mode.frequency:.4g} Hz keeps its amplitude: a machine's harmonic, "
        "not taken for a mode",
    )


def _narrower_than_any(mode: Mode) -> QualityWarning:
    return QualityWarning(
        "harmonic",
        f"what shakes at {mode.frequency:.4g} Hz is damped by {100 * mode.damping_ratio:.2g} %, "
        "less than any structure: perhaps a machine's tone whose speed drifts",
    )


def _coincident(twins: CoincidentModes) -> QualityWarning:
    return QualityWarning(
        "twin-modes",
        f"two modes near {twins.frequency:.4g} Hz are too alike to be told apart, their shapes mix "
        "(a structure alike in two directions?): what is known is their mean",
    )


def hardly_damped(mode: Mode) -> bool:
    """Whether damping is so surely little that a machine's harmonic may be behind it.

    In a window of a few of its own decay times a mode keeps its amplitude, too, and may by chance
    seem hardly damped; but then its damping is known vaguely, that of a harmonic well.
    """
    return bool(mode.damping_ratio + np.nan_to_num(mode.damping_ratio_std) < HARMONIC_DAMPING)


def _is_tone(mode: Mode, steady: FloatArray, sampling_rate: float) -> bool:
    """Whether a mode, of poles or of lines, is a machine's harmonic."""
    return hardly_damped(mode) and is_harmonic(
        steady, sampling_rate, mode.frequency, _least_half_bandwidth(mode)
    )


def _is_tone_of_lines(mode: Mode, steady: FloatArray, sampling_rate: float) -> bool:
    """Whether a mode that no pole shows is a machine's harmonic, of a speed that wanders a little.

    Where poles show none, the lines are one peak as narrow as they are themselves, and say next to
    nothing of its damping.
    """
    width = mode.half_bandwidth * len(steady) / sampling_rate
    return _is_tone(mode, steady, sampling_rate) or (
        width < RESONANCE_WIDTH and is_harmonic(steady, sampling_rate, mode.frequency)
    )


def _is_near(mode: Mode, pole: Mode) -> bool:
    """Whether a mode may be that of a pole, as the lines have it."""
    return abs(mode.frequency - pole.frequency) <= pole.half_bandwidth + pole.frequency_std


def _least_half_bandwidth(mode: Mode) -> float:
    """ζ f with ζ one std less than identified, no less than 0 [Hz]."""
    std = float(np.nan_to_num(mode.damping_ratio_std))
    return max(0.0, mode.damping_ratio - std) * mode.frequency


def why_refused(
    mode: Mode, duration: float, settings: OmaSettings, *, alone: bool = False
) -> tuple[str, str] | None:
    """Why a frequency is not known as well as that of a mode is: code and text; None where it is.

    Parameters
    ----------
    mode : Mode
        The candidate.
    duration : float
        T of the window [s].
    settings : OmaSettings
        `maximum_shape_std` is the most that a resolved mode's shape may have.
    alone : bool, optional
        One band reports it where others should: its f and ζ must be known well.

    Notes
    -----
    No unbiased estimate of a mode's frequency is sharper than about std(f)/f = √(ζ/(2π f T)). A
    mode is taken where its frequency

    - is known at about this bound, or
    - f and ζ to .4 of the half bandwidth ζ f and ζ, or
    - by two bands, to ten times this bound, f and ζ to .6 of these, or to three quarters and the
      shape, of two channels or more, to a tenth.

    On records of 118 random frames and 300 of noise (`tests/benchmarks/records.py`, seeds 4001 to
    4120; noise white, coloured or common to the channels) .95 of the modes and .04 of what only
    fitted noise passed. No noise of several channels had a shape known to better than .18; of
    mixtures of two neighbours, those that a shape gave away had std of .25 and more.
    """
    relative_std = mode.frequency_std / mode.frequency
    shape_std = float(mode.shape_std.max())
    resolved = mode.half_bandwidth * duration >= UNRESOLVED
    if resolved and shape_std > settings.maximum_shape_std:
        return "mixture", (
            f"shape known to {shape_std:.2g}, {settings.maximum_shape_std:g} is the most: "
            "a mixture of neighbours"
        )
    bound = float(np.sqrt(mode.damping_ratio / (2 * np.pi * mode.frequency * duration)))
    if relative_std <= AT_BOUND * bound:
        return None
    share = bandwidth_share(mode)
    if share <= WELL_KNOWN_SHARE:
        return None
    if alone:
        return "alone", (
            f"one band of several sees it, and f and ζ are known to {share:.2g} of the half "
            f"bandwidth only, {WELL_KNOWN_SHARE:g} is the most"
        )
    if relative_std > settings.maximum_bound_ratio * bound:
        return "vague", (
            f"frequency std is {relative_std / bound:.3g} times the attainable bound, "
            f"{settings.maximum_bound_ratio:g} is the most"
        )
    known_shape = len(mode.shape) > 1 and shape_std <= WELL_KNOWN_SHAPE
    most = MODERATE_SHARE if known_shape else settings.maximum_bandwidth_share
    if share > most:
        return "vague", (
            f"f and ζ are known to {share:.2g} of the half bandwidth, {most:g} is the most"
        )
    return None


def check_window(
    samples: NDArray[np.floating],
    sampling_rate: float,
    *,
    channel_names: Sequence[str] | None = None,
    times: FloatArray | None = None,
) -> tuple[Finding, ...]:
    """Everything that is doubtful about a window's samples and time stamps."""
    names = channel_names or default_names(samples.shape[1])
    findings = check_samples(samples, sampling_rate, names)
    return findings if times is None else findings + check_timestamps(times, sampling_rate)


def default_names(n_channels: int) -> tuple[str, ...]:
    """What channels without a name are called."""
    return tuple(f"channel {i + 1}" for i in range(n_channels))


def rejection_in(findings: Sequence[Finding]) -> QualityWarning | None:
    """Why a window is not identified; None when it may be."""
    return next((f.warning for f in findings if f.action == "reject"), None)
