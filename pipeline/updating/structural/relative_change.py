"""Springs now over springs in a reference period: what both periods have in common cancels.

Both periods are fitted together, x = (springs before, springs now, figures, level before, level
now): the figures and the sensors are the same, the water's level is not. The systematic floors F
belong to the identification and to the mesh, so that one mode errs alike in both periods: its
floors are correlated by FLOOR_CORRELATION.

    ln (k now / k before) from the joint Gaussian of x about its peak, found by Gauss-Newton
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import Comparison, JointFit
from pipeline.updating.structural.prior import N_SPRINGS
from sensors.arrays import FloatArray, IndexArray

FLOOR_CORRELATION = 0.9  # of one mode's systematic error in two periods [-]
RELINEARISATIONS = 4  # of relinearising
TOLERANCE = 0.004  # of the pairing [-]


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
    x = np.concatenate([start, start[own]])
    prior = _prior(fit, now, own, level_correlation)
    origin = np.concatenate([fit.coordinates.origin, fit.coordinates.origin[own]])
    targets = fit.targets(reference), fit.targets(latest)
    covariance = None
    for _ in range(RELINEARISATIONS):
        compared = [
            fit.compared(evidence, target, x[places], TOLERANCE)
            for evidence, target, places in zip(
                (reference, latest), targets, (before, now), strict=True
            )
        ]
        if compared[0] is None or compared[1] is None:
            return None
        J = np.vstack([_spread(compared[0], before, len(x)), _spread(compared[1], now, len(x))])
        errors = np.concatenate([compared[0].errors, compared[1].errors])
        information = np.linalg.inv(_covariance(compared[0], compared[1]))
        hessian = J.T @ information @ J + prior
        covariance = np.linalg.inv(hessian)
        x = x - covariance @ (J.T @ information @ errors + prior @ (x - origin))
    assert covariance is not None
    change = _log_springs(fit, x, now) - _log_springs(fit, x, before)
    slopes = _slopes(fit, x, now, len(x)) - _slopes(fit, x, before, len(x))
    return RelativeSprings(change, slopes @ covariance @ slopes.T)


def _prior(fit: JointFit, now: IndexArray, own: IndexArray, level_correlation: float) -> FloatArray:
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


def _spread(found: Comparison, places: IndexArray, size: int) -> FloatArray:
    J = np.zeros((len(found.errors), size))
    J[:, places] = found.jacobian
    return J


def _covariance(before: Comparison, now: Comparison) -> FloatArray:
    """Of both periods' errors; outlying modes count less in both."""
    D = [each.variances + each.floors for each in (before, now)]
    factors = [1 / each.robust_weights(d) for each, d in zip((before, now), D, strict=True)]
    n = len(before.errors)
    total = np.diag(np.concatenate([d * w for d, w in zip(D, factors, strict=True)]))
    known = {key: row for row, key in enumerate(before.keys)}
    for row, key in enumerate(now.keys):
        other = known.get(key)
        if other is not None:
            shared = FLOOR_CORRELATION * np.sqrt(before.floors[other] * now.floors[row])
            total[other, n + row] = total[n + row, other] = shared
    return total


def _log_springs(fit: JointFit, x: FloatArray, places: IndexArray) -> FloatArray:
    return np.log(np.abs(fit.coordinates.springs(x[places])))


def _slopes(fit: JointFit, x: FloatArray, places: IndexArray, size: int) -> FloatArray:
    u = x[places]
    own = fit.coordinates.slopes(u)[:N_SPRINGS] / fit.coordinates.springs(u)[:, None]
    found = np.zeros((N_SPRINGS, size))
    found[:, places] = own
    return found
