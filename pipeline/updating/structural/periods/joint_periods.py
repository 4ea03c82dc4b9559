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

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.mode_errors import ModeErrors, student_weights
from pipeline.updating.structural.joint_model import JointModel
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
    comparisons: tuple[ModeErrors, ...]
    """Of each period, before the last step."""


def common_fit(
    fit: JointModel,
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

    Parameters
    ----------
    fit : JointModel
        Of one alternative.
    periods : sequence of Period
        Each with its evidence and the rise of its water.
    x : ndarray, shape (n,)
        Where to start.
    origin : ndarray, shape (n,)
        Mean of the prior.
    precision : ndarray, shape (n, n)
        Of the prior.
    tolerance : float
        Of the pairing in ln f [-].
    sigma : float, optional
        Discrepancy of the model, common to the periods as the floors are [-].
    common_floors : float, optional
        c, more than 1 where other data with the same floors come beside: what all periods have in
        common then counts less, what differs between them does not [-].
    rounds : int, optional
        Of linearisation and solution.
    """
    fits = [fit.with_rise(period.rise) for period in periods]
    targets = [fit.targets(period.evidence) for period in periods]
    covariance, found = precision, list[ModeErrors]()
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
    found: Sequence[ModeErrors],
    periods: Sequence[Period],
    size: int,
    sigma: float,
    common_floors: float,
) -> list[tuple[FloatArray, FloatArray, FloatArray]]:
    """Jacobian (b, size), errors (b,) and information (b, b) of each component, b the periods that
    have it."""
    return [
        part
        for mode in _modes(found, sigma)
        for part in mode.by_component(found, periods, size, common_floors)
    ]


@dataclass(frozen=True, slots=True, eq=False)
class _ModeInPeriods:
    """The frequency, or the shape, of one mode in the b periods that have it; NaN where a component
    of a shape is missing."""

    periods: list[int]
    """(b,) their numbers"""
    places: IndexArray
    """(b, n) of its components among the period's errors; -1 where missing"""
    errors: FloatArray
    """η, (b, n)"""
    own: FloatArray
    """(b, n) variances of what differs between the periods: S + (1 − ρ) F"""
    common: FloatArray
    """(b, n) variances of what the periods have in common: ρ F"""

    def by_component(
        self, found: Sequence[ModeErrors], periods: Sequence[Period], size: int, floors: float
    ) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
        """Jacobian (b, size), errors (b,) and information (b, b) of each component."""
        own, common = self._robust()
        for n in range(self.errors.shape[1]):
            members = np.flatnonzero(self.places[:, n] >= 0)
            J = np.zeros((len(members), size))
            for i, b in enumerate(members):
                number = self.periods[b]
                J[i, periods[number].places] = found[number].jacobian[self.places[b, n]]
            shared = np.sqrt(floors * common[members, n])
            covariance = np.outer(shared, shared)
            np.fill_diagonal(covariance, own[members, n] + shared**2)
            errors = self.errors[members, n]
            yield J, errors, np.asarray(np.linalg.inv(covariance))

    def _robust(self) -> tuple[FloatArray, FloatArray]:
        """Variances of Student's t: a period that departs from the others counts less against them,
        and a mode that all periods miss alike counts less for what they have in common, but no
        less for the differences between them."""
        middle = np.nanmedian(self.errors, axis=0)
        apart = np.nansum((self.errors - middle) ** 2 / self.own, axis=1)
        counts = np.sum(self.places >= 0, axis=1)
        alike = float(np.sum(middle**2 / np.nanmean(self.own + self.common, axis=0)))
        together = student_weights(np.array([alike]), np.array([len(middle)]))[0]
        own = self.own / student_weights(apart, counts)[:, None]
        return own / (together if len(self.periods) == 1 else 1.0), self.common / together


def _modes(found: Sequence[ModeErrors], sigma: float) -> list[_ModeInPeriods]:
    """Each mode's frequency and shape over the periods."""
    members: dict[tuple[int, int, bool], dict[int, dict[int, int]]] = {}
    for b, each in enumerate(found):
        for place, (track, row, unit) in enumerate(each.keys):
            periods = members.setdefault((track, unit, row == 0), {})
            periods.setdefault(b, {})[row] = place
    modes = []
    for periods in members.values():
        rows = sorted({row for places in periods.values() for row in places})
        places = np.array([[each.get(row, -1) for row in rows] for each in periods.values()])
        shape = places.shape
        errors, own, common = np.full(shape, np.nan), np.full(shape, np.nan), np.full(shape, np.nan)
        for i, b in enumerate(periods):
            seen, at = places[i] >= 0, places[i][places[i] >= 0]
            floors = found[b].floors[at] + sigma**2 * found[b].reference[at]
            errors[i, seen] = found[b].errors[at]
            own[i, seen] = found[b].variances[at] + (1 - FLOOR_CORRELATION) * floors
            common[i, seen] = FLOOR_CORRELATION * floors
        modes.append(_ModeInPeriods(list(periods), places, errors, own, common))
    return modes
