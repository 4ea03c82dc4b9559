"""Several periods of one structure fitted together: what they have in common is inferred once.

Each period has its own evidence and its own place in x, the vector of all unknowns; periods that
share a coordinate share its index. The systematic floors F belong to the identification and to the
mesh, so that one mode errs alike in all periods: its errors have the covariance

    C_bb' = (S_b + (1 − ρ) F_b) δ_bb' + c ρ (F_b F_b')^(1/2)

of one component in periods b and b', ρ = FLOOR_CORRELATION and c = 1, and x follows by
Gauss-Newton:

    x ← x − H⁻¹ (Jᵀ C⁻¹ η + P (x − x₀)),   H = Jᵀ C⁻¹ J + P

Source: Nocedal and Wright, "Numerical Optimization" (2006), chapter 10.
"""

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.structural.joint_fit import Comparison, JointFit
from sensors.arrays import FloatArray, IndexArray

FLOOR_CORRELATION = 0.9  # of one mode's systematic error in two periods [-]
RELINEARISATIONS = 4


@dataclass(frozen=True, slots=True, eq=False)
class Period:
    """Evidence of windows that have all coordinates in common."""

    evidence: ModalEvidence
    places: IndexArray
    """(n_dim,) of its coordinates in x"""
    rise: float = 0.0
    """Of the water above the model's level [m]"""


@dataclass(frozen=True, slots=True, eq=False)
class CommonFit:
    """The peak of all periods and its Gaussian."""

    x: FloatArray
    """(n,)"""
    covariance: FloatArray
    """(n, n)"""
    comparisons: tuple[Comparison, ...]
    """Of each period, before the last step."""


def common_fit(
    fit: JointFit,
    periods: Sequence[Period],
    x: FloatArray,
    *,
    origin: FloatArray,
    precision: FloatArray,
    tolerance: float,
    sigma: float = 0.0,
    common_floors: float = 1.0,
    rounds: int = RELINEARISATIONS,
) -> CommonFit | None:
    """Fit all periods from a point that is near; None where one of them pairs nothing.

    x           (n,) where to start
    origin      (n,) mean of the prior
    precision   (n, n) of the prior
    tolerance   of the pairing in ln f [-]
    sigma       discrepancy of the model, common to the periods as the floors are [-]
    common_floors   c, more than 1 where other data with the same floors come beside: what all
                periods have in common then counts less, what differs between them does not [-]
    """
    fits = [fit.with_rise(period.rise) for period in periods]
    targets = [fit.targets(period.evidence) for period in periods]
    covariance, found = precision, list[Comparison]()
    for _ in range(rounds):
        found = []
        for each, target, period in zip(fits, targets, periods, strict=True):
            compared = each.compared(period.evidence, target, x[period.places], tolerance)
            if compared is None:
                return None
            found.append(compared)
        hessian, gradient = precision.copy(), precision @ (x - origin)
        for J, errors, information in _by_component(found, periods, len(x), sigma, common_floors):
            weighted = J.T @ information
            hessian += weighted @ J
            gradient += weighted @ errors
        covariance = np.asarray(np.linalg.inv(hessian))
        x = x - covariance @ gradient
    return CommonFit(x, covariance, tuple(found))


def _by_component(
    found: Sequence[Comparison],
    periods: Sequence[Period],
    size: int,
    sigma: float,
    common_floors: float,
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Jacobian (b, size), errors (b,) and information (b, b) of each component, b the periods that
    have it; outlying modes count less."""
    own, shared = [], []
    for each in found:
        floors = each.floors + sigma**2 * each.reference
        variances = each.variances + floors
        common = common_floors * FLOOR_CORRELATION * floors
        own.append(variances / each.robust_weights(variances) + common - common / common_floors)
        shared.append(np.sqrt(common))
    rows: dict[tuple[int, int], list[tuple[int, int]]] = defaultdict(list)
    for b, each in enumerate(found):
        for row, key in enumerate(each.keys):
            rows[key].append((b, row))
    parts: list[tuple[FloatArray, FloatArray, FloatArray]] = []
    for places in rows.values():
        J = np.zeros((len(places), size))
        for i, (b, row) in enumerate(places):
            J[i, periods[b].places] = found[b].jacobian[row]
        common = np.array([shared[b][row] for b, row in places])
        covariance = np.outer(common, common)
        np.fill_diagonal(covariance, [own[b][row] for b, row in places])
        errors = np.array([found[b].errors[row] for b, row in places])
        parts.append((J, errors, np.asarray(np.linalg.inv(covariance))))
    return parts
