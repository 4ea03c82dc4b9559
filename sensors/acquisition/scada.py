"""The slow stream beside the accelerations: what the turbine's controller knows."""

from dataclasses import dataclass


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
