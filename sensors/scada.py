"""The slow stream beside the accelerations: what the turbine's controller knows."""

from collections.abc import Iterator
from dataclasses import dataclass

from sensors.blocks import NANOSECONDS
from sensors.course import Course


@dataclass(frozen=True, slots=True)
class ScadaSample:
    """What the controller reports at one moment; it holds until the next sample."""

    turbine: str
    time_ns: int  # sensor clock [ns since 1970-01-01 UTC]
    state: str  # "parked", "idling", "start", "operating" or "stop"; "" unknown
    wind_speed: float  # at the hub [m/s]
    rotor_speed: float  # [rpm]
    pitch: float  # of the blades, 90 feathered [deg]
    yaw: float  # of the nacelle, from tower axis x towards y [deg]
    power: float  # [W]
    water_level: float  # above the mean [m]


def scada_samples(
    course: Course, *, turbine: str, start_ns: int, period: float, duration: float
) -> Iterator[ScadaSample]:
    """What the controller of a simulated turbine reports, from the first sample on.

    start_ns   sensor clock at the first sample;  period, duration [s]
    """
    for number in range(int(duration / period - 1e-9) + 1):
        time = number * period
        rotor = course.rotor(time)
        yield ScadaSample(
            turbine=turbine,
            time_ns=start_ns + round(time * NANOSECONDS),
            state=course.state(time),
            wind_speed=course.figure("wind_speed", time),
            rotor_speed=rotor.rotor_speed,
            pitch=rotor.pitch,
            yaw=course.figure("yaw", time),
            power=rotor.power,
            water_level=course.level(time),
        )
