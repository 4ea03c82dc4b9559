"""The simulated structure over time: foundation, water, pitch and air change it."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.damped_modes import DampedSystem, damped_system
from sensors.dynamics.responses.damped_response import DampedResponse
from sensors.dynamics.simulated_modes import (
    ModalDamping,
    ObservedModes,
    StructureModes,
    observed_modes,
    structure_modes,
)
from sensors.loads import Rotor, Wind, aerodynamic_damping, rotor_damping, thrust_slope
from sensors.loads.operating_states import FINE_PITCH
from sensors.simulation.schedule import Schedule
from sensors.structure.assembly import assemble
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings
from sensors.structure.structural_model import StructuralModel

# The structure is solved again when one of these has changed by as much.
STIFFNESS_STEP = 2e-4  # of a spring, relative: 1e-5 of a frequency at most
LEVEL_STEP = 0.02  # of the water [m]
WIND_STEP = 0.25  # of the mean wind that damps [m/s]


@dataclass(frozen=True, slots=True)
class _Condition:
    """What the structure depends on."""

    factors: tuple[float, float, float]
    """Factors of k11, k22, k12 [-]."""

    level: float
    """Level of the water [m]."""

    wind_speed: float
    """Wind speed [m/s]."""

    slope: float
    """dT/dV of the turning rotor [N·s/m]."""

    running: bool
    """Blades at fine pitch."""

    def is_near(self, other: "_Condition") -> bool:
        change = np.abs(np.array(self.factors) / np.array(other.factors) - 1.0).max()
        return bool(
            change < STIFFNESS_STEP
            and abs(self.level - other.level) < LEVEL_STEP
            and abs(self.wind_speed - other.wind_speed) < WIND_STEP
            and abs(self.slope - other.slope) <= 0.05 * max(self.slope, other.slope)
            and self.running == other.running
        )


class ChangingStructure:
    """The structure at any time of a simulation, solved when it has changed enough to matter.

    A turning rotor is the locked one at fine pitch with the damping of its thrust: its whirl, the
    gyroscopic coupling and the stiffening by rotation are left out.
    """

    def __init__(
        self,
        description: TurbineDescription,
        layout: SensorLayout,
        *,
        springs: FoundationSprings,
        schedule: Schedule,
        damping: ModalDamping,
        wind: Wind | None,
        rotor: Rotor,
        tube_refinement: int,
        highest_frequency: float,
    ) -> None:
        self._description = description
        self._layout = layout
        self._stiffness = springs.stiffness
        self._schedule = schedule
        self._damping = damping
        self._wind = wind
        self._rotor = rotor
        self._refinement = tube_refinement
        self._highest_frequency = highest_frequency
        self._distribution: FloatArray | None = None
        self._beginning = self._condition(0.0, 0.0)
        self.model = self._assembled(self._beginning)
        self.modes: StructureModes = self._solved(self.model)
        self._solution: tuple[_Condition, DampedSystem] | None = None

    def bear(self, distribution: FloatArray) -> None:
        """The loads that act, (n_dofs, n_loads): forces per unit of each."""
        self._distribution = distribution
        self.observed: ObservedModes = observed_modes(
            self.model, self.modes, self._layout, distribution
        )

    @property
    def is_simple(self) -> bool:
        """Whether modal damping is all there is, and nothing changes."""
        schedule = self._schedule
        changes = (
            schedule.tide != type(schedule.tide)()
            or schedule.foundation != type(schedule.foundation)()
            or schedule.turns
        )
        return self._wind is None and not changes

    def at(self, time: float, motion: float = 0.0) -> DampedSystem:
        """Return the structure at a time [s] under a motion of the mudline, rms [m]."""
        condition = self._condition(time, motion)
        if self._solution is None or not condition.is_near(self._solution[0]):
            self._solution = (condition, self._system(condition))
        return self._solution[1]

    def update(self, response: DampedResponse, time: float, motion: float) -> None:
        """Let the response go on with the structure as it is now, where that has changed."""
        system = self.at(time, motion)
        if system is not response.system:
            response.change(system)

    def mudline(self, response: DampedResponse) -> FloatArray:
        """Return the mudline's displacement over the response's last steps, (2, n_steps) [m]."""
        rows = np.zeros((2, self.model.n_dofs))
        rows[[0, 1], self.model.spring_dofs[:, 0]] = 1.0
        return response.displacements(rows)

    def _condition(self, time: float, motion: float) -> _Condition:
        schedule = self._schedule
        k11, k22, k12 = schedule.stiffness_factors(time, motion).tolist()
        share = schedule.running_share(time)
        speed = schedule.figure("wind_speed", time)
        slope = thrust_slope(self._rotor, schedule.rotor(time), speed) if share > 0 else 0.0
        return _Condition((k11, k22, k12), schedule.level(time), speed, slope, share > 0.5)

    def _assembled(self, condition: _Condition) -> StructuralModel:
        description = self._description
        if description.water is not None and condition.level != description.water.level:
            description = description.with_water_level(condition.level)
        if condition.running and description.blades is not None:
            description = replace(description, blades=replace(description.blades, pitch=FINE_PITCH))
        factors = np.array(condition.factors)
        return assemble(
            description, stiffness=self._stiffness * factors, tube_refinement=self._refinement
        )

    def _solved(self, model: StructuralModel) -> StructureModes:
        return structure_modes(model, self._damping, highest_frequency=self._highest_frequency)

    def _system(self, condition: _Condition) -> DampedSystem:
        assert self._distribution is not None
        model, modes, observed = self.model, self.modes, self.observed
        if condition != self._beginning:
            model = self._assembled(condition)
            modes = self._solved(model)
            observed = observed_modes(model, modes, self._layout, self._distribution)
        dampers = None
        if self._wind is not None:
            dampers = aerodynamic_damping(model, self._wind, condition.wind_speed)
            if condition.slope > 0:
                dampers = dampers + rotor_damping(model, condition.slope)
        return damped_system(model, modes, observed, dampers)


def rms_motion(parts: Sequence[FloatArray]) -> float:
    """Return the root mean square of a motion about its mean, both directions together [m].

    Parameters
    ----------
    parts : sequence of ndarray, each of shape (2, n_steps)
        Displacements that follow one another [m].
    """
    motion = np.concatenate(parts, axis=1)
    return float(np.sqrt(np.sum(np.var(motion, axis=1))))
