"""Towers whose modes are known in closed form, and the turbine that ships."""

from functools import cache

from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.components import RigidBody, RotorNacelle, Tube
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import FoundationSprings

LENGTH = 100.0  # of the uniform tower [m]
STEEL = {"youngs_modulus": 210e9, "density": 7850.0}
CLAMPED = FoundationSprings(k11=1e16, k22=1e19, k12=0.0)  # rigid against any tower here
ELEVATIONS = (41.0, 80.0, 106.0, 145.0)  # of the parked turbine's accelerometers [m]


def uniform_tower(
    *,
    elements: int = 8,
    foundation: FoundationSprings = CLAMPED,
    gravity: float = 0.0,
    youngs_modulus: float = STEEL["youngs_modulus"],
    density: float = STEEL["density"],
    top: RigidBody | None = None,
) -> TurbineDescription:
    """A uniform tube of 6 m by 40 mm, 100 m high, without rotor or water."""
    step = LENGTH / elements
    tubes = tuple(
        Tube(
            bottom=i * step,
            top=(i + 1) * step,
            diameter=6.0,
            thickness=0.04,
            youngs_modulus=youngs_modulus,
            density=density,
        )
        for i in range(elements)
    )
    return TurbineDescription(
        name="uniform",
        tubes=tubes,
        foundation=foundation,
        gravity=gravity,
        rotor_nacelle=RotorNacelle(bodies=() if top is None else (top,)),
    )


def uniform_layout(**coupling: object) -> SensorLayout:
    """Accelerometers at quarter heights of the uniform tower."""
    return biaxial_layout(
        "quarters", turbine="uniform", unit="tower", elevations=(25, 50, 75, 100), **coupling
    )


def turbine_layout(**coupling: object) -> SensorLayout:
    """The parked turbine's eight channels."""
    return biaxial_layout(
        "parked", turbine="iea15mw", unit="tower", elevations=ELEVATIONS, **coupling
    )


@cache
def parked_turbine() -> TurbineDescription:
    """The IEA 15 MW turbine on its monopile."""
    return load_turbine("iea15mw_monopile")


@cache
def parked_model() -> ModalModel:
    """Every visible mode of it, with its eight channels."""
    return ModalModel(parked_turbine(), turbine_layout())
