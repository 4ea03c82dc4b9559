"""What changes during a simulation: weather, operation, tide, foundation.

Everything is a function of the time since the first sample; before it, the beginning holds.
"""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.constants import DAY
from sensors.errors import InputError
from sensors.loads.operating_states import OperatingState, SteadyState, steady_state
from sensors.loads.waves import require_sea_state
from sensors.settings import NO_KEY


class ScheduleError(InputError):
    """A schedule that is not possible; the message names what and its value."""


@dataclass(frozen=True, slots=True)
class ScheduleStep:
    """Weather and operation from a time on.

    Figures run straight to the next step that gives them; the operating state holds until the
    next one. What a step leaves out goes on.
    """

    at: float = 0.0
    """Time since the first sample [s]."""

    state: OperatingState | None = None
    """"parked", "idling", "start", "operating" or "stop"."""
    wind_speed: float | None = None
    """Mean wind at the hub [m/s]; needs `[simulation.wind]`."""

    significant_wave_height: float | None = None
    """Significant wave height [m]; needs `[simulation.sea]`."""

    peak_period: float | None = None
    """Peak period [s]; needs `[simulation.sea]`."""

    yaw: float | None = None
    """Yaw of the nacelle, from tower axis x towards y [deg]. It turns straight from one step's
    number to the next one's: from 350 to 370 through north, from 350 to 10 the long way."""

    def __post_init__(self) -> None:
        if self.wind_speed is not None and not self.wind_speed > 0:
            raise ScheduleError(
                f"stage at {self.at:g} s: wind_speed is {self.wind_speed:g}; it must be positive"
            )
        require_sea_state(
            f"stage at {self.at:g} s:", self.significant_wave_height, self.peak_period
        )


@dataclass(frozen=True, slots=True)
class StiffnessEvent:
    """A sudden change of the foundation: scour in a storm, a fill of sand."""

    at: float
    """Time since the first sample [s]."""

    factors: tuple[float, float, float]
    """Factors of k11, k22, k12 from then on [-]."""

    def __post_init__(self) -> None:
        if not min(self.factors) > 0:
            raise ScheduleError(
                f"stiffness event at {self.at:g} s: factors are "
                f"{', '.join(f'{factor:g}' for factor in self.factors)}; they must be positive"
            )


@dataclass(frozen=True, slots=True)
class FoundationSchedule:
    """How the foundation's stiffness changes."""

    drift_per_day: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Drift per day of k11, k22, k12, relative."""

    events: tuple[StiffnessEvent, ...] = ()
    softening: float = 0.0
    """Loss of all three at `softening_displacement` of rms motion [-]."""

    softening_displacement: float = field(default=0.01, metadata=NO_KEY)
    """Rms of the mudline over a minute [m]."""

    def __post_init__(self) -> None:
        if not 0.0 <= self.softening < 0.5:
            raise ScheduleError(f"foundation softening is {self.softening:g}; it is 0 to 0.5")
        if not self.softening_displacement > 0:
            raise ScheduleError(
                f"foundation softening_displacement is {self.softening_displacement:g} m; "
                "it must be positive"
            )

    def factors(self, time: float, motion: float = 0.0) -> FloatArray:
        """k11, k22, k12 over those at the beginning, (3,) [-].

        Parameters
        ----------
        time : float
            Since the beginning [s].
        motion : float, optional
            Rms of the mudline [m].

        Notes
        -----
        The softening is that of an equivalent linear spring: hysteretic soil gives way in
        proportion to a small amplitude.
        """
        factors = 1.0 + np.array(self.drift_per_day) * max(time, 0.0) / DAY
        for event in self.events:
            if time >= event.at:
                factors = factors * np.array(event.factors)
        soft = self.softening * min(motion / self.softening_displacement, 1.0)
        result: FloatArray = factors * (1.0 - soft)
        return result


@dataclass(frozen=True, slots=True)
class Tide:
    """A water level that rises and falls, and a foundation that rides with it."""

    amplitude: float = 0.0
    """Amplitude [m]."""

    period: float = 12.42 * 3600.0
    """Period of the moon's half-daily tide [s]."""

    stiffness_share: float = 0.0
    """Stiffness share of all springs at high water, relative [-]."""

    def __post_init__(self) -> None:
        if not self.period > 0:
            raise ScheduleError(f"tide period is {self.period:g} s; it must be positive")

    def phase(self, time: float) -> float:
        """−1 at low water, 1 at high water; 0 and rising at the first sample."""
        return float(np.sin(2 * np.pi * max(time, 0.0) / self.period))


@dataclass(frozen=True, slots=True)
class Schedule:
    """Everything of a simulation that depends on time alone."""

    stages: tuple[ScheduleStep, ...] = ()
    foundation: FoundationSchedule = field(default_factory=FoundationSchedule)
    tide: Tide = field(default_factory=Tide)
    mean_level: float = 0.0
    """Mean level of the water [m]."""

    wind_speed: float = 2.0
    """Wind speed where no step gives one [m/s]."""

    significant_wave_height: float = 0.0
    """Significant wave height [m]."""

    peak_period: float = 8.0
    """Peak period [s]."""

    def __post_init__(self) -> None:
        times = [step.at for step in self.stages]
        for before, after in pairwise(times):
            if not after > before:
                raise ScheduleError(
                    f"stage at {after:g} s comes after the one at {before:g} s; "
                    "stages are in order of time"
                )

    def figure(self, name: str, time: float) -> float:
        """Return a figure at a time: straight between the steps that give it."""
        given = [
            (step.at, getattr(step, name))
            for step in self.stages
            if getattr(step, name) is not None
        ]
        if not given:
            return float(getattr(self, name, 0.0))
        times, values = zip(*given, strict=True)
        return float(np.interp(time, times, values))

    def state(self, time: float) -> OperatingState:
        """Return what the turbine does; parked where no step states it."""
        state: OperatingState = "parked"
        for step in self.stages:
            if step.at <= max(time, 0.0) and step.state is not None:
                state = step.state
        return state

    def running_share(self, time: float) -> float:
        """0 with the blades feathered, 1 in operation.

        A start or stop takes until the next step.
        """
        state = self.state(time)
        if state in ("start", "stop"):
            begin = max(s.at for s in self.stages if s.at <= max(time, 0.0) and s.state)
            end = min((s.at for s in self.stages if s.at > begin and s.state), default=begin + 60.0)
            passed = min(max((time - begin) / (end - begin), 0.0), 1.0)
            return passed if state == "start" else 1.0 - passed
        return 1.0 if state == "operating" else 0.0

    def rotor(self, time: float) -> SteadyState:
        """Return what the rotor does in the mean wind."""
        return steady_state(
            self.figure("wind_speed", time),
            self.running_share(time),
            idling=self.state(time) != "parked",
        )

    def level(self, time: float) -> float:
        """Return the water level above the mean [m]."""
        return self.mean_level + self.tide.amplitude * self.tide.phase(time)

    def stiffness_factors(self, time: float, motion: float = 0.0) -> FloatArray:
        """k11, k22, k12 over those at the beginning, (3,) [-]; motion: rms of the mudline [m]."""
        factors = self.foundation.factors(time, motion)
        return factors * (1.0 + self.tide.stiffness_share * self.tide.phase(time))

    @property
    def turns(self) -> bool:
        """Whether the rotor ever turns."""
        return any(step.state not in (None, "parked") for step in self.stages)

    @property
    def yaws(self) -> bool:
        """Whether the nacelle is ever turned."""
        return any(step.yaw for step in self.stages)

    @property
    def highest_level(self) -> float:
        """Highest water level of the tide [m]."""
        return self.mean_level + abs(self.tide.amplitude)

    def largest(self, name: str) -> float:
        """Return a figure's largest value."""
        given = [getattr(s, name) for s in self.stages if getattr(s, name) is not None]
        return float(max(given or [getattr(self, name)]))


def scada_samples(
    schedule: Schedule, *, turbine: str, start_ns: int, period: float, duration: float
) -> Iterator[ScadaSample]:
    """Yield what the controller of a simulated turbine reports, from the first sample on.

    Parameters
    ----------
    start_ns : int
        Sensor clock at the first sample [ns since 1970-01-01 UTC].
    period : float
        Time between two samples [s].
    duration : float
        Duration of the session [s].
    """
    for number in range(int(duration / period - 1e-9) + 1):
        time = number * period
        rotor = schedule.rotor(time)
        yield ScadaSample(
            turbine=turbine,
            time_ns=start_ns + round(time * NANOSECONDS),
            state=schedule.state(time),
            wind_speed=schedule.figure("wind_speed", time),
            rotor_speed=rotor.rotor_speed,
            pitch=rotor.pitch,
            yaw=schedule.figure("yaw", time),
            power=rotor.power,
            water_level=schedule.level(time),
        )
