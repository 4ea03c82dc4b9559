"""The slow stream beside the accelerations: what the turbine's controller knows."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ScadaSample:
    """What the controller reports at one moment: each value that it knows holds until the next one
    of that kind, for an hour at most."""

    turbine: str
    time_ns: int
    """Sensor clock [ns since 1970-01-01 UTC]."""
    state: str
    """"parked", "idling", "start", "operating" or "stop"; "" unknown."""
    wind_speed: float
    """At the hub [m/s]."""
    rotor_speed: float
    """Speed of the rotor [rpm]."""
    pitch: float
    """Of the blades, 90 feathered [deg]."""
    yaw: float
    """Of the nacelle, from tower axis x towards y [deg]."""
    power: float
    """Electrical power [W]."""
    water_level: float
    """Above the mean [m]."""
