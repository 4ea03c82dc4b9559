"""Springs now over springs in a reference period: what both periods have in common cancels.

Both periods are fitted together, x = (springs before, springs now, figures, level before, level
now): the figures and the sensors are the same, the water's level is not (`periods`).

    ln (k now / k before) from the joint Gaussian of x about its peak

Of the three springs the modes tell one or two directions of a change well, all three only where the
description is good; a weak prior of the change stands for the rest.

A change that moves frequencies by several percent leaves modes under other names after it than
before. What is common to a mode is the model's: both periods' modes are paired with the model's,
each at its own springs, and the model's are followed from one to the other.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.joint_model import JointModel, continued
from pipeline.updating.structural.periods.joint_periods import Period, common_fit
from pipeline.updating.structural.prior import N_SPRINGS, GaussianBelief
from sensors.arrays import FloatArray, IndexArray

HELD_PRECISION = 1e6  # of figures that are held, beside a prior of 1
CHANGE_STDS = np.array(
    [0.3, 0.3, 0.5]
)  # of the springs' coordinates, beside what the modes report:
# a foundation that loses half its stiffness is rare, and what the modes leave open stays near none
STEPS_BETWEEN = 8  # in which the model's modes are followed from the springs before to those now


@dataclass(frozen=True, slots=True, eq=False)
class RelativeSprings:
    """ln of the ratio of springs now to those of the reference."""

    mean: FloatArray
    """(3,) [-]"""
    covariance: FloatArray
    """(3, 3)"""


def relative_springs(
    fit: JointFit,
    reference: ModalEvidence,
    latest: ModalEvidence,
    start: FloatArray,
    *,
    sigma: float = 0.0,
    causes: float = 1.0,
    level_correlation: float = 0.0,
) -> RelativeSprings | None:
    """Fit both periods together; None where one of them pairs nothing.

    Parameters
    ----------
    fit : JointFit
        Of one alternative.
    reference : ModalEvidence
        Of the reference period.
    latest : ModalEvidence
        Of the latest period.
    start : ndarray, shape (n_dim,)
        Peak of the latest period.
    sigma : float, optional
        Discrepancy of the model that the latest period shows [-].
    causes : float, optional
        Modes to each independent error of a rough model [-].
    level_correlation : float, optional
        Of the water level's errors in the two periods [-].
    """
    then = _before(fit, reference, start, sigma)
    if then is None:
        return None
    n, level = fit.coordinates.n_dim, N_SPRINGS + len(fit.coordinates.figures)
    own = np.array([0, 1, 2, level])
    before, now = np.arange(n), np.arange(n)
    now[own] = n + np.arange(len(own))
    x = np.concatenate([start, start[own]])
    x[own] = then[own]
    found = common_fit(
        fit,
        (
            Period(reference, before),
            Period(_with_names_before(fit, reference, latest, then, start), now),
        ),
        x,
        origin=np.concatenate([fit.coordinates.origin, fit.coordinates.origin[own]]),
        precision=_prior(fit, own, level_correlation),
        tolerance=fit.tolerance,
        sigma=sigma,
        common_floors=causes,
    )
    if found is None:
        return None
    change = _log_springs(fit, found.x, now) - _log_springs(fit, found.x, before)
    size = len(found.x)
    slopes = _slopes(fit, found.x, now, size) - _slopes(fit, found.x, before, size)
    return RelativeSprings(change, slopes @ found.covariance @ slopes.T)


def _before(
    fit: JointFit, reference: ModalEvidence, start: FloatArray, sigma: float
) -> FloatArray | None:
    """(n_dim,) the springs and the level of the reference, with the figures of the start."""
    level = N_SPRINGS + len(fit.coordinates.figures)
    held = [i for i in range(N_SPRINGS, fit.coordinates.n_dim) if i != level]
    names = tuple(fit.coordinates.names[i] for i in held)
    belief = GaussianBelief(names, start[held], HELD_PRECISION * np.eye(len(held)))
    peak = fit.with_belief(belief).best(reference, [start], sigma=sigma, most_starts=1)
    return None if peak is None else peak.u


def _with_names_before(
    fit: JointFit,
    reference: ModalEvidence,
    latest: ModalEvidence,
    then: FloatArray,
    now: FloatArray,
) -> ModalEvidence:
    """The latest modes under the tracks of the reference's that the same mode of the model has for
    partner."""
    before = fit.compared(reference, fit.targets(reference), then, fit.tolerance)
    after = fit.compared(latest, fit.targets(latest), now, fit.tolerance)
    if before is None or after is None:
        return latest
    followed = _followed(fit, then, now)
    known = {
        int(followed[each.model_modes[0]]): reference.modes[each.identified].track
        for each in before.used
    }
    tracks = {
        each.identified: known[each.model_modes[0]]
        for each in after.used
        if each.model_modes[0] in known
    }
    return _renamed(latest, tracks, max(reference.n_tracks, latest.n_tracks))


def _renamed(evidence: ModalEvidence, tracks: Mapping[int, int], n_tracks: int) -> ModalEvidence:
    """Modes by their places under other tracks; those that had these before get new ones."""
    taken, modes = set(tracks.values()), []
    for place, mode in enumerate(evidence.modes):
        track = tracks.get(place, mode.track)
        if place not in tracks and track in taken:
            track, n_tracks = n_tracks, n_tracks + 1
        modes.append(replace(mode, track=track))
    return replace(evidence, modes=tuple(modes), n_tracks=n_tracks)


def _followed(fit: JointModel, then: FloatArray, now: FloatArray) -> IndexArray:
    """(n_modes,) which mode of the model at the second point continues each of the first's."""
    last, places = None, np.arange(0)
    for share in np.linspace(0.0, 1.0, STEPS_BETWEEN + 1):
        modes = fit.linearised((1 - share) * then + share * now)
        if modes is None:
            continue
        places = (
            np.arange(len(modes.frequencies)) if last is None else continued(last, modes)[places]
        )
        last = modes
    return places


def _prior(fit: JointModel, own: IndexArray, level_correlation: float) -> FloatArray:
    """Precision of x: the figures' once, springs and level for each period, and the change's."""
    n = fit.coordinates.n_dim
    precision = np.zeros((n + len(own), n + len(own)))
    precision[:n, :n] = fit.coordinates.prior_precision
    precision[n:, n:] = fit.coordinates.prior_precision[np.ix_(own, own)]
    level_before, level_now = own[-1], n + len(own) - 1
    correlation = np.array([[1.0, level_correlation], [level_correlation, 1.0]])
    both = np.ix_([level_before, level_now], [level_before, level_now])
    precision[both] = np.linalg.inv(correlation)
    for i in range(N_SPRINGS):
        difference = np.zeros(len(precision))
        difference[[i, n + i]] = -1.0, 1.0
        precision += np.outer(difference, difference) / CHANGE_STDS[i] ** 2
    return precision


def _log_springs(fit: JointModel, x: FloatArray, places: IndexArray) -> FloatArray:
    return np.log(np.abs(fit.coordinates.springs(x[places])))


def _slopes(fit: JointModel, x: FloatArray, places: IndexArray, size: int) -> FloatArray:
    u = x[places]
    own = fit.coordinates.slopes(u)[:N_SPRINGS] / fit.coordinates.springs(u)[:, None]
    found = np.zeros((N_SPRINGS, size))
    found[:, places] = own
    return found
