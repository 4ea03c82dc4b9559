"""Which model mode is which identified mode, without knowing the foundation beforehand.

Frequencies move by up to a third over the prior and fifty modes compete, so a pairing at nominal
stiffness, by order, or by the nearest MAC goes wrong. Here draws of the whole prior box are
searched first; the best few are refined with a tolerance that shrinks; the cheapest end wins.
"""

from bisect import insort
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import ClassVar

import numpy as np
from scipy.optimize import linear_sum_assignment

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.updating.evidence.mode_evidence import ModeEvidence
from pipeline.updating.forward_model import ForwardModel, ModesOfStiffness
from pipeline.updating.prior import Prior, UpdatingError, modal_where_supported
from sensors.arrays import FloatArray, IndexArray
from sensors.settings import NO_KEY

STEP_LENGTHS = np.array([1.0, 0.5, 0.2, 0.05])  # of a Gauss-Newton step, tried in one batch [-]
SURELY_WITHIN_REACH = 0.94  # share of the model's highest frequency at nominal stiffness [-]
DIFFERENCE = 1e-4  # relative step of the numerical derivatives [-]


@dataclass(frozen=True, slots=True)
class PairingSettings:
    """Weights and extent of the search."""

    search_draws: int = 500
    """Number of points of the prior that are tried when modes are paired."""
    tried: int = field(default=12, metadata=NO_KEY)
    """Best draws that are followed at the widest tolerance."""

    refined: int = 4
    """Number of the best of these from which the fit is refined."""
    tolerances: tuple[float, ...] = field(default=(0.03, 0.015, 0.008, 0.004), metadata=NO_KEY)
    """Standard deviations s_f of ln f, in turn [-]."""

    steps: ClassVar[int] = 3
    """Gauss-Newton steps at each tolerance."""
    mac_scale: ClassVar[float] = 0.15
    """Of 1 − MAC [-]."""
    rejection: float = field(default=9.0, metadata=NO_KEY)
    """Cost at which an identified mode is better left alone [-]."""

    def __post_init__(self) -> None:
        if min(self.search_draws, self.tried, self.refined, len(self.tolerances)) < 1:
            raise UpdatingError(
                "pairing needs search_draws, tried, refined and tolerances of at least 1"
            )
        if not min(*self.tolerances, self.rejection) > 0:
            raise UpdatingError("pairing tolerances and rejection must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class PairingTargets:
    """The identified modes as the pairing sees them.

    A close pair has no shape: its row of `shapes` is zero and its MAC counts as 1.
    """

    log_frequencies: FloatArray
    """(n_identified,)."""
    shapes: FloatArray
    """(n_identified, n_channels) [-], zero at absent channels."""
    available: FloatArray
    """(n_identified, n_channels), 1 where the channel was measured."""
    weights: FloatArray
    """(n_identified,) share of the windows in which the mode was seen."""
    judged: FloatArray
    """(n_identified,) 1 where the model, if right, must have a partner."""

    @classmethod
    def of(
        cls, modes: Sequence[ModeEvidence], n_windows: int, *, reach: float = np.inf
    ) -> "PairingTargets":
        """Targets of the combined modes.

        Parameters
        ----------
        modes : sequence of ModeEvidence
            Of all windows.
        n_windows : int
            How many these are.
        reach : float, optional
            The model's highest mode at nominal stiffness [Hz]. Another stiffness may move it past a
            mode that the model doesn't hold, so what lies just below is paired where it can be, but
            its lack of a partner means nothing.
        """
        shapes = np.array([mode.shape for mode in modes])
        frequencies = np.array([mode.frequency for mode in modes])
        return cls(
            log_frequencies=np.log(frequencies),
            shapes=np.nan_to_num(shapes),
            available=np.isfinite(shapes).astype(float),
            weights=np.array([mode.n_windows for mode in modes]) / n_windows,
            judged=(frequencies < SURELY_WITHIN_REACH * reach).astype(float),
        )


@dataclass(frozen=True, slots=True, eq=False)
class Pairing:
    """One assignment at one stiffness."""

    ratios: FloatArray
    """(3,) where it was made [-]."""
    model_modes: tuple[int, ...]
    """For each identified mode the model mode's index, or −1."""
    total_cost: float
    """Over all identified modes, weighted by how often they were seen [-]."""
    cost: float
    """Mean over the judged modes, weighted likewise [-]."""
    paired_share: float
    """Of the judged modes, those that found a partner, weighted likewise [-]."""


def pairing_costs(
    targets: PairingTargets, modes: ModesOfStiffness, tolerance: float, mac_scale: float
) -> FloatArray:
    """(n, n_identified, n_model): (Δ ln f / s_f)² + ((1 − MAC) / s_MAC)²; inf where not
    admissible."""
    log_model = np.log(modes.frequencies)[:, None, :]
    costs = ((targets.log_frequencies[:, None] - log_model) / tolerance) ** 2
    costs += ((1 - macs(targets, modes.shapes)) / mac_scale) ** 2
    return np.where(np.isfinite(costs), costs, np.inf)


def macs(targets: PairingTargets, shapes: FloatArray) -> FloatArray:
    """MAC of every identified with every model shape, on the channels that were measured.

    Parameters
    ----------
    targets : PairingTargets
        With the identified shapes.
    shapes : ndarray, shape (n, n_model, n_channels)
        Of the model [-].

    Returns
    -------
    ndarray, shape (n, n_identified, n_model)
        1 for identified modes without a shape [-].
    """
    values = np.ones((len(shapes), len(targets.shapes), shapes.shape[1]))
    for mask, rows in _by_channels(targets):
        seen = shapes if mask.all() else shapes * mask
        values[:, rows] = modal_assurance_criterion(targets.shapes[rows], seen)
    return values


@lru_cache(maxsize=8)
def _by_channels(targets: PairingTargets) -> tuple[tuple[FloatArray, IndexArray], ...]:
    """The channels of which some identified modes have a shape, and those modes."""
    masks, which = np.unique(targets.available, axis=0, return_inverse=True)
    rows = [np.flatnonzero(which.ravel() == n) for n in range(len(masks))]
    return tuple((mask, row) for mask, row in zip(masks, rows, strict=True) if mask.any())


def assigned(
    costs: FloatArray, targets: PairingTargets, ratios: FloatArray, rejection: float
) -> Pairing:
    """The cheapest assignment of identified to model modes, each used once.

    Parameters
    ----------
    costs : ndarray, shape (n_identified, n_model)
        Of every pair [-].
    targets : PairingTargets
        With the weights of the identified modes.
    ratios : ndarray, shape (3,)
        k / nominal at which the costs were computed [-].
    rejection : float
        Cost of leaving a mode alone [-].

    Notes
    -----
    Leaving a mode alone costs `rejection`, so a pair that costs more is never made; clipping the
    costs there has the same effect in the Hungarian algorithm as a column of dummies.
    """
    clipped = np.minimum(costs, rejection)
    rows, columns = linear_sum_assignment((clipped - rejection) * targets.weights[:, None])
    model_modes = np.full(len(costs), -1)
    kept = clipped[rows, columns] < rejection
    model_modes[rows[kept]] = columns[kept]
    each = np.full(len(costs), rejection)
    each[rows] = clipped[rows, columns]
    weights = targets.weights * (targets.judged if targets.judged.any() else 1.0)
    total = weights.sum()
    return Pairing(
        ratios=ratios,
        model_modes=tuple(model_modes.tolist()),
        total_cost=float(each @ targets.weights),
        cost=float((each * weights).sum() / total),
        paired_share=float(((model_modes >= 0) * weights).sum() / total),
    )


class PairingSearch:
    """Finds the pairing of lowest cost over the whole prior.

    The draws of the prior and their modes don't depend on the measurements: they are computed
    once and serve every window. The model follows its modes from nominal stiffness.
    """

    def __init__(
        self,
        forward: ForwardModel,
        prior: Prior,
        settings: PairingSettings,
        generator: np.random.Generator,
    ) -> None:
        self._forward = forward
        self._prior = prior
        self._settings = settings
        draws = prior.spread(settings.search_draws, generator)
        modes = forward.modal(prior.stiffness(draws))
        self._draws = draws
        self._modes = modes

    def best(self, targets: PairingTargets, start: FloatArray | None = None) -> Pairing:
        """The cheapest pairing at the finest tolerance.

        Parameters
        ----------
        targets : PairingTargets
            The identified modes.
        start : ndarray, shape (3,), optional
            Ratios to refine as well, e.g. the last posterior's median [-]. It is one start among
            others: a wrong one cannot win against a cheaper one.
        """
        widest, *narrower = self._settings.tolerances
        tried = self._followed(targets, self._draws[self._cheapest_draws(targets)], (widest,))
        tried.sort(key=lambda pairing: pairing.total_cost)
        starts = [pairing.ratios for pairing in tried[: self._settings.refined]]
        if start is not None:
            starts.append(start)
        ends = self._followed(targets, np.array(starts), narrower or (widest,))
        return min(ends, key=lambda pairing: pairing.total_cost)

    def refined(self, targets: PairingTargets, ratios: FloatArray) -> Pairing:
        """The pairing found by following the cost downhill from ratios, (3,), while the tolerance
        shrinks."""
        return self._followed(targets, ratios[None], self._settings.tolerances)[0]

    def _cheapest_draws(self, targets: PairingTargets) -> list[int]:
        """The draws of lowest total cost, cheapest first.

        No assignment costs less than each mode's cheapest partner would, shared or not:
        in the order of that bound most draws need no assignment at all.
        """
        settings = self._settings
        costs = pairing_costs(targets, self._modes, settings.tolerances[0], settings.mac_scale)
        bounds = np.minimum(costs.min(axis=2), settings.rejection) @ targets.weights
        found: list[tuple[float, int]] = []
        for number in np.argsort(bounds, kind="stable"):
            if len(found) >= settings.tried and bounds[number] > found[settings.tried - 1][0]:
                break
            draw = assigned(costs[number], targets, self._draws[number], settings.rejection)
            insort(found, (draw.total_cost, int(number)))
        return [number for _, number in found[: settings.tried]]

    def _followed(
        self, targets: PairingTargets, starts: FloatArray, tolerances: Sequence[float]
    ) -> list[Pairing]:
        """The end of each way downhill from starts, (m, 3); the model is asked for all at once."""
        ratios = starts
        for tolerance in tolerances:
            pairings = self._pairings(targets, ratios, tolerance)
            walking = list(range(len(pairings)))
            for _ in range(self._settings.steps):
                steps = self._steps(targets, [pairings[n] for n in walking], tolerance)
                walking = [n for n, step in zip(walking, steps, strict=True) if step is not None]
                for n, step in zip(walking, filter(None, steps), strict=True):
                    pairings[n] = step
                if not walking:
                    break
            ratios = np.array([pairing.ratios for pairing in pairings])
        return pairings

    def _pairings(
        self, targets: PairingTargets, ratios: FloatArray, tolerance: float
    ) -> list[Pairing]:
        """Assignments at (n, 3) ratios; those outside the prior have infinite cost."""
        supported, modes = modal_where_supported(self._forward, self._prior, ratios)
        nowhere = (-1,) * len(targets.log_frequencies)
        pairings = [Pairing(each, nowhere, np.inf, np.inf, 0.0) for each in ratios]
        if modes is None:
            return pairings
        costs = pairing_costs(targets, modes, tolerance, self._settings.mac_scale)
        for number, each in zip(np.flatnonzero(supported), costs, strict=True):
            if np.isfinite(each).any():
                pairings[number] = assigned(each, targets, ratios[number], self._settings.rejection)
        return pairings

    def _steps(
        self, targets: PairingTargets, pairings: Sequence[Pairing], tolerance: float
    ) -> list[Pairing | None]:
        """For each pairing a cheaper one, one Gauss-Newton step in ln k further; None for none."""
        directions = self._directions(targets, pairings, tolerance)
        ratios = np.array([pairing.ratios for pairing in pairings])
        trials = ratios[:, None] * np.exp(STEP_LENGTHS[:, None] * directions[:, None])
        ends = self._pairings(targets, trials.reshape(-1, 3), tolerance)
        found: list[Pairing | None] = []
        for number, pairing in enumerate(pairings):
            of_one = ends[number * len(STEP_LENGTHS) : (number + 1) * len(STEP_LENGTHS)]
            best = min(of_one, key=lambda trial: trial.total_cost)
            found.append(best if best.total_cost < pairing.total_cost - 1e-6 else None)
        return found

    def _directions(
        self, targets: PairingTargets, pairings: Sequence[Pairing], tolerance: float
    ) -> FloatArray:
        """(m, 3) of ln k: least-squares steps of the residuals' linearisation."""
        ratios = np.array([pairing.ratios for pairing in pairings])
        steps = np.exp(DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)]))
        points = (ratios[:, None] * steps).reshape(-1, 3)
        modes = self._forward.modal(self._prior.stiffness(points))
        frequencies = modes.frequencies.reshape(len(pairings), len(steps), -1)
        mac = macs(targets, modes.shapes).reshape(
            len(pairings), len(steps), -1, frequencies.shape[2]
        )
        found = np.zeros((len(pairings), 3))
        for number, pairing in enumerate(pairings):
            residuals = self._residuals(
                targets, pairing, frequencies[number], mac[number], tolerance
            )
            jacobian = (residuals[1:] - residuals[0]).T / DIFFERENCE
            if np.all(np.isfinite(jacobian)) and jacobian.size:
                step = np.linalg.lstsq(jacobian, -residuals[0], rcond=1e-6)[0]
                found[number] = step * min(1.0, 0.5 / max(float(np.abs(step).max()), 1e-300))
        return found

    def _residuals(
        self,
        targets: PairingTargets,
        pairing: Pairing,
        frequencies: FloatArray,
        mac: FloatArray,
        tolerance: float,
    ) -> FloatArray:
        """(n, 2 n_paired): square roots of the pairs' costs.

        frequencies, mac   (n, n_model) [Hz], (n, n_identified, n_model) [-]
        """
        identified = np.flatnonzero(np.array(pairing.model_modes) >= 0)
        model = np.array(pairing.model_modes)[identified]
        frequency = np.log(frequencies[:, model]) - targets.log_frequencies[identified]
        root = np.sqrt(targets.weights[identified])
        unlike = (1 - mac[:, identified, model]) / self._settings.mac_scale
        return np.hstack([root * frequency / tolerance, root * unlike])
