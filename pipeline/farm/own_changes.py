"""What a turbine's own record says of it: by how much its springs have changed meanwhile.

    FoundationEvent …, FoundationPosterior.relative ──► OwnChange ──► [pooling]

A turbine that changed is compared with itself, without the scatter between turbines and without
the description's errors: of five turbines the others show their spread poorly, its own record shows
a tenth of a spring to a percent. Where the others have changed as much (a storm that scoured all),
it is like them: a change counts by what it differs from the median of the others' changes.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import (
    HALF_INTERVAL,
    FoundationEvent,
    FoundationPosterior,
    RelativeStiffness,
    StiffnessChange,
)
from pipeline.updating.population import SpringCoordinates
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.arrays import FloatArray


@dataclass(frozen=True, slots=True, eq=False)
class OwnChange:
    """Change of a turbine's springs by its own measurements, one event after the other."""

    logs: FloatArray
    """(3,) of ln k11, ln k22, ln k12 [-]."""
    stds: FloatArray
    """(3,) their standard deviations [-]."""
    ratios: FloatArray
    """(3,) k / nominal that the springs have now [-]."""

    def in_coordinates(self, coordinates: SpringCoordinates) -> tuple[FloatArray, FloatArray]:
        """Return the change (3,) and its covariance (3, 3) in x, to the first order.

        Messages hold an interval of each spring and no correlation: errors count as independent.
        """
        gradient = coordinates.steps(np.eye(3), self.ratios).T
        covariance = (gradient * self.stds**2) @ gradient.T
        return coordinates.steps(self.logs, self.ratios), covariance


def own_change(
    posterior: FoundationPosterior, events: Sequence[FoundationEvent]
) -> OwnChange | None:
    """Sum up the changes of the foundation until a posterior; None where there is none.

    Parameters
    ----------
    posterior : FoundationPosterior
        The turbine's last one. What it has relative to the period before the last event is taken
        instead of that event's first size.
    events : sequence of FoundationEvent
        Of any turbines, in any order, one also several times.
    """
    known = {each.since_ns: each for each in events if _counts(each, posterior)}
    ordered = [known[since] for since in sorted(known)]
    sizes = [_sizes(each) for each in ordered if each.kind == "foundation"]
    if ordered and ordered[-1].kind == "foundation" and posterior.relative:
        sizes[-1] = np.array([_interval(posterior.relative, name) for name in PARAMETER_NAMES])
    sizes = [each for each in sizes if np.isfinite(each).all() and (each > 0).all()]
    if not sizes:
        return None
    logs = np.log(np.array(sizes))  # (n_events, 3 springs, median p05 p95)
    stds = (logs[:, :, 2] - logs[:, :, 1]) / (2 * HALF_INTERVAL)
    ratios = [posterior.parameter(name) for name in PARAMETER_NAMES]
    return OwnChange(
        logs=logs[:, :, 0].sum(axis=0),
        stds=np.sqrt((stds**2).sum(axis=0)),
        ratios=np.array([each.median / each.nominal for each in ratios]),
    )


def beside_the_others(changes: Sequence[OwnChange | None]) -> list[OwnChange | None]:
    """Take from each turbine's change the median of the others', of whom none is no change."""
    logs = np.array([np.zeros(3) if each is None else each.logs for each in changes])
    return [
        None if each is None else replace(each, logs=each.logs - _median(np.delete(logs, row, 0)))
        for row, each in enumerate(changes)
    ]


def _median(logs: FloatArray) -> FloatArray:
    return np.asarray(np.median(logs, axis=0)) if len(logs) else np.zeros(3)


def _counts(event: FoundationEvent, posterior: FoundationPosterior) -> bool:
    return event.turbine == posterior.turbine and event.time_ns <= posterior.time_ns


def _sizes(event: FoundationEvent) -> FloatArray:
    """(3, 3) springs over those before: median, p05, p95."""
    return 1 + np.array([_interval(event.changes, name) for name in PARAMETER_NAMES])


def _interval(
    springs: Sequence[StiffnessChange | RelativeStiffness], name: str
) -> tuple[float, float, float]:
    for each in springs:
        if each.name == name:
            return each.median, each.p05, each.p95
    return (np.nan, np.nan, np.nan)
