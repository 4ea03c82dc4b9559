"""The modes of one turbine at a point, and how the identified ones differ from them.

A point is one vector u of `prior.JointCoordinates`: springs, figures, water level and sensors.
Which identified mode is which mode of the model is decided anew at each point.
"""

from dataclasses import dataclass, replace
from typing import Self

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
from pipeline.updating.structural.prior import GaussianBelief, JointCoordinates
from pipeline.updating.structural.sensors.figures import SensorReadings
from sensors.arrays import FloatArray
from sensors.dynamics.figure_model import FigureModel
from sensors.dynamics.figure_modes import FigureModes, Linearisation
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import varied

FINEST_TOLERANCE = 0.004  # of the pairing at the end, where the description holds [-]
UNLIKE_COST = 9.0  # of a shape that is left out because it is not its partner's: as much as of a
# mode without a partner
ROUGH_FIGURES = 3.0  # how much farther figures of a description that does not hold may be off: not
# only what was drawn of it is wrong, also what was left out; chosen on tests.outside's `detailed`
# structure, seeds 20000 to 20005 [-]
MOST_CURVED = 0.005  # of ln f, off a straight line at a metre of water: modes' own are below .0006;
# beyond, the mode is not seen there and another one was taken for it


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

    @property
    def misfit(self) -> float:
        """The excess by which fits with and without a sensor's fault are compared: a shape that is
        left out must not count as one that fits."""
        return self.excess + UNLIKE_COST * self.comparison.unlike_shapes


class JointModel:
    """What identified modes are compared with, at any point of the springs, figures and level."""

    def __init__(
        self,
        model: FigureModel,
        coordinates: JointCoordinates,
        *,
        likelihood: LikelihoodSettings,
        pairing: PairingSettings,
        sensors: SensorReadings | None = None,
    ) -> None:
        self.model = model
        self.sensors = sensors or SensorReadings((), len(model.layout.channels))
        self.coordinates = coordinates
        self.likelihood = likelihood
        self._pairing = pairing
        self._reach = float(np.nanmax(self._modes(coordinates.origin[None]).frequencies))
        self.tolerance = FINEST_TOLERANCE
        self.rise = 0.0  # of the water in the evidence above the model's level [m]

    def with_level_std(self, level_std: float) -> Self:
        """The same with another uncertainty of the water's level [m]."""
        if level_std == self.coordinates.level_std:
            return self
        return self._with(self.coordinates.with_level_std(level_std))

    @property
    def is_rough(self) -> bool:
        """Whether modes find their partners only within a wider tolerance."""
        return self.tolerance > FINEST_TOLERANCE

    def with_tolerance(self, tolerance: float) -> Self:
        """The same that pairs modes whose frequencies differ by more, at the end too [-]; where
        that takes it for a rough description, with wider priors of the figures."""
        other = self._with(self.coordinates)
        other.tolerance = tolerance
        if other.is_rough != self.is_rough:
            factor = ROUGH_FIGURES if other.is_rough else 1 / ROUGH_FIGURES
            other.coordinates = self.coordinates.with_wider_figures(factor)
        return other

    def with_belief(self, belief: GaussianBelief) -> Self:
        """The same with another prior of some coordinates."""
        return self._with(self.coordinates.with_belief(belief))

    def with_rise(self, rise: float) -> Self:
        """The same for evidence whose water stood that much above the model's level [m]."""
        other = self._with(self.coordinates)
        other.rise = rise
        return other

    def with_prior(self, place: int, mean: float, std: float) -> Self:
        """The same with another prior of one coordinate."""
        return self._with(self.coordinates.with_prior(place, mean, std))

    def _with(self, coordinates: JointCoordinates) -> Self:
        other = object.__new__(type(self))
        other.__dict__.update(self.__dict__)
        other.coordinates = coordinates
        return other

    def _modes(self, u: FloatArray) -> FigureModes:
        c = self.coordinates
        return self.model.modes(c.springs(u), c.departures(u), c.level(u))

    def targets(self, evidence: ModalEvidence) -> PairingTargets:
        """The identified modes as the pairing sees them."""
        return PairingTargets.of(evidence.modes, evidence.n_windows, reach=self._reach)

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
        return self._at_level(u, 0.0)

    def _at_level(self, u: FloatArray, rise: float) -> Linearisation | None:
        """The same with the water that much above the point's level [m]."""
        point = self.coordinates.point(u)
        modes = self.model.linearised(
            point.theta,
            point.departures,
            point.level + self.rise + rise,
            self.sensors.placement(self.coordinates.sensors(u)),
        )
        return None if modes is None else self._as_read(modes, u)

    def _as_read(self, modes: Linearisation, u: FloatArray) -> Linearisation:
        """Modes and derivatives by u, (n_modes, n_channels, n_dim), by channels with gains."""
        z, slopes = self.coordinates.sensors(u), self.coordinates.slopes(u)
        gains = self.sensors.gains(z)
        readings = modes.readings * gains
        by_sensor = self.sensors.slopes(z, modes.readings, modes.by_heading, modes.by_height)
        by_u = modes.reading_slopes @ slopes * gains[:, None]
        by_u[..., by_u.shape[-1] - by_sensor.shape[-1] :] += by_sensor
        places = np.argmax(np.abs(readings), axis=1)[:, None]
        return replace(
            modes,
            shapes=np.real(readings / np.take_along_axis(readings, places, axis=1)),
            readings=readings,
            reading_slopes=by_u,
            log_frequency_slopes=modes.log_frequency_slopes @ slopes,
        )

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

    def partners_in_water(self, u: FloatArray, middle: Linearisation) -> list[PartnerInWater]:
        """Each of the modes at a point with the water a metre lower and higher."""
        n = len(middle.frequencies)
        logs, shapes = np.empty((3, n)), np.empty((3, n, middle.shapes.shape[1]))
        for row, rise in enumerate((-1.0, 0.0, 1.0)):
            there = self._at_level(u, rise)
            if there is None:
                there, places = middle, np.arange(n)
            else:
                places = continued(middle, there)
            logs[row], shapes[row] = np.log(there.frequencies[places]), there.shapes[places]
        for mode in np.flatnonzero(np.abs(logs[0] + logs[2] - 2 * logs[1]) > 2 * MOST_CURVED):
            lost = int(np.argmax(np.abs(logs[:, mode] - logs[1, mode])))  # another stands in for it
            logs[lost, mode] = 2 * logs[1, mode] - logs[2 - lost, mode]
            shapes[lost, mode] = shapes[1, mode]
        return [PartnerInWater(logs[:, i], shapes[:, i]) for i in range(n)]


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
