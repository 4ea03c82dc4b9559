"""Between the updater and the change detectors: what they are told, what is said of a change."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import FoundationEvent, FrequencyShift, ModalEstimate, StiffnessChange
from pipeline.updating.change import (
    Change,
    ChangeState,
    SeenFrequency,
    Verdict,
    WatchedWindow,
)
from pipeline.updating.evidence import ModalEvidence
from pipeline.updating.forward_model import FloatArray
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.blocks import NANOSECONDS

QUANTILE = 1.6449  # of the standard normal distribution at 95 %


@dataclass(frozen=True, slots=True, eq=False)
class TrackSensitivity:
    """How a tracked mode's frequency depends on the stiffness, by its model mode."""

    track: int
    model: str  # the model mode's label
    slopes: FloatArray  # ∂ ln f / ∂ ratio, (3,) [-]


def watched_window(evidence: ModalEvidence, estimate: ModalEstimate) -> WatchedWindow:
    """The frequencies of the window that entered the evidence last, by track."""
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
        water_level=estimate.water_level,
    )


def sensitivity_rows(tracks: Sequence[int], known: Sequence[TrackSensitivity]) -> FloatArray:
    """S, (n_tracks, 3); zero for tracks that are paired with no mode of the model."""
    slopes = {each.track: each.slopes for each in known}
    rows = [slopes.get(track, np.zeros(3)) for track in tracks]
    return np.array(rows).reshape(len(tracks), 3)


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

    before   (3,) ratios k / nominal before it
    pairs    which tracks are which modes of the model
    """
    starts = state.starts_ns
    changes = _stiffness_changes(change, state, before) if change.kind == "foundation" else ()
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
    assert state.walk_mean is not None
    assert state.walk_covariance is not None
    stds = np.sqrt(np.diag(change.covariance))
    walk_stds = np.sqrt(np.diag(state.walk_covariance))
    return tuple(
        StiffnessChange(
            name=name,
            median=float(change.ratios[i] / before[i]),
            p05=float((change.ratios[i] - QUANTILE * stds[i]) / before[i]),
            p95=float((change.ratios[i] + QUANTILE * stds[i]) / before[i]),
            random_walk=float(state.walk_mean[i] / before[i]),
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
            model=labels.get(state.tracks[column], ""),
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
    if changes:
        sizes = ", ".join(
            f"{each.name} {each.median:+.1%} ({each.p05:+.1%} to {each.p95:+.1%})"
            for each in changes
        )
        return (
            f"the foundation has changed {begun} with probability {verdict.probability:.3f}: "
            f"{sizes}"
        )
    shares = np.abs(change.shifts) / change.shift_stds
    most = int(np.nanargmax(np.nan_to_num(shares, nan=-1.0)))
    return (
        f"the modes have changed {begun} with probability {verdict.probability:.3f}, in a way that "
        f"no foundation explains; most of all the one at "
        f"{np.exp(change.log_frequencies[most]):.4g} Hz, by {np.expm1(change.shifts[most]):+.2%}"
    )
