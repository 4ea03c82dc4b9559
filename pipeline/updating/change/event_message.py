"""Between the updater and the change detectors: their input, how the modes depend on the springs,
and a change's size and message."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import (
    HALF_INTERVAL,
    FoundationEvent,
    FrequencyShift,
    ModalEstimate,
    StiffnessChange,
)
from pipeline.updating.change.detector import Change, ChangeDetector, ChangeState, Verdict
from pipeline.updating.change.random_walk import deviation
from pipeline.updating.change.sufficient_statistics import (
    WIND_REFERENCE,
    SeenFrequency,
    Sensitivities,
    WatchedWindow,
)
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.pairing import DIFFERENCE
from pipeline.updating.prior import PARAMETER_NAMES, Prior
from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray

ROUNDS = 4  # of measuring a change again; each makes the error some ten times smaller


@dataclass(frozen=True, slots=True, eq=False)
class TrackSensitivity:
    """How a tracked mode's frequency depends on springs and water, by its model mode."""

    track: int
    model: str
    """The model mode's label."""
    slopes: FloatArray
    """∂ ln f / ∂ ratio, (3,) [-]."""
    water: FloatArray
    """∂ ln f / ∂ level and ½ ∂² ln f / ∂ level², (2,) [1/m, 1/m²]."""


def watched_window(
    evidence: ModalEvidence,
    estimate: ModalEstimate,
    water_level: float,
    unknown_level_std: float,
) -> WatchedWindow:
    """The frequencies of the window that entered the evidence last, by track.

    Parameters
    ----------
    evidence : ModalEvidence
        Of all windows so far.
    estimate : ModalEstimate
        Of the last one.
    water_level : float
        Above the model's [m].
    unknown_level_std : float
        Of a level that nothing reports [m].
    """
    latest = {
        mode.track: SeenFrequency(
            track=mode.track,
            log_frequency=float(np.log(mode.last_frequency)),
            std=mode.last_frequency_std / mode.last_frequency,
        )
        for mode in evidence.modes
        if mode.last_window == evidence.n_windows
    }
    return WatchedWindow(
        start_ns=estimate.start_ns,
        duration=estimate.duration,
        seen=tuple(latest.values()),
        weight=estimate.weight,
        water_level=water_level,
        wind=float(np.nan_to_num(estimate.wind_speed - WIND_REFERENCE)),
        level_std=unknown_level_std if np.isnan(estimate.water_level) else 0.0,
    )


def sensitivities_of(tracks: Sequence[int], known: Sequence[TrackSensitivity]) -> Sensitivities:
    """By the order of the tracks; zero for those that are paired with no mode of the model."""
    found = Sensitivities.unknown(len(tracks))
    row_of = {track: row for row, track in enumerate(tracks)}
    present = [each for each in known if each.track in row_of]
    if present:
        rows = [row_of[each.track] for each in present]
        found.stiffness[rows] = [each.slopes for each in present]
        found.water[rows] = [each.water for each in present]
    return found


def event_of(
    change: Change,
    verdict: Verdict,
    state: ChangeState,
    estimate: ModalEstimate,
    *,
    before: FloatArray,
    pairs: Sequence[TrackSensitivity],
) -> FoundationEvent:
    """The message of a change.

    Parameters
    ----------
    change : Change
        When it began and by how much.
    verdict : Verdict
        Whether it was the foundation's.
    state : ChangeState
        Of all windows up to the estimate's.
    estimate : ModalEstimate
        Of the window in which the change was detected.
    before : ndarray, shape (3,)
        Ratios k / nominal before it [-].
    pairs : sequence of TrackSensitivity
        Which tracks are which modes of the model.
    """
    starts = state.sums.starts_ns
    drifted = change.kind == "modal-drift"
    changes = () if drifted else _stiffness_changes(change, state, before)
    return FoundationEvent(
        turbine=estimate.turbine,
        window=estimate.window,
        time_ns=estimate.end_ns,
        kind=change.kind,
        probability=verdict.probability,
        since_ns=starts[change.candidate],
        since_earliest_ns=starts[change.earliest],
        since_latest_ns=starts[change.latest],
        changes=changes,
        shifts=_frequency_shifts(change, state, pairs),
        text=_sentence(change, changes, verdict, estimate, starts[change.candidate]),
    )


def _stiffness_changes(
    change: Change, state: ChangeState, before: FloatArray
) -> tuple[StiffnessChange, ...]:
    ratios, walked = change.step.ratios, deviation(state.walk)
    stds = np.sqrt(np.diag(change.step.covariance))
    walk_stds = np.sqrt(np.diag(walked.covariance))
    return tuple(
        StiffnessChange(
            name=name,
            median=float(ratios[i] / before[i]),
            p05=float((ratios[i] - HALF_INTERVAL * stds[i]) / before[i]),
            p95=float((ratios[i] + HALF_INTERVAL * stds[i]) / before[i]),
            random_walk=float(walked.mean[i] / before[i]),
            random_walk_std=float(walk_stds[i] / before[i]),
        )
        for i, name in enumerate(PARAMETER_NAMES)
    )


def _frequency_shifts(
    change: Change, state: ChangeState, pairs: Sequence[TrackSensitivity]
) -> tuple[FrequencyShift, ...]:
    labels = {each.track: each.model for each in pairs}
    return tuple(
        FrequencyShift(
            model=labels.get(state.sums.tracks[column], ""),
            frequency=float(np.exp(change.log_frequencies[column])),
            change=float(np.expm1(change.shifts[column])),
            change_std=float(change.shift_stds[column]),
        )
        for column in np.flatnonzero(np.isfinite(change.shifts) & (change.shift_stds < 1.0))
    )


def _sentence(
    change: Change,
    changes: Sequence[StiffnessChange],
    verdict: Verdict,
    estimate: ModalEstimate,
    since_ns: int,
) -> str:
    ago = (estimate.end_ns - since_ns) / NANOSECONDS / 60
    begun = f"since about {ago:.0f} min before the end of window {estimate.window}"
    chance = f"with probability {verdict.probability:.3f}"
    if change.kind == "foundation":
        return f"the foundation has changed {begun} {chance}: {_sizes(changes)}"
    most = _most_shifted(change)
    if change.kind == "modal-drift":
        return (
            f"the modes have changed {begun} {chance}, in a way that no foundation explains; most "
            f"of all the one at {most}"
        )
    return (
        f"the modes have changed {begun} {chance}, most of all the one at {most}; that it was the "
        f"foundation has a probability of {change.foundation_probability:.2f}, and would then be "
        f"{_sizes(changes)}"
    )


def _sizes(changes: Sequence[StiffnessChange]) -> str:
    return ", ".join(
        f"{each.name} {each.median:+.1%} ({each.p05:+.1%} to {each.p95:+.1%})" for each in changes
    )


def _most_shifted(change: Change) -> str:
    """The mode whose shift is the surest, with it."""
    shares = np.abs(change.shifts) / change.shift_stds
    most = int(np.nanargmax(np.nan_to_num(shares, nan=-1.0)))
    return f"{np.exp(change.log_frequencies[most]):.4g} Hz, by {np.expm1(change.shifts[most]):+.2%}"


def stiffness_slopes(modes: ForwardModel, prior: Prior, ratios: FloatArray) -> FloatArray:
    """S = ∂ ln f / ∂ ratio of every mode of the model at (3,) ratios, (m, 3); NaN where the
    structure cannot stand."""
    points = ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
    logs = np.log(modes.modal(prior.stiffness(points)).frequencies)
    return np.asarray((logs[1:] - logs[0]).T / DIFFERENCE)


def measured_half_way(
    found: Change,
    state: ChangeState,
    detector: ChangeDetector,
    modes: ForwardModel,
    prior: Prior,
    *,
    before: FloatArray,
    pairs: Sequence[TrackSensitivity],
) -> Change:
    """The change, measured by the mean of the slopes before and after it.

    Parameters
    ----------
    found : Change
        As measured by the slopes before it.
    state : ChangeState
        Of all windows up to the one in which it was detected.
    detector : ChangeDetector
        That measures again.
    modes : ForwardModel
        Followed from the stiffness before, so that labels mean the same on both sides.
    prior : Prior
        Of the ratios; where no structure could stand after the change, it has none.
    before : ndarray, shape (3,)
        Ratios k / nominal before it [-].
    pairs : sequence of TrackSensitivity
        Which tracks are which modes of the model, with the slopes there.

    Notes
    -----
    A step of the modes' ln f is read as a change of the springs, κ, by the slopes
    S = ∂ ln f / ∂ ratio. A tenth of k22 changes the slopes by a tenth and more, so that those from
    before the change would report it as twelve percent. The mean of the slopes before and after,

        ln f(r + κ) − ln f(r) = ½ (S(r) + S(r + κ)) κ,

    is right to the third order in κ (the trapezoidal rule along the way). κ is on both sides: a few
    rounds of it settle. Where no structure could stand after the change, the answer is the one by
    the slopes before.
    """
    there = stiffness_slopes(modes, prior, before)
    for _ in range(ROUNDS):
        after = before + found.step.ratios
        if not prior.supports(after):
            break
        turned = (stiffness_slopes(modes, prior, after) - there) / 2
        half_way = [
            replace(each, slopes=each.slopes + turned[modes.labels.index(each.model)])
            for each in pairs
        ]
        if not all(np.all(np.isfinite(each.slopes)) for each in half_way):
            break
        known = sensitivities_of(state.sums.tracks, half_way)
        found = detector.remeasured(state, found, known)
    return found
