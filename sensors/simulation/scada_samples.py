"""What the controller of a simulated turbine reports."""

from collections.abc import Iterator

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.simulation.schedule import Schedule


def scada_samples(
    course: Schedule, *, turbine: str, start_ns: int, period: float, duration: float
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
