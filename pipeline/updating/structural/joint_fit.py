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
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import PartnerInWater
from pipeline.updating.likelihood.likelihood import LikelihoodSettings, observations
from pipeline.updating.likelihood.mixtures import with_mixtures
from pipeline.updating.likelihood.mode_errors import ModeErrors, mode_errors
from pipeline.updating.likelihood.pairing import (
    PairingSettings,
    PairingTargets,
    assigned,
    macs,
    pairing_costs,
)
from pipeline.updating.prior import UpdatingError
from pipeline.updating.structural.prior import N_SPRINGS, GaussianBelief, JointCoordinates
from pipeline.updating.structural.sensors.figures import SensorReadings
from sensors.arrays import FloatArray
from sensors.dynamics.figure_model import FigureModel
from sensors.dynamics.figure_modes import FigureModes, Linearisation
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import varied

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
FINEST_TOLERANCE = 0.004  # of the pairing at the end, where the description holds [-]
ROUGH_FIGURES = 3.0  # how much farther figures of a description that does not hold may be off: not
# only what was drawn of it is wrong, also what was left out; chosen on tests.outside's `detailed`
# structure, seeds 20000 to 20005 [-]
LONGEST_SPRING_STEP = np.array([0.35, 0.35, 0.8])  # of the springs' coordinates [-]
LONGEST_FIGURE_STEP = 1.5  # [prior standard deviations]
MOST_DESCENT_STEPS = 25  # at the data's own errors
ROUGHLY = 4  # one in so many drawn structures tells a right wiring from a wrong one
SETTLED_STEP = 0.02  # step of the fitted values at which the descent ends [standard deviations]


@dataclass(frozen=True, slots=True)
class JointFitSettings:
    """Starts and errors of the joint fit."""

    most_starts: int = 12
    good_cost: float = 1.5  # per degree of freedom: no further start is tried
    search_draws: int = 400

    def __post_init__(self) -> None:
        if not (self.most_starts >= 1 and self.search_draws >= 1 and self.good_cost > 0):
            raise UpdatingError("joint fit settings must be positive")


@dataclass(frozen=True, slots=True, eq=False)
class JointPeak:
    """The end of one descent."""

    u: FloatArray
    """(n_dim,)"""
    comparison: ModeErrors
    cost: float
    """Misfit, prior and rejected modes"""
    degrees: int
    """p − 3 of freedom"""

    @property
    def relative_cost(self) -> float:
        """Cost per degree of freedom."""
        return self.cost / max(self.degrees, 1)

    @property
    def excess(self) -> float:
        """Cost beyond chance: what is not compared must not count as a gain."""
        return self.cost - self.degrees


class JointFit:
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
        self.model = model
        n_channels = len(model.layout.channels)
        self.sensors = sensors or SensorReadings((), n_channels)
        self.coordinates = coordinates
        self.likelihood = likelihood
        self._pairing = pairing
        self.settings = settings or JointFitSettings()
        self._reach = float(np.nanmax(self._modes(coordinates.origin[None]).frequencies))
        self.tolerance = FINEST_TOLERANCE
        self.rise = 0.0  # of the water in the evidence above the model's level [m]
        self._draws = coordinates.draws(self.settings.search_draws, generator, spread=0.9)
        # modes of the draws by the level's uncertainty, solved when a fit needs them; fits with
        # other priors share them
        self._drawn_modes: dict[float, FigureModes] = {}

    def with_level_std(self, level_std: float) -> "JointFit":
        """The same with another uncertainty of the water's level [m]."""
        if level_std == self.coordinates.level_std:
            return self
        return self._with(self.coordinates.with_level_std(level_std))

    @property
    def is_rough(self) -> bool:
        """Whether modes find their partners only within a wider tolerance."""
        return self.tolerance > FINEST_TOLERANCE

    def with_tolerance(self, tolerance: float) -> "JointFit":
        """The same that pairs modes whose frequencies differ by more, at the end too [-]; where
        that takes it for a rough description, with wider priors of the figures."""
        other = self._with(self.coordinates)
        other.tolerance = tolerance
        if other.is_rough != self.is_rough:
            factor = ROUGH_FIGURES if other.is_rough else 1 / ROUGH_FIGURES
            other.coordinates = self.coordinates.with_wider_figures(factor)
        return other

    def with_belief(self, belief: GaussianBelief) -> "JointFit":
        """The same with another prior of some coordinates."""
        return self._with(self.coordinates.with_belief(belief))

    def with_rise(self, rise: float) -> "JointFit":
        """The same for evidence whose water stood that much above the model's level [m]."""
        other = self._with(self.coordinates)
        other.rise = rise
        return other

    def with_prior_std(self, place: int, std: float) -> "JointFit":
        """The same with another prior standard deviation of one coordinate."""
        return self._with(self.coordinates.with_prior_std(place, std))

    def _with(self, coordinates: JointCoordinates) -> "JointFit":
        other: JointFit = object.__new__(JointFit)
        other.__dict__.update(self.__dict__)
        other.coordinates = coordinates
        return other

    def settled(
        self, evidence: ModalEvidence, start: FloatArray, *, sigma: float = 0.0
    ) -> JointPeak | None:
        """The peak downhill from a start that is near; None where it cannot stand."""
        return self._settled(evidence, self.targets(evidence), start, sigma)

    def _modes(self, u: FloatArray) -> FigureModes:
        c = self.coordinates
        return self.model.modes(c.springs(u), c.departures(u), c.level(u))

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

        starts      (n_dim,) to be tried first, e.g. the last window's peak
        sigma       model discrepancy beyond the floors [-]
        good_cost   per degree of freedom, at which no further start is tried; None: the settings'
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

    def targets(self, evidence: ModalEvidence) -> PairingTargets:
        """The identified modes as the pairing sees them."""
        return PairingTargets.of(evidence.modes, evidence.n_windows, reach=self._reach)

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

    def pairing_bound(self, evidence: ModalEvidence) -> float:
        """The lowest pairing cost of some drawn structures, for a rough comparison of evidence."""
        return float(self._bounds(self.targets(evidence), every=ROUGHLY).min())

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

    def variances(self, found: ModeErrors, sigma: float) -> FloatArray:
        """(p,) S + F + σ² R."""
        return found.variances + found.floors + sigma**2 * found.reference

    def structure_at(self, u: FloatArray) -> TurbineDescription:
        """The description with the figures of a point; its water level is the described one."""
        described = self.model.described
        if described.water is not None:
            water = replace(described.water, inside=self.model.flooded)
            described = replace(described, water=water)
        names = [figure.name for figure in self.coordinates.figures]
        departures = self.coordinates.departures(u).tolist()
        return varied(described, dict(zip(names, departures, strict=True)))

    def partners_in_water(self, peak: JointPeak) -> list[PartnerInWater]:
        """Each mode of the peak's comparison with the water a metre lower and higher."""
        point, middle = self.coordinates.point(peak.u), peak.comparison.linearisation
        n = len(middle.frequencies)
        logs, shapes = np.empty((3, n)), np.empty((3, n, middle.shapes.shape[1]))
        for row, rise in enumerate((-1.0, 0.0, 1.0)):
            level = point.level + self.rise + rise
            there = self.model.linearised(point.theta, point.departures, level)
            if there is None:
                there, places = middle, np.arange(n)
            else:
                there = self._as_read(there, peak.u)
                places = continued(middle, there)
            logs[row], shapes[row] = np.log(there.frequencies[places]), there.shapes[places]
        return [PartnerInWater(logs[:, i], shapes[:, i]) for i in range(n)]

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

    # ---- pairing and errors at one point ------------------------------------------------------

    def compared(
        self, evidence: ModalEvidence, targets: PairingTargets, u: FloatArray, tolerance: float
    ) -> ModeErrors | None:
        """Modes paired and compared at one point; None where it cannot stand or pairs nothing."""
        modes = self.linearised(u)
        if modes is None:
            return None
        drawn = FigureModes(modes.frequencies[None], modes.shapes[None], np.ones(1, dtype=bool))
        costs = pairing_costs(targets, drawn, tolerance, self._pairing.mac_scale)[0]
        pairing = assigned(costs, targets, u, self._pairing.rejection)
        mac = macs(targets, drawn.shapes)[0]
        used = observations(evidence, pairing, modes.frequencies, self.likelihood, mac=mac)
        if not used:
            return None
        found = mode_errors(evidence, pairing, used, modes, self.likelihood)
        return found if self.is_rough else with_mixtures(found)

    def linearised(self, u: FloatArray) -> Linearisation | None:
        """The model's modes at a point as the sensors read them; None where it cannot stand."""
        point = self.coordinates.point(u)
        modes = self.model.linearised(point.theta, point.departures, point.level + self.rise)
        return None if modes is None else self._as_read(modes, u)

    def _as_read(self, modes: Linearisation, u: FloatArray) -> Linearisation:
        """Modes and derivatives by u, (n_modes, n_channels, n_dim), by sensors with these figures.

        A sensor's turn changes what the springs do to its reading by second order: left out.
        """
        z, slopes = self.coordinates.sensors(u), self.coordinates.slopes(u)
        readings, by_sensor = self.sensors.read(z, modes.readings, modes.across, modes.by_height)
        by_u = modes.reading_slopes @ slopes * self.sensors.derived(z)[:, None]
        by_u[..., by_u.shape[-1] - by_sensor.shape[-1] :] += by_sensor
        places = np.argmax(np.abs(readings), axis=1)[:, None]
        return replace(
            modes,
            shapes=np.real(readings / np.take_along_axis(readings, places, axis=1)),
            readings=readings,
            reading_slopes=by_u,
            log_frequency_slopes=modes.log_frequency_slopes @ slopes,
        )


def continued(reference: Linearisation, other: Linearisation) -> NDArray[np.intp]:
    """(n_modes,) which mode of a neighbouring point continues each of the reference's."""
    products = reference.shapes @ other.shapes.T
    norms = np.outer((reference.shapes**2).sum(axis=1), (other.shapes**2).sum(axis=1))
    unlike = (1 - products**2 / norms) / 0.15
    apart = np.log(reference.frequencies)[:, None] - np.log(other.frequencies)
    cost = np.minimum(unlike**2 + (apart / 0.01) ** 2, 1e3)
    places = np.full(len(reference.frequencies), -1)
    rows, columns = linear_sum_assignment(cost)
    places[rows] = columns
    lost = places < 0  # fewer modes there: the nearest stands in
    places[lost] = cost[lost].argmin(axis=1)
    return places
