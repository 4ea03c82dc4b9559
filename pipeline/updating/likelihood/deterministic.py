"""Deterministic updating: the stiffness that brings the model's modes nearest to the identified.

    J(θ) = Σ_i ((f_i(θ) − f̂_i) / f̂_i)² + Σ_i (1 − MAC(φ_i(θ), φ̂_i)),   θ_opt = argmin J

Source: [foundation-updating] Eqs. 6 and 7, minimised there by MATLAB's fminsearch, which is
Nelder and Mead's simplex; so is this. Every mode weighs the same, however uncertain, and J has
several minima: each start's end point is reported, none is thrown away.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import OptimizeResult, linear_sum_assignment, minimize

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.prior import Prior, UpdatingError
from sensors.arrays import FloatArray

PairingRule = Literal["label", "mac"]

PUBLISHED_STARTS = (0.25, 1.0, 4.0)  # γ of K_init = γ K0, [foundation-updating] Table 2


@dataclass(frozen=True, slots=True, eq=False)
class IdentifiedModes:
    """What deterministic updating is given: frequencies and shapes without their uncertainty."""

    labels: tuple[str, ...]  # of the model modes they were taken for
    frequencies: FloatArray  # f̂, (n_modes,) [Hz]
    shapes: FloatArray  # φ̂, (n_modes, n_measured) [-], any scale
    channels: NDArray[np.intp]  # (n_measured,) index of each shape's columns in the layout

    def __post_init__(self) -> None:
        n_modes, n_measured = len(self.frequencies), len(self.channels)
        if not n_modes or len(self.labels) != n_modes:
            raise UpdatingError(
                f"{n_modes} identified frequencies with {len(self.labels)} labels; each needs one, "
                "and at least one mode is needed"
            )
        if self.shapes.shape != (n_modes, n_measured):
            raise UpdatingError(
                f"identified shapes have the form {self.shapes.shape}; ({n_modes}, {n_measured}) "
                "is needed: modes, measured channels"
            )
        finite = np.isfinite(self.frequencies).all() and np.isfinite(self.shapes).all()
        if not finite or not np.all(self.frequencies > 0):
            raise UpdatingError(
                f"identified frequencies {self.frequencies.tolist()} Hz must be positive, and "
                "they and the shapes finite"
            )


class ModalObjective:
    """J(θ) of Eq. 6.

    Pairing "label" compares each identified mode with the model mode of its label, which the model
    follows by overlap from nominal stiffness. Pairing "mac" lets identified and model modes be
    assigned again at every θ so that J is least; a difference of frequency counts little in J
    against one of shape, so it is the MAC that pairs.
    """

    def __init__(
        self, identified: IdentifiedModes, forward: ForwardModel, *, pairing: PairingRule = "label"
    ) -> None:
        """forward: the model's modes; for "label" it must hold the identified modes' labels, for
        "mac" every mode of it competes. Raises UpdatingError for a label it does not have, and for
        fewer model modes than identified ones.
        """
        missing = sorted(set(identified.labels) - set(forward.labels))
        if pairing == "label" and missing:
            raise UpdatingError(
                f"the model has no mode {', '.join(missing)}; it has {', '.join(forward.labels)}"
            )
        self.identified = identified
        self.forward = forward.subset(identified.labels) if pairing == "label" else forward
        if len(self.forward.labels) < len(identified.labels):
            raise UpdatingError(
                f"{len(identified.labels)} identified modes cannot be paired with the model's "
                f"{len(self.forward.labels)}"
            )
        self._by_label = pairing == "label"

    def __call__(self, ratios: FloatArray) -> float:
        """J at (3,) ratios k / nominal; inf where springs or structure cannot stand."""
        terms = self._terms(ratios)
        return float("inf") if terms is None else float(terms[self._columns(terms)].sum())

    def pairs(self, ratios: FloatArray) -> tuple[str, ...]:
        """The model mode that each identified mode is compared with; empty where J is infinite."""
        terms = self._terms(ratios)
        if terms is None:
            return ()
        return tuple(self.forward.labels[column] for column in self._columns(terms)[1])

    def _terms(self, ratios: FloatArray) -> FloatArray | None:
        """(n_modes, n_model) of J for every possible pair; None where not admissible."""
        if not np.all(np.isfinite(ratios)) or np.any(ratios <= 0):
            return None
        modes = self.forward.modal((ratios * self.forward.nominal)[None])
        if not modes.admissible[0] or not np.all(np.isfinite(modes.frequencies[0])):
            return None
        measured = self.identified.frequencies[:, None]
        frequency = ((modes.frequencies[0] - measured) / measured) ** 2
        shapes = modes.shapes[0][:, self.identified.channels]
        return frequency + 1 - modal_assurance_criterion(self.identified.shapes, shapes)

    def _columns(self, terms: FloatArray) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Rows and columns of the pairs."""
        if self._by_label:
            everyone = np.arange(len(terms))
            return everyone, everyone
        rows, columns = linear_sum_assignment(terms)
        return rows, columns


@dataclass(frozen=True, slots=True)
class DescentSettings:
    """When the simplex stops."""

    bounded: bool = False  # keep to the prior's box; fminsearch knows no bounds
    ratio_tolerance: float = 1e-6  # size of the simplex [-]
    objective_tolerance: float = 1e-10  # J between its corners [-]
    most_evaluations: int = 4000

    def __post_init__(self) -> None:
        if not min(self.ratio_tolerance, self.objective_tolerance) > 0:
            raise UpdatingError("the simplex' tolerances must be positive")
        if self.most_evaluations < 10:
            raise UpdatingError(
                f"most_evaluations is {self.most_evaluations}; at least 10 are needed"
            )


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """One start and where the simplex ended."""

    start: FloatArray  # (3,) ratios k / nominal [-]
    end: FloatArray  # (3,) ratios [-]
    start_objective: float  # J [-]
    objective: float  # J at the end [-]
    pairs: tuple[str, ...]  # model modes compared at the end, in the order of the identified
    evaluations: int
    converged: bool  # False: the evaluations ran out


def deterministic_update(
    objective: ModalObjective,
    prior: Prior,
    starts: Sequence[float | Sequence[float]] = PUBLISHED_STARTS,
    settings: DescentSettings | None = None,
) -> tuple[Descent, ...]:
    """Nelder and Mead's simplex from every start, in the order given.

    starts   a number γ for γ K0, or three ratios k / nominal

    The first simplex has 5 % longer edges than the start's coordinates, as in fminsearch. Raises
    UpdatingError for a start from which there is no model, or outside the bounds if there are any.
    """
    settings = settings or DescentSettings()
    points = [_start(start, objective, prior, settings) for start in starts]
    return tuple(_descent(point, objective, prior, settings) for point in points)


def _start(
    start: float | Sequence[float],
    objective: ModalObjective,
    prior: Prior,
    settings: DescentSettings,
) -> FloatArray:
    """(3,) ratios, checked."""
    point = np.asarray(start, dtype=float)
    point = np.full(3, float(point)) if point.ndim == 0 else point
    if point.shape != (3,):
        raise UpdatingError(f"start {start}: one factor or three ratios k11, k22, k12 are needed")
    low, high = prior.settings.lowest_ratio, prior.settings.highest_ratio
    if settings.bounded and not np.all((point >= low) & (point <= high)):
        raise UpdatingError(f"start {point.tolist()} is outside the bounds {low:g} to {high:g}")
    if not np.isfinite(objective(point)):
        raise UpdatingError(
            f"start {point.tolist()}: no foundation can be so; k11·k22 must exceed k12² and the "
            "structure must stand under gravity"
        )
    return point


def _descent(
    start: FloatArray, objective: ModalObjective, prior: Prior, settings: DescentSettings
) -> Descent:
    box = (prior.settings.lowest_ratio, prior.settings.highest_ratio)
    found: OptimizeResult = minimize(
        objective,
        start,
        method="Nelder-Mead",
        bounds=[box] * 3 if settings.bounded else None,
        options={
            "xatol": settings.ratio_tolerance,
            "fatol": settings.objective_tolerance,
            "maxfev": settings.most_evaluations,
            "maxiter": settings.most_evaluations,
        },
    )
    end = np.asarray(found.x, dtype=float)
    return Descent(
        start=start,
        end=end,
        start_objective=objective(start),
        objective=float(found.fun),
        pairs=objective.pairs(end),
        evaluations=int(found.nfev),
        converged=bool(found.success),
    )
