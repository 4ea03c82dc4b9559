"""Is a window fit to be identified? Pure functions from samples to named findings.

Each finding has a stable code, one sentence with the quantity, and what follows from it:
"reject" (the window is not identified), "mend" (it was corrected, and this says how) or "warn"
(it is identified as it is).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from pipeline.messages import QualityWarning
from pipeline.oma.data_quality.transients import (
    RingDown,
    loudest_octave,
    ring_down,
    turning_axes,
)
from pipeline.oma.preprocessing import MOST_MISSING, filled, lines_of_channels, without_drift
from sensors.arrays import BoolArray, FloatArray

Action = Literal["warn", "mend", "reject"]

FEWEST_OF_WINDOW = 100  # below, nothing can be identified
DUPLICATE_CORRELATION = 1 - 1e-9  # two real sensors never agree to nine digits
RESONANCE_SEGMENTS = 30  # K averaged periodograms
RESONANCE_BACKGROUND = 21  # lines about one over which the median is its background
FEWEST_SEGMENT_LINES = 32  # below, what stands out of what cannot be told
FIRST_SEGMENT_LINE = 3  # from which on a line has such a background
RESONANT = 2.5  # of a line over its background: at most 2.2 in 1000 records of noise (seed 18880)
FOLLOWING = 0.5  # γ² of two channels at a line, above which one follows the other: of independent
# noise P(γ² > c) = (1 − c)^(K−1), 2e-9 (Bendat and Piersol, "Random Data" (2010), section 9.2)
SILENT_CHANNEL = "silent-channel"  # code
CLIPPED_COUNT = 5  # so many samples at a channel's extreme value,
CLIPPED_EXCESS = 3  # and so many times more than at the value next to it, are a converter's limit
MOST_CLIPPED = 0.05  # share of a channel's samples; more, and the window is not identified
DRIFT_SHARE = 1.0  # a straight line's rise over the window, relative to the rms about it
FLAT_CREST = 3  # equal samples in a row at a crest that is cut off
SPIKE_SIZE = 10.0  # of a lone sample over its neighbours, in robust std of that difference
SPIKE_ALONE = 3.0  # and over the same difference of any sample around it
SPIKE_SURROUNDINGS = 10  # samples to either side that are around it
SPIKE_IN_PLACE = 7.0  # and in std of the differences about it, which a gust or a stop raises
SPIKE_NEIGHBOURHOOD = 50  # samples to either side that this std is taken over
MOST_SPIKES = 1e-3  # share of a channel's samples that is interpolated; more is no accident
NON_STATIONARY = "non-stationary"  # code of the warning
STEADY_ENVELOPE = 0.15  # std/mean of a harmonic's amplitude; 0.52 for a mode under random load
HARMONIC_DAMPING = 0.003  # an identified mode of less may be a harmonic [-]
ENVELOPE_LINES = 6  # half-width of the band the envelope is taken in, in lines 1/T
TAPER_LINES = 2  # to either side of a harmonic's, that a Hann window spreads it over
RESONANCE_WIDTHS = 3.0  # half bandwidths to either side that hold most of a resonance
CHANCE_OF_LINE = 1e-3  # that a mode has a line so far above those beside it [-]


@dataclass(frozen=True, slots=True)
class Finding:
    """One warning about a window's samples."""

    code: str
    text: str
    action: Action

    @property
    def warning(self) -> QualityWarning:
        """As a warning."""
        return QualityWarning(self.code, self.text)


def check_samples(
    samples: NDArray[np.floating], sampling_rate: float, channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """What the samples alone reveal, the gravest first.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        NaN where missing; each channel in its own unit.
    sampling_rate : float
        [Hz].
    channel_names : sequence of str
        For the texts of the findings, one a channel.

    Returns
    -------
    tuple of Finding
        One alone where it rejects the window.
    """
    if len(samples) < FEWEST_OF_WINDOW:
        text = (
            f"{len(samples)} samples ({len(samples) / sampling_rate:.3g} s) are too few to "
            f"identify a mode; {FEWEST_OF_WINDOW} are the least"
        )
        return (Finding("short", text, "reject"),)
    not_a_number = check_finite(samples, sampling_rate, channel_names)
    if any(finding.action == "reject" for finding in not_a_number):
        return not_a_number
    if not_a_number:
        samples = filled(samples, sampling_rate)
    constant = check_constant(samples, channel_names)
    if constant:
        return constant
    return (
        not_a_number
        + check_silent(samples, channel_names)
        + check_duplicates(samples, channel_names)
        + check_clipping(samples, channel_names)
        + check_spikes(samples, sampling_rate, channel_names)
        + check_drift(samples, channel_names)
        + check_stationarity(samples, sampling_rate)
    )


def check_finite(
    samples: NDArray[np.floating], sampling_rate: float, channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Samples that are missing or no number: predicted from the others while they are few."""
    bad = ~np.isfinite(samples)
    if not bad.any():
        return ()
    row, column = np.argwhere(bad)[0]
    text = (
        f"{int(bad.sum())} of {bad.size} samples are missing or no numbers, the first in "
        f"{channel_names[column]}, {row / sampling_rate:.3f} s after the start of the window"
    )
    worst = float(bad.mean(axis=0).max())
    if worst <= MOST_MISSING:
        return (Finding("missing", f"{text}; predicted from the samples around them", "mend"),)
    return (
        Finding(
            "nan",
            f"{text}; up to {100 * worst:.3g} % of a channel, {100 * MOST_MISSING:g} % is the most",
            "reject",
        ),
    )


def check_constant(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that never move: a dead sensor or a broken cable."""
    dead = [
        name for name, span in zip(channel_names, np.ptp(samples, axis=0), strict=True) if not span
    ]
    if not dead:
        return ()
    verb = "is" if len(dead) == 1 else "are"
    return (Finding("constant", f"{', '.join(dead)} {verb} constant over the window", "reject"),)


def check_silent(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that give noise alone while others show motion."""
    silent = [
        name for name, is_so in zip(channel_names, silent_channels(samples), strict=True) if is_so
    ]
    if not silent:
        return ()
    text = (
        f"{', '.join(silent)} measure{'s' * (len(silent) == 1)} nothing: noise without a resonance "
        "that follows no other channel; mend the sensor or its cable, or leave it out of the layout"
    )
    return (Finding(SILENT_CHANNEL, text, "warn"),)


def silent_channels(samples: NDArray[np.floating]) -> BoolArray:
    """Detect channels that give noise alone beside others that measure.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.

    Returns
    -------
    ndarray of bool, shape (n_channels,)
        All False where none measures.

    Notes
    -----
    No line of a silent one stands out of those around it, as a mode's do, and none follows another
    channel's. Either alone proves nothing: two axes of one sensor may share no motion, and a
    motor's harmonics may reach a dead channel's wires.
    """
    n = len(samples) // RESONANCE_SEGMENTS
    found = np.zeros(samples.shape[1], dtype=bool)
    if n // 2 < FEWEST_SEGMENT_LINES or samples.shape[1] < 2:
        return found
    parts = np.asarray(samples[: n * RESONANCE_SEGMENTS], dtype=np.float64)
    parts = parts.reshape(RESONANCE_SEGMENTS, n, -1)
    tapered = (parts - parts.mean(axis=1, keepdims=True)) * np.hanning(n)[:, None]
    lines = np.fft.rfft(tapered, axis=1)[:, FIRST_SEGMENT_LINE:]  # (K, n_lines, n_channels)
    powers = np.mean(np.abs(lines) ** 2, axis=0)
    background = ndimage.median_filter(powers, size=(RESONANCE_BACKGROUND, 1), mode="nearest")
    quiet = np.flatnonzero(~(powers > RESONANT * background).any(axis=0))
    if not 0 < len(quiet) < samples.shape[1]:
        return found
    cross = np.einsum("kfa,kfb->fab", lines[..., quiet].conj(), lines) / RESONANCE_SEGMENTS
    products = powers[:, quiet, None] * powers[:, None, :]
    coherence = np.abs(cross) ** 2 / np.where(products > 0, products, np.inf)
    coherence[:, np.arange(len(quiet)), quiet] = 0.0  # of a channel with itself
    found[quiet] = coherence.max(axis=(0, 2)) < FOLLOWING
    return found


def check_duplicates(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that carry the same signal, perhaps scaled: one sensor wired twice."""
    if samples.shape[1] < 2:
        return ()
    correlation = np.corrcoef(np.asarray(samples, dtype=np.float64), rowvar=False)
    pairs = np.argwhere(np.triu(np.abs(correlation) > DUPLICATE_CORRELATION, k=1))
    return tuple(
        Finding(
            "duplicate-channel",
            f"{channel_names[i]} and {channel_names[j]} carry the same signal: "
            "shapes hold one sensor twice",
            "warn",
        )
        for i, j in pairs
    )


def check_clipping(
    samples: NDArray[np.floating], channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Channels that pile up at the converter's or the sensor's limit, all the time or for a part.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    channel_names : sequence of str
        For the texts of the findings, one a channel.

    Notes
    -----
    The tails of a healthy signal thin out, so that its extreme value is rarer than the next one;
    and its crests are rarely flat, nor all at one height.

    What a limit cuts off shakes at sums and differences of the modes' frequencies: of four records
    of three modes each, known to a hundredth, 6 to 9 modes that are none were reported at 7 % of
    the samples, 3 to 7 at 5 % and one in all at 1.3 %. The true ones stay where they are.
    """
    findings = []
    for name, channel in zip(channel_names, samples.T, strict=True):
        at_limits = _samples_at_the_extremes(channel)
        flat = 0 if at_limits else _flat_crests(channel) + _flat_crests(-channel)
        if at_limits:
            text = f"{name} is at its largest or smallest value {at_limits} times: clipped"
            share = at_limits / len(channel)
            if share > MOST_CLIPPED:
                text += (
                    f", {100 * share:.3g} % of its samples, {100 * MOST_CLIPPED:g} % is the most: "
                    "what is cut off looks like further modes"
                )
            findings.append(Finding("clipped", text, "reject" if share > MOST_CLIPPED else "warn"))
        elif flat:
            text = f"{name} has {flat} crests cut off at one height: clipped for a part"
            findings.append(Finding("clipped", text, "warn"))
    return tuple(findings)


def _samples_at_the_extremes(channel: NDArray[np.floating]) -> int:
    """At a limit that the signal reaches: a value farther from all others than these reach is what
    is written where there is none."""
    values, counts = np.unique(channel, return_counts=True)
    found = 0
    for ends, (last, next_to_last) in ((values, counts[:2]), (values[::-1], counts[:-3:-1])):
        reached = abs(ends[1] - ends[0]) <= max(abs(ends[-1] - ends[1]), abs(ends[1]))
        if reached and last >= CLIPPED_COUNT and last > CLIPPED_EXCESS * next_to_last:
            found += int(last)
    return found


def _flat_crests(channel: NDArray[np.floating]) -> int:
    """Crests of three or more equal samples at the height that has most of them; 0 where other
    heights have nearly as many, as in a signal of few digits."""
    starts = np.concatenate([[0], np.flatnonzero(np.diff(channel)) + 1])
    ends = np.append(starts[1:], len(channel))
    inner = (starts > 0) & (ends < len(channel)) & (ends - starts >= FLAT_CREST)
    starts, ends = starts[inner], ends[inner]
    height = channel[starts]
    crests = height[(channel[starts - 1] < height) & (channel[ends] < height)]
    counts = np.sort(np.unique(crests, return_counts=True)[1])[::-1]
    most, next_most = [*counts.tolist(), 0, 0][:2]
    return most if most >= CLIPPED_COUNT and most > CLIPPED_EXCESS * next_most else 0


def lone_spikes(samples: NDArray[np.floating]) -> NDArray[np.bool_]:
    """Samples that stand alone far off their two neighbours, (n, n_channels).

    A structure's response, even to an impact, lasts; a bit error or a loose contact does not.
    Channel by channel: what is held beside the samples does not grow with their number.
    """
    found = np.empty(samples.shape, dtype=bool)
    for place, channel in enumerate(samples.T):
        found[:, place] = _lone_spikes(np.asarray(channel, dtype=np.float64))
    return found


def _lone_spikes(y: FloatArray) -> NDArray[np.bool_]:
    """Of one channel, (n,)."""
    off = np.zeros_like(y)
    off[1:-1] = y[1:-1] - 0.5 * (y[:-2] + y[2:])
    size = np.abs(off)
    robust_std = 1.4826 * np.median(size)
    far_off = size > SPIKE_SIZE * (robust_std if robust_std > 0 else np.inf)
    if not far_off.any():
        return far_off
    # it throws its neighbours off by half its own size; what lies further is undisturbed
    around = np.ones(2 * SPIKE_SURROUNDINGS + 1, dtype=bool)
    around[SPIKE_SURROUNDINGS - 1 : SPIKE_SURROUNDINGS + 2] = False
    alone = size > SPIKE_ALONE * ndimage.maximum_filter(size, footprint=around)
    return np.asarray(far_off & alone & (size > SPIKE_IN_PLACE * _local_std(size)))


def _local_std(size: FloatArray) -> FloatArray:
    """Std of normal values about each place, from their mean absolute `size` there without the
    value itself and the two that a spike throws off, (n,)."""
    length = 2 * SPIKE_NEIGHBOURHOOD + 1
    total = ndimage.uniform_filter1d(size, length, mode="reflect") * length
    own = ndimage.uniform_filter1d(size, 3, mode="reflect") * 3
    return np.asarray(np.sqrt(np.pi / 2) * (total - own) / (length - 3))


def check_spikes(
    samples: NDArray[np.floating], sampling_rate: float, channel_names: Sequence[str]
) -> tuple[Finding, ...]:
    """Lone samples far off their neighbours: interpolated while they are few."""
    findings = []
    spikes = lone_spikes(samples)
    for name, channel in zip(channel_names, spikes.T, strict=True):
        count = int(channel.sum())
        if not count:
            continue
        few = count <= max(3, MOST_SPIKES * len(channel))
        text = f"{name} has {count} spikes of one sample, the first at " + (
            f"{np.argmax(channel) / sampling_rate:.3f} s"
            f"{'; interpolated' if few else ': too many to mend'}"
        )
        findings.append(Finding("spikes", text, "mend" if few else "warn"))
    return tuple(findings)


def check_drift(samples: NDArray[np.floating], channel_names: Sequence[str]) -> tuple[Finding, ...]:
    """Channels that drift by more than they shake: a straight line is taken off them."""
    y = np.asarray(samples, dtype=np.float64)
    time = np.linspace(-1.0, 1.0, len(y))
    rise = 2 * (time @ y) / (time @ time)  # of the least-squares line over the window
    rms = np.sqrt(np.mean((y - y.mean(axis=0) - 0.5 * np.outer(time, rise)) ** 2, axis=0))
    return tuple(
        Finding(
            "drift",
            f"{name} drifts by {abs(by):.3g} over the window (rms {own:.3g}); a line is taken off",
            "mend",
        )
        for name, by, own in zip(channel_names, rise, rms, strict=True)
        if abs(by) > DRIFT_SHARE * 2 * own
    )


def check_stationarity(samples: NDArray[np.floating], sampling_rate: float) -> tuple[Finding, ...]:
    """Windows whose loudness or axes change: a rotor stop, a ring-down, a passing ship, a yaw."""
    steady = without_drift(without_spikes(np.asarray(samples, dtype=np.float64)))
    octave, decay = loudest_octave(steady, sampling_rate), ring_down(steady, sampling_rate)
    if octave is not None and octave.excess > 1:
        text = (
            f"from {octave.begin:.3g} s on, what shakes between {octave.low:.2g} and "
            f"{2 * octave.low:.2g} Hz is {octave.loudness:.2g} times as loud as its median: a "
            "transient, in which estimates of damping mean little and a peak may be the load's"
        )
    elif decay is not None and decay.excess > 1:
        text = _decay_in_words(decay)
    elif (axes := turning_axes(steady, sampling_rate)) is not None and axes.is_sure:
        text = (
            f"what shakes between {axes.low:.2g} and {axes.high:.2g} Hz moves along other axes in "
            "one part of the window than in another: a nacelle that yaws, or a sensor that is "
            "turned; shapes are mixtures, and one mode may look like two"
        )
    else:
        return ()
    return (Finding(NON_STATIONARY, text, "warn"),)


def _decay_in_words(decay: RingDown) -> str:
    octave = f"between {decay.low:.2g} and {2 * decay.low:.2g} Hz"
    if decay.kind == "blow":
        return (
            f"at {decay.time:.3g} s a blow of {decay.loudness:.2g} times the rms sets what shakes "
            f"{octave} ringing down: a transient, in which estimates of damping mean little"
        )
    return (
        f"loads {octave} are {decay.loudness:.2g} times as strong about {decay.time:.3g} s as in "
        "another part of the window: a stop or a start, in which estimates of damping mean little "
        "and a peak may be the load's"
    )


def is_harmonic(
    samples: FloatArray, sampling_rate: float, frequency: float, half_bandwidth: float = 0.0
) -> bool:
    """Whether what shakes at a frequency is a machine's harmonic and no mode.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Free of offset, each channel in its own unit.
    sampling_rate : float
        [Hz].
    frequency : float
        [Hz].
    half_bandwidth : float, optional
        ζ f that a mode there has at least [Hz].

    Notes
    -----
    A harmonic keeps its amplitude; a mode under random load swells and fades (its envelope has
    a Rayleigh distribution, std/mean 0.52). A weak one beside modes does not keep it, but is one
    line. Judged on the channel with the most power there.
    """
    lines = lines_of_channels(samples, np.ones(samples.shape[1]), np.hanning(len(samples)))
    centre = round(frequency * len(samples) / sampling_rate)
    low, high = max(0, centre - ENVELOPE_LINES), centre + ENVELOPE_LINES + 1
    band = lines[low:high]
    strongest = int(np.argmax((np.abs(band) ** 2).sum(axis=0)))
    narrow = np.zeros(64, dtype=complex)
    narrow[: len(band)] = band[:, strongest]
    taper = np.hanning(64)
    inner = slice(12, 52)  # where the taper can be divided out again
    envelope = np.abs(np.fft.ifft(narrow))[inner] / taper[inner]
    steady = bool(np.std(envelope) < STEADY_ENVELOPE * np.mean(envelope))
    width = half_bandwidth * len(samples) / sampling_rate
    return steady or _is_one_line(np.abs(lines[:, strongest]) ** 2, centre, width)


def _is_one_line(powers: FloatArray, centre: int, width: float) -> bool:
    """Whether one line stands so far above those around it as none of a mode does.

    powers   of tapered lines, (n_lines,)
    width    half bandwidth of the mode [lines]

    A mode's lines have exponential powers about its resonance, tapered ones two by two alike. Over
    k half bandwidths to either side the resonance has arctan(k)/k of its peak in the mean: of n
    independent lines there a further one exceeds R of their means with (1 + R/n)^−n.
    """
    reach = round(RESONANCE_WIDTHS * width)
    if reach <= 2 * TAPER_LINES:
        return False
    first = max(1, centre - ENVELOPE_LINES)
    top = first + int(np.argmax(powers[first : centre + ENVELOPE_LINES + 1]))
    below = powers[max(1, top - reach) : max(1, top - TAPER_LINES)]
    above = powers[top + TAPER_LINES + 1 : top + reach + 1]
    beside = np.concatenate([below, above])
    n = len(beside) / 2
    peak_over_mean = RESONANCE_WIDTHS / np.arctan(RESONANCE_WIDTHS)
    excess = powers[top] / (peak_over_mean * beside.mean())
    return bool(2 * reach * (1 + excess / n) ** -n < CHANCE_OF_LINE)


def mended(samples: FloatArray, findings: Sequence[Finding]) -> FloatArray:
    """The samples without lone spikes and drift, where the findings say they are repaired.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Each channel in its own unit.
    findings : sequence of Finding
        Of these samples; those with the action "mend" count.

    Returns
    -------
    ndarray, shape (n, n_channels)
        `samples` themselves where nothing is to be repaired.
    """
    codes = {finding.code for finding in findings if finding.action == "mend"}
    if "spikes" in codes:
        samples = without_spikes(samples)
    return without_drift(samples) if "drift" in codes else samples


def without_spikes(samples: FloatArray) -> FloatArray:
    """Every lone spike replaced by the mean of its neighbours."""
    spikes = lone_spikes(samples)
    clean = samples.copy()
    rows, columns = np.nonzero(spikes)
    clean[rows, columns] = 0.5 * (samples[rows - 1, columns] + samples[rows + 1, columns])
    return clean
