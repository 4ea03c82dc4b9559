"""What a turbine does: its states, and how rotor, pitch and power follow the wind.

The curves have the shape of the IEA 15 MW turbine's steady states (NREL/TP-5000-75698, section
3 and 5), rounded to a few points; they are no controller.
"""

from dataclasses import dataclass
from typing import Literal

import numpy as np

OperatingState = Literal["parked", "idling", "start", "operating", "stop"]

FEATHERED = 90.0  # pitch of a parked or idling rotor [deg]
FINE_PITCH = 0.0  # of a rotor below rated wind [deg]
CUT_IN, RATED, CUT_OUT = 3.0, 10.59, 25.0  # wind speeds [m/s]
RATED_POWER = 15e6  # [W]
LOWEST_SPEED, RATED_SPEED = 5.0, 7.56  # of the rotor in operation [rpm]
IDLING_SPEED = 0.5  # of a feathered rotor that turns freely, at 10 m/s [rpm]
_WIND = (3.0, 7.0, 10.59, 12.0, 15.0, 20.0, 25.0)  # [m/s]
_PITCH = (0.0, 0.0, 0.0, 6.5, 11.5, 17.5, 22.5)  # [deg]
_THRUST = (0.25e6, 1.08e6, 2.45e6, 1.75e6, 1.25e6, 1.00e6, 0.90e6)  # [N]


@dataclass(frozen=True, slots=True)
class SteadyState:
    """What the rotor does in a steady wind."""

    rotor_speed: float
    """Rotor speed [rpm]."""

    pitch: float
    """Pitch [deg]."""

    power: float
    """Power [W]."""

    thrust: float
    """Thrust of the turning rotor on the tower's top [N]."""


def steady_state(wind_speed: float, share: float, *, idling: bool = False) -> SteadyState:
    """Return the rotor in a wind.

    Parameters
    ----------
    wind_speed : float
        Wind speed at the hub [m/s].
    share : float
        0: feathered; 1: in operation; between: on its way from one to the other [-].
    idling : bool, optional
        The feathered rotor turns freely instead of being locked.
    """
    wind = min(max(wind_speed, CUT_IN), CUT_OUT)
    running = np.clip(RATED_SPEED * wind / RATED, LOWEST_SPEED, RATED_SPEED)
    resting = IDLING_SPEED * wind_speed / 10.0 if idling else 0.0
    fine = float(np.interp(wind, _WIND, _PITCH))
    return SteadyState(
        rotor_speed=float(resting + share * (running - resting)),
        pitch=FEATHERED + share * (fine - FEATHERED),
        power=share * RATED_POWER * min(1.0, (wind / RATED) ** 3),
        thrust=share * float(np.interp(wind, _WIND, _THRUST)),
    )
