"""The size of a change, revised as windows come after it.

An event is reported with what the first window or two after it make of its size. The sums before
the change are kept; with those since, they are two segments of one regression on water and wind,
and the step between them is measured as the detectors do (`sufficient_statistics`), by the mean of
the slopes before and now (`event_message.measured_half_way` has the reason).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.change.event_message import TrackSensitivity, sensitivities_of
from pipeline.updating.change.likelihood_ratios import StiffnessStep, stiffness_step
from pipeline.updating.change.sufficient_statistics import (
    N_SUMS,
    UNCUT_MOMENTS,
    ChangeSums,
    before,
    steps,
)
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class BeforeEvent:
    """What is remembered of the time before the last event."""

    tracks: tuple[int, ...]
    sums: FloatArray
    """(N_SUMS, J) over its windows, y from `reference`"""
    reference: FloatArray
    """(J,) ln f"""
    pairs: tuple[TrackSensitivity, ...]
    """With the slopes of the springs then."""
    ratios: FloatArray
    """(3,) k / nominal, the last posterior's median"""
    end_ns: int
    """Start of the change."""

    @classmethod
    def of(
        cls,
        sums: ChangeSums,
        candidate: int,
        pairs: Sequence[TrackSensitivity],
        ratios: FloatArray,
    ) -> "BeforeEvent":
        """The windows before a candidate."""
        return cls(
            tracks=sums.tracks,
            sums=before(sums, candidate),
            reference=sums.reference,
            pairs=tuple(pairs),
            ratios=ratios,
            end_ns=sums.starts_ns[candidate],
        )


def revised_step(
    earlier: BeforeEvent,
    since: ChangeSums,
    pairs: Sequence[TrackSensitivity],
    *,
    rough: bool = False,
    level_std: float = 0.0,
) -> StiffnessStep | None:
    """By how much k / nominal has changed, by all windows since an event.

    Parameters
    ----------
    earlier : BeforeEvent
        What is remembered of the time before the event.
    since : ChangeSums
        Sums from the event on.
    pairs : sequence of TrackSensitivity
        With the slopes of the springs now.
    rough : bool, optional
        As of `Sensitivities`.
    level_std : float, optional
        As of `Sensitivities` [m].

    Returns
    -------
    StiffnessStep or None
        None where no mode was seen before and after.
    """
    both = _joined(earlier, since)
    half_way = _half_way(earlier.pairs, pairs)
    if both is None or not half_way:
        return None
    known = replace(sensitivities_of(both.tracks, half_way), rough=rough, level_std=level_std)
    step = steps(both, known.water, UNCUT_MOMENTS).of(1)
    if not np.any(step.h[0] * np.abs(known.stiffness).sum(axis=1) > 0):
        return None
    return stiffness_step(step, known)


def relative_change(earlier: BeforeEvent, step: StiffnessStep) -> tuple[FloatArray, FloatArray]:
    """ln (k now / k before), (3,), and its standard deviations, (3,), to the first order."""
    relative = step.ratios / earlier.ratios
    now = np.maximum(1 + relative, 1e-3)
    stds = np.sqrt(np.diag(step.covariance)) / earlier.ratios
    return np.log(now), stds / now


def _joined(earlier: BeforeEvent, since: ChangeSums) -> ChangeSums | None:
    """Two segments, by the tracks since: before the event, and all after it."""
    if not since.starts_ns:
        return None
    row_of = {track: row for row, track in enumerate(earlier.tracks)}
    segments = np.zeros((N_SUMS, 2, len(since.tracks)))
    segments[:, 1] = since.totals
    for column, track in enumerate(since.tracks):
        row = row_of.get(track)
        if row is not None and np.isclose(earlier.reference[row], since.reference[column]):
            segments[:, 0, column] = earlier.sums[:, row]
    return replace(
        since,
        starts_ns=(0, since.starts_ns[0]),
        shares=np.array([0.0, since.shares.sum()]),
        segments=segments,
    )


def _half_way(
    then: Sequence[TrackSensitivity], now: Sequence[TrackSensitivity]
) -> list[TrackSensitivity]:
    slopes = {each.track: each.slopes for each in then}
    return [
        replace(each, slopes=(each.slopes + slopes[each.track]) / 2)
        for each in now
        if each.track in slopes
    ]
