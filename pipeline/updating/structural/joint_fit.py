"""The joint peak of springs, figures and water level, with the pairing inside the fit.

Which identified mode is which mode of the model depends on the figures: paired at the nominal ones,
a third of the modes are taken for others. So modes are paired again wherever the model is
linearised, with errors that are wide at first and shrink to those of the data, and the descent is
started at several points: the mass of the transition piece makes most of the valleys. An end is
judged by its cost beside its degrees of freedom.

    cost(u) = Σ (h(u) − d)² / (S + F) + Σ (u − u₀)² / P + rejection × modes without a partner

Source: Gauss-Newton with Levenberg's damping, Nocedal and Wright, "Numerical Optimization" (2006),
chapter 10.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.likelihood import LikelihoodSettings
from pipeline.updating.likelihood.mode_errors import ModeErrors
from pipeline.updating.likelihood.pairing import (
    PairingSettings,
    PairingTargets,
    pairing_costs,
)
from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.joint_model import JointModel, JointPeak
from pipeline.updating.structural.prior import N_SPRINGS, JointCoordinates
from pipeline.updating.structural.sensors.figures import SensorReadings
from sensors.arrays import FloatArray
from sensors.dynamics.figure_model import FigureModel
from sensors.dynamics.figure_modes import FigureModes

# extra standard deviations of ln f and of shapes, and the pairing's tolerance of ln f, in turn [-]
ANNEALING = (
    (0.03, 0.30, 0.03),
    (0.02, 0.20, 0.03),
    (0.012, 0.12, 0.015),
    (0.008, 0.08, 0.015),
    (0.005, 0.05, 0.008),
    (0.003, 0.03, 0.008),
    (0.0015, 0.02, 0.004),
)
LARGEST_SQUARE = 9.0  # that one frequency counts in the cost; a shape's components each [-]
FEW_STARTS = 3
LARGEST_COST = 2.5  # per degree of freedom: above, the structure is another one
LONGEST_SPRING_STEP = np.array([0.35, 0.35, 0.8])  # of the springs' coordinates [-]
LONGEST_FIGURE_STEP = 1.5  # [prior standard deviations]
MOST_DESCENT_STEPS = 25  # at the data's own errors
ROUGHLY = 4  # one in so many drawn structures tells a right wiring from a wrong one
SETTLED_STEP = 0.02  # step of the fitted values at which the descent ends [standard deviations]


@dataclass(frozen=True, slots=True)
class JointFitSettings:
    """Starts and errors of the joint fit."""

    most_starts: int = 12
    good_cost: float = 1.5
    """Per degree of freedom: no further start is tried."""
    search_draws: int = 400

    def __post_init__(self) -> None:
        if not (self.most_starts >= 1 and self.search_draws >= 1 and self.good_cost > 0):
            raise UpdatingError("joint fit settings must be positive")


class JointFit(JointModel):
    """Fits springs, figures and level of one turbine to combined modal evidence."""

    def __init__(
        self,
        model: FigureModel,
        coordinates: JointCoordinates,
        *,
        likelihood: LikelihoodSettings,
        pairing: PairingSettings,
        settings: JointFitSettings | None = None,
        generator: np.random.Generator,
        sensors: SensorReadings | None = None,
    ) -> None:
        super().__init__(
            model, coordinates, likelihood=likelihood, pairing=pairing, sensors=sensors
        )
        self.settings = settings or JointFitSettings()
        self._draws = coordinates.draws(self.settings.search_draws, generator, spread=0.9)
        # modes of the draws by the level's uncertainty, solved when a fit needs them; fits with
        # other priors share them
        self._drawn_modes: dict[float, FigureModes] = {}

    def settled(
        self, evidence: ModalEvidence, start: FloatArray, *, sigma: float = 0.0
    ) -> JointPeak | None:
        """The peak downhill from a start that is near; None where it cannot stand."""
        return self._settled(evidence, self.targets(evidence), start, sigma)

    def best(
        self,
        evidence: ModalEvidence,
        starts: Sequence[FloatArray] = (),
        *,
        sigma: float = 0.0,
        good_cost: float | None = None,
        most_starts: int | None = None,
    ) -> JointPeak | None:
        """The cheapest end of descents from several points; None where none can be compared.

        Parameters
        ----------
        evidence : ModalEvidence
            Of all windows.
        starts : sequence of ndarray, shape (n_dim,), optional
            To be tried first, e.g. the last window's peak.
        sigma : float, optional
            Model discrepancy beyond the floors [-].
        good_cost : float, optional
            Per degree of freedom, at which no further start is tried; None: the settings' [-].
        most_starts : int, optional
            That are tried at all; None: the settings'.
        """
        return self._cheapest_end(
            evidence,
            self._starts(evidence, starts),
            best=None,
            sigma=sigma,
            good_cost=good_cost,
            most_starts=most_starts or self.settings.most_starts,
        )

    def improved(
        self,
        evidence: ModalEvidence,
        peak: JointPeak,
        *,
        good_cost: float | None = None,
        starts: Sequence[FloatArray] | None = None,
    ) -> JointPeak:
        """The peak, or a cheaper one from other starts; None: those that few starts leave
        untried."""
        good = self.settings.good_cost if good_cost is None else good_cost
        if peak.relative_cost <= good:
            return peak
        remaining = islice(self._starts(evidence, ()), FEW_STARTS, None)
        most = self.settings.most_starts - FEW_STARTS
        found = self._cheapest_end(
            evidence,
            remaining if starts is None else starts,
            best=peak,
            sigma=0.0,
            good_cost=good,
            most_starts=most,
        )
        return found or peak

    def _cheapest_end(
        self,
        evidence: ModalEvidence,
        starts: Iterable[FloatArray],
        *,
        best: JointPeak | None,
        sigma: float,
        good_cost: float | None,
        most_starts: int,
    ) -> JointPeak | None:
        targets = self.targets(evidence)
        good = self.settings.good_cost if good_cost is None else good_cost
        for start in islice(starts, most_starts):
            end = self.descended(evidence, targets, start, sigma=sigma)
            if end is not None and (best is None or end.excess < best.excess):
                best = end
            if best is not None and best.relative_cost <= good:
                break
        return best

    def _starts(self, evidence: ModalEvidence, given: Sequence[FloatArray]) -> Iterable[FloatArray]:
        yield from given
        origin = self.coordinates.origin
        names = self.coordinates.names
        if "transition_piece" in names:
            piece = names.index("transition_piece")
            for z in (0.0, 1.2, -1.0, 2.2):
                start = origin.copy()
                start[piece] = z
                yield start
        else:
            yield origin
        for row in self._cheapest(self.targets(evidence)):
            yield self._draws[row]

    def _cheapest(self, targets: PairingTargets) -> list[int]:
        """The draws of lowest pairing cost, cheapest first, by each mode's nearest partner."""
        order = np.argsort(self._bounds(targets), kind="stable")
        return [int(row) for row in order[: self.settings.most_starts]]

    def _bounds(self, targets: PairingTargets, every: int = 1) -> FloatArray:
        """(n_draws,) pairing cost of each drawn structure, or of every so many, if modes could
        share partners."""
        level_std = self.coordinates.level_std
        if level_std not in self._drawn_modes:
            self._drawn_modes.clear()  # sets of modes are large, and the last level mostly stays
            self._drawn_modes[level_std] = self._modes(self._draws)
        whole = self._drawn_modes[level_std]
        drawn = FigureModes(
            whole.frequencies[::every], whole.shapes[::every], whole.admissible[::every]
        )
        costs = pairing_costs(targets, drawn, ANNEALING[0][2], self._pairing.mac_scale)
        bounds = np.minimum(costs.min(axis=2), self._pairing.rejection) @ targets.weights
        return np.asarray(bounds)

    def pairing_bound(self, targets: PairingTargets) -> float:
        """The lowest pairing cost of some drawn structures, for a rough comparison of evidence."""
        return float(self._bounds(targets, every=ROUGHLY).min())

    # ---- one descent -----------------------------------------------------------------------

    def descended(
        self,
        evidence: ModalEvidence,
        targets: PairingTargets,
        start: FloatArray,
        *,
        sigma: float = 0.0,
    ) -> JointPeak | None:
        """The peak downhill from a start; None where it leaves what can stand."""
        u = start
        for blur_f, blur_shape, tolerance in ANNEALING:
            found = self.compared(evidence, targets, u, max(tolerance, self.tolerance))
            if found is None:
                return None
            extra = np.where(found.is_frequency, blur_f, blur_shape) ** 2
            u = u + self._bounded(self._step(u, found, sigma, extra, 0.0))
        return self._settled(evidence, targets, u, sigma)

    def _settled(
        self, evidence: ModalEvidence, targets: PairingTargets, u: FloatArray, sigma: float
    ) -> JointPeak | None:
        found = self.compared(evidence, targets, u, self.tolerance)
        if found is None:
            return None
        cost, damping = self._cost(u, found, targets, sigma), 0.0
        for _ in range(MOST_DESCENT_STEPS):
            step = self._bounded(self._step(u, found, sigma, 0.0, damping))
            trial = self.compared(evidence, targets, u + step, self.tolerance)
            trial_cost = np.inf if trial is None else self._cost(u + step, trial, targets, sigma)
            if trial is None or trial_cost > cost + 1e-3:
                damping = max(4 * damping, 0.1)
                if damping > 1e4:
                    break
                continue
            moved = found.jacobian @ step / np.sqrt(self.variances(found, sigma))
            u, found, cost, damping = u + step, trial, trial_cost, damping / 10
            if np.abs(moved).max(initial=0.0) < SETTLED_STEP:
                break
        degrees = len(found.errors) - N_SPRINGS
        return JointPeak(u, found, cost, degrees)

    def judged(self, peak: JointPeak, evidence: ModalEvidence, sigma: float) -> tuple[float, float]:
        """Cost of a peak with another σ, and log |H| there: by what alternatives are weighed."""
        cost = self._cost(peak.u, peak.comparison, self.targets(evidence), sigma)
        D = self.variances(peak.comparison, sigma)
        J = peak.comparison.jacobian
        hessian = (J.T / D) @ J + self.coordinates.prior_precision
        return cost, float(np.linalg.slogdet(hessian)[1])

    def cost_at(self, evidence: ModalEvidence, u: FloatArray) -> float:
        """Cost at a point where it stands; infinite where nothing can be compared."""
        targets = self.targets(evidence)
        found = self.compared(evidence, targets, u, self.tolerance)
        return np.inf if found is None else self._cost(u, found, targets, 0.0)

    def _step(
        self,
        u: FloatArray,
        found: ModeErrors,
        sigma: float,
        extra: FloatArray | float,
        damping: float,
    ) -> FloatArray:
        variances = self.variances(found, sigma) + extra
        weights = found.robust_weights(variances) / variances
        prior = self.coordinates.prior_precision
        hessian = (found.jacobian.T * weights) @ found.jacobian + prior
        gradient = found.jacobian.T @ (weights * found.errors)
        gradient += prior @ (u - self.coordinates.origin)
        hessian += damping * np.diag(np.diag(hessian))
        return np.asarray(-np.linalg.solve(hessian, gradient))

    def _bounded(self, step: FloatArray) -> FloatArray:
        longest = np.full(len(step), LONGEST_FIGURE_STEP)
        longest[:N_SPRINGS] = LONGEST_SPRING_STEP
        return step / max(1.0, float((np.abs(step) / longest).max()))

    def _cost(
        self, u: FloatArray, found: ModeErrors, targets: PairingTargets, sigma: float
    ) -> float:
        squares, _, counts = found.squares(self.variances(found, sigma))
        misfit = float(np.minimum(squares, LARGEST_SQUARE * counts).sum())
        alone = np.array(found.pairing.model_modes) < 0
        lost = float((targets.weights * targets.judged)[alone].sum()) * self._pairing.rejection
        return misfit + lost + self.coordinates.prior_cost(u)
