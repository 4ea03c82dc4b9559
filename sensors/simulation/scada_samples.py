"""What the controller of a simulated turbine reports."""

from collections.abc import Iterator

from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.scada import ScadaSample
from sensors.simulation.schedule import Schedule


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
