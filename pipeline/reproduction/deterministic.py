"""Deterministic updating: the stiffness that brings the model's modes nearest to the identified.

    J(θ) = Σ_i ((f_i(θ) − f̂_i) / f̂_i)² + Σ_i (1 − MAC(φ_i(θ), φ̂_i)),   θ_opt = argmin J

Source: [foundation-updating] Eqs. 6 and 7, minimised there by MATLAB's fminsearch, which is
Nelder and Mead's simplex; so is this. Every mode weighs the same, however uncertain, and J has
several minima: each start's end point is reported, none is thrown away.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import OptimizeResult, minimize

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.updating.forward_model import ForwardModel
from sensors.arrays import FloatArray

PUBLISHED_STARTS = (0.25, 1.0, 4.0)  # γ of K_init = γ K0, [foundation-updating] Table 2
RATIO_TOLERANCE = 1e-6  # size of the simplex at which it stops [-]
OBJECTIVE_TOLERANCE = 1e-10  # J between its corners, likewise [-]
MOST_EVALUATIONS = 4000
RIGID = 100.0  # ratio k / nominal beyond which a base is as good as rigid: J is flat there [-]


class ModalObjective:
    """J(θ) of Eq. 6.

    Parameters
    ----------
    identified : mapping of str to Mode
        Label of the model mode, followed by overlap from nominal stiffness → the mode that was
        taken for it.
    forward : ForwardModel
        The structure at all channels of the modes.
    """

    def __init__(self, identified: Mapping[str, Mode], forward: ForwardModel) -> None:
        self._forward = forward.subset(tuple(identified))
        self._frequencies = np.array([mode.frequency for mode in identified.values()])
        self._shapes = np.array([mode.shape for mode in identified.values()])

    def __call__(self, ratios: FloatArray) -> float:
        """J at (3,) ratios k / nominal; inf where springs or structure cannot stand."""
        if not np.all(np.isfinite(ratios)) or np.any(ratios <= 0):
            return float("inf")
        modes = self._forward.modal((ratios * self._forward.nominal)[None])
        if not modes.admissible[0] or not np.all(np.isfinite(modes.frequencies[0])):
            return float("inf")
        frequency = (modes.frequencies[0] - self._frequencies) / self._frequencies
        macs = np.diag(modal_assurance_criterion(self._shapes, modes.shapes[0]))
        return float((frequency**2 + 1 - macs).sum())


@dataclass(frozen=True, slots=True, eq=False)
class Descent:
    """One start and where the simplex ended."""

    start: FloatArray
    """Ratios k / nominal, (3,) [-]."""
    end: FloatArray
    """Ratios, (3,) [-]."""
    objective: float
    """J at the end [-]."""

    @property
    def runs_away(self) -> bool:
        """Whether a spring went on to a rigid one, where J has no finite minimum."""
        return bool(np.any(self.end > RIGID))


def deterministic_update(
    objective: ModalObjective, starts: Sequence[float] = PUBLISHED_STARTS
) -> tuple[Descent, ...]:
    """Nelder and Mead's simplex from γ K0 of every start γ, in the order given.

    Parameters
    ----------
    objective : ModalObjective
        What is minimised.
    starts : sequence of float, optional
        γ of all three springs [-]; the publication's by default.

    Notes
    -----
    The first simplex has 5 % longer edges than the start's coordinates, as in fminsearch, which
    knows no bounds.
    """
    return tuple(_descent(np.full(3, start), objective) for start in starts)


def _descent(start: FloatArray, objective: ModalObjective) -> Descent:
    found: OptimizeResult = minimize(
        objective,
        start,
        method="Nelder-Mead",
        options={
            "xatol": RATIO_TOLERANCE,
            "fatol": OBJECTIVE_TOLERANCE,
            "maxfev": MOST_EVALUATIONS,
            "maxiter": MOST_EVALUATIONS,
        },
    )
    return Descent(start, np.asarray(found.x, dtype=float), float(found.fun))
