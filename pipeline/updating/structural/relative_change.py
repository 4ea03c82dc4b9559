"""Springs now over springs in a reference period: what both periods have in common cancels.

Both periods are fitted together, x = (springs before, springs now, figures, level before, level
now): the figures and the sensors are the same, the water's level is not (`periods`).

    ln (k now / k before) from the joint Gaussian of x about its peak
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import FINEST_TOLERANCE, JointFit
from pipeline.updating.structural.periods import Period, common_fit
from pipeline.updating.structural.prior import N_SPRINGS
from sensors.arrays import FloatArray, IndexArray


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
    level_correlation: float = 0.0,
) -> RelativeSprings | None:
    """Fit both periods together; None where one of them pairs nothing.

    start               (n_dim,) peak of the latest period
    level_correlation   of the water level's errors in the two periods [-]
    """
    n, level = fit.coordinates.n_dim, N_SPRINGS + len(fit.coordinates.figures)
    own = np.array([0, 1, 2, level])
    before, now = np.arange(n), np.arange(n)
    now[own] = n + np.arange(len(own))
    found = common_fit(
        fit,
        (Period(reference, before), Period(latest, now)),
        np.concatenate([start, start[own]]),
        origin=np.concatenate([fit.coordinates.origin, fit.coordinates.origin[own]]),
        precision=_prior(fit, own, level_correlation),
        tolerance=FINEST_TOLERANCE,
    )
    if found is None:
        return None
    change = _log_springs(fit, found.x, now) - _log_springs(fit, found.x, before)
    size = len(found.x)
    slopes = _slopes(fit, found.x, now, size) - _slopes(fit, found.x, before, size)
    return RelativeSprings(change, slopes @ found.covariance @ slopes.T)


def _prior(fit: JointFit, own: IndexArray, level_correlation: float) -> FloatArray:
    """Precision of x: the figures' once, springs and level for each period."""
    n = fit.coordinates.n_dim
    precision = np.zeros((n + len(own), n + len(own)))
    precision[:n, :n] = fit.coordinates.prior_precision
    precision[n:, n:] = fit.coordinates.prior_precision[np.ix_(own, own)]
    level_before, level_now = own[-1], n + len(own) - 1
    correlation = np.array([[1.0, level_correlation], [level_correlation, 1.0]])
    both = np.ix_([level_before, level_now], [level_before, level_now])
    precision[both] = np.linalg.inv(correlation)
    return precision


def _log_springs(fit: JointFit, x: FloatArray, places: IndexArray) -> FloatArray:
    return np.log(np.abs(fit.coordinates.springs(x[places])))


def _slopes(fit: JointFit, x: FloatArray, places: IndexArray, size: int) -> FloatArray:
    u = x[places]
    own = fit.coordinates.slopes(u)[:N_SPRINGS] / fit.coordinates.springs(u)[:, None]
    found = np.zeros((N_SPRINGS, size))
    found[:, places] = own
    return found
