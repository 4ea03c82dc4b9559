"""A bare mast: what is drawn of a structure of which nothing is known but where its sensors are."""

from sensors.acquisition.layout import SensorLayout
from sensors.structure.components import Tube
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings

SLENDERNESS = 20.0  # height over diameter of the mast drawn [-]


def bare_mast(layout: SensorLayout) -> TurbineDescription:
    """One tube from the ground or the lowest sensor up to the highest one.

    To be drawn, never to be calculated with: wall, steel and springs stand for nothing.
    """
    bottom = min(0.0, float(layout.elevations.min()))
    top = max(float(layout.elevations.max()), bottom + 1.0)
    diameter = (top - bottom) / SLENDERNESS
    tube = Tube(bottom, top, diameter, diameter / 100, youngs_modulus=210e9, density=7850.0)
    return TurbineDescription(
        name=layout.turbine,
        title=layout.turbine,
        tubes=(tube,),
        foundation=FoundationSprings(k11=1.0, k22=1.0, k12=0.0),
    )
