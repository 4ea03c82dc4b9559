"""The parts that a turbine is described by: tubes, water, masses, rotor and nacelle, blades.

Each checks its own figures; what it says of a wrong one names the part and the key.
"""

from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TypeVar

import numpy as np

from sensors.arrays import FloatArray
from sensors.structure.foundation import TurbineError

Vector = tuple[float, float, float]
PartT = TypeVar("PartT", "Tube", "BladeElement")

TOUCHING = 1e-6  # two elevations closer than this are the same [m]


@dataclass(frozen=True, slots=True)
class Tube:
    """One uniform circular tube of the monopile or the tower."""

    bottom: float
    """Elevation above mean water level [m]."""

    top: float
    """Top [m]."""

    diameter: float
    """Outer diameter [m]."""

    thickness: float
    """Thickness of the wall [m]."""

    youngs_modulus: float
    """E [Pa]."""

    density: float
    """ρ, of the wall with paint, bolts and flanges [kg/m³]."""

    poisson_ratio: float = 0.3
    """ν [-]; enters the stiffness in torsion and in shear."""

    shear: bool = False
    """Whether it also deforms by shear and its sections' rotation has inertia (Timoshenko's beam);
    without, it only bends (Euler-Bernoulli)."""

    attached_mass: float = 0.0
    """Attached mass of what it carries without stiffness (transition piece) [kg/m]."""

    def __post_init__(self) -> None:
        where = f"tube from {self.bottom:g} to {self.top:g} m"
        if not self.top > self.bottom:
            raise TurbineError(f"{where}: top must lie above bottom")
        for key in ("diameter", "thickness", "youngs_modulus", "density"):
            check_positive(where, key, getattr(self, key))
        check_not_negative(where, "attached_mass", self.attached_mass)
        if not self.thickness <= self.diameter / 2:
            raise TurbineError(
                f"{where}: thickness is {self.thickness:g} m; a tube of {self.diameter:g} m has "
                f"at most {self.diameter / 2:g} m"
            )
        if not -1 < self.poisson_ratio < 0.5:
            raise TurbineError(f"{where}: poisson_ratio is {self.poisson_ratio:g}; steel has 0.3")

    @property
    def length(self) -> float:
        """Length of the tube [m]."""
        return self.top - self.bottom

    @property
    def area(self) -> float:
        """Cross-section of the wall A = π (D − t) t [m²]."""
        return float(np.pi * (self.diameter - self.thickness) * self.thickness)

    @property
    def second_moment(self) -> float:
        """Second moment of area I = π (D⁴ − (D − 2t)⁴) / 64 [m⁴]."""
        inner = self.diameter - 2 * self.thickness
        return float(np.pi * (self.diameter**4 - inner**4) / 64)

    @property
    def bending_rigidity(self) -> float:
        """Bending rigidity EI [N·m²]."""
        return self.youngs_modulus * self.second_moment

    @property
    def torsional_rigidity(self) -> float:
        """Torsional rigidity GJ = E / (2 (1 + ν)) · 2I [N·m²]."""
        return self.bending_rigidity / (1 + self.poisson_ratio)

    @property
    def shear_parameter(self) -> float:
        """Φ = 12 EI / (κ G A L²), 0 for a tube that only bends [-].

        κ = 2 (1 + ν) / (4 + 3ν) of a thin round tube: Cowper, Journal of Applied Mechanics 33
        (1966) 335.
        """
        if not self.shear:
            return 0.0
        rigidity = 1 / (4 + 3 * self.poisson_ratio)  # κ G / E
        return 12 * self.second_moment / (rigidity * self.area * self.length**2)

    @property
    def mass_per_length(self) -> float:
        """Mass per length with what the tube carries [kg/m]."""
        return self.density * self.area + self.attached_mass

    def extended(self, other: "Tube") -> "Tube":
        """Return this tube as long as both together; what the other weighs more is attached."""
        both = self.length + other.length
        more = other.length * (other.mass_per_length - self.density * self.area)
        return replace(
            self,
            bottom=min(self.bottom, other.bottom),
            top=max(self.top, other.top),
            attached_mass=max(0.0, (self.length * self.attached_mass + more) / both),
        )


@dataclass(frozen=True, slots=True)
class Water:
    """Sea water outside the tubes, from the mudline up to its level, and perhaps inside.

    It moves with the tube as C_a ρ π D²/4 [kg/m] in the two horizontal directions. Its weight and
    pressure do not enter. Water inside a flooded tube moves with it, ρ π (D − 2t)²/4 [kg/m], up to
    the mean level: it does not follow the tide.
    """

    level: float = 0.0
    """Level above mean water level [m]."""

    density: float = 1025.0
    """ρ [kg/m³]."""

    added_mass_coefficient: float = 1.0
    """C_a [-]."""

    inside: bool = False
    """Whether the tubes are flooded, up to the mean level."""

    growth: float = 0.0
    """Thickness of marine growth, from the mudline up to the mean level [m]."""

    growth_density: float = 1325.0
    """Of marine growth [kg/m³]; DNV-ST-0437."""

    def __post_init__(self) -> None:
        check_not_negative("water", "density", self.density)
        check_not_negative("water", "growth", self.growth)
        check_not_negative("water", "growth_density", self.growth_density)
        check_not_negative("water", "added_mass_coefficient", self.added_mass_coefficient)


@dataclass(frozen=True, slots=True)
class PointMass:
    """A mass without stiffness on the tower's axis: a transition piece, a platform."""

    name: str
    """What it is, for people."""
    elevation: float
    """Above mean water level [m]."""
    mass: float
    """Mass [kg]."""

    def __post_init__(self) -> None:
        check_not_negative(f"point mass {self.name!r}", "mass", self.mass)


@dataclass(frozen=True, slots=True)
class RigidBody:
    """A mass that moves with the tower's top."""

    name: str
    """What it is, for people."""
    mass: float
    """Mass [kg]."""

    centre: Vector = (0.0, 0.0, 0.0)
    """Centre from the tower's top (x, y, z) [m]."""

    inertia: Vector = (0.0, 0.0, 0.0)
    """Moments of inertia round x, y, z: I_xx, I_yy, I_zz [kg·m²]."""

    products: Vector = (0.0, 0.0, 0.0)
    """The tensor's other entries I_xy, I_xz, I_yz, with I_xy = −∫ x y dm [kg·m²]."""

    inertia_point: Vector | None = None
    """Point that moments and products are about, from the tower's top; the centre if absent [m]."""

    def __post_init__(self) -> None:
        where = f"body {self.name!r}"
        check_not_negative(where, "mass", self.mass)
        for axis, value in zip("xyz", self.inertia, strict=True):
            check_not_negative(where, f"inertia round {axis}", value)
        least = float(np.linalg.eigvalsh(self.tensor)[0])
        if least < -1e-6 * max(self.inertia):
            raise TurbineError(
                f"{where}: about its centre the inertia has a principal moment of {least:g} kg·m²; "
                "it must not be negative: check products and inertia_point"
            )

    @property
    def tensor(self) -> FloatArray:
        """(3, 3) inertia about the centre [kg·m²], by the parallel axis theorem."""
        xy, xz, yz = self.products
        stated = np.diag(self.inertia) + np.array([[0, xy, xz], [xy, 0, yz], [xz, yz, 0]])
        if self.inertia_point is None:
            return stated
        arm = np.subtract(self.centre, self.inertia_point)
        return np.asarray(stated - self.mass * (arm @ arm * np.eye(3) - np.outer(arm, arm)))

    @property
    def about_centre(self) -> "RigidBody":
        """The same body with its inertia about its centre."""
        if self.inertia_point is None:
            return self
        i = self.tensor.tolist()
        moments, products = (i[0][0], i[1][1], i[2][2]), (i[0][1], i[0][2], i[1][2])
        return replace(self, inertia=moments, products=products, inertia_point=None)


@dataclass(frozen=True, slots=True)
class RotorNacelle:
    """What sits on the tower's top, all rigid; the blades are apart."""

    bodies: tuple[RigidBody, ...] = ()
    overhang: float = 0.0
    """Overhang from the tower's axis to the rotor's apex along the shaft, < 0 upwind [m]."""

    tower_to_shaft: float = 0.0
    """Height of the shaft above the tower's top, on the axis [m]."""

    tilt: float = 0.0
    """Tilt of the shaft, upwind end up [deg]."""

    hub_mass: float = 0.0
    """Hub mass at the apex [kg]."""

    hub_inertia: float = 0.0
    """Hub inertia round the shaft; a disc, so half of it across [kg·m²]."""

    def __post_init__(self) -> None:
        check_not_negative("rotor_nacelle", "hub_mass", self.hub_mass)
        check_not_negative("rotor_nacelle", "hub_inertia", self.hub_inertia)

    @property
    def mass(self) -> float:
        """Mass of hub and bodies, without blades [kg]."""
        return self.hub_mass + sum(body.mass for body in self.bodies)

    @property
    def has_inertia(self) -> bool:
        """Whether a body is more than a point mass."""
        return any(any(body.inertia) for body in self.bodies)


@dataclass(frozen=True, slots=True)
class BladeElement:
    """A uniform stretch of a blade."""

    inner: float
    """Distance from the blade's root [m]."""

    outer: float
    """Outer end, distance from the blade's root [m]."""

    mass_per_length: float
    """Mass per length [kg/m]."""

    flapwise_rigidity: float
    """EI for displacement across the chord [N·m²]."""

    edgewise_rigidity: float
    """EI for displacement along the chord [N·m²]."""

    twist: float = 0.0
    """Twist of the chord against the pitch axis' zero, towards feather [deg]."""

    def __post_init__(self) -> None:
        where = f"blade element from {self.inner:g} to {self.outer:g} m"
        if not self.outer > self.inner:
            raise TurbineError(f"{where}: outer must be larger than inner")
        for key in ("mass_per_length", "flapwise_rigidity", "edgewise_rigidity"):
            check_positive(where, key, getattr(self, key))

    @property
    def length(self) -> float:
        """Length of the element [m]."""
        return self.outer - self.inner

    def extended(self, other: "BladeElement") -> "BladeElement":
        """Return this element as long as both together and as heavy."""
        mass = self.length * self.mass_per_length + other.length * other.mass_per_length
        return replace(
            self,
            inner=min(self.inner, other.inner),
            outer=max(self.outer, other.outer),
            mass_per_length=mass / (self.length + other.length),
        )


@dataclass(frozen=True, slots=True)
class Blades:
    """The blades of the locked rotor: equal, straight, rigid axially."""

    number: int
    """Number of blades."""
    elements: tuple[BladeElement, ...]
    """Elements from root to tip."""

    hub_radius: float = 0.0
    """Hub radius from the apex to a blade's root [m]."""

    cone: float = 0.0
    """Tips upwind [deg]."""

    pitch: float = 0.0
    """0: chord in the rotor's plane; 90, feathered: chord along the shaft [deg]."""

    azimuth: float = 0.0
    """Azimuth of the first blade, 0 is up [deg]."""

    modes_per_element: int = 1
    """Clamped-clamped modes an element keeps in each direction."""

    def __post_init__(self) -> None:
        if not self.number >= 1:
            raise TurbineError(f"blades: number is {self.number}; at least 1 is needed")
        if not 0 <= self.modes_per_element <= 3:
            raise TurbineError(
                f"blades: modes_per_element is {self.modes_per_element}; 0 to 3 can be kept"
            )
        check_contiguous("blades", [(part.inner, part.outer) for part in self.elements])
        if abs(self.elements[0].inner) > TOUCHING:
            raise TurbineError(
                f"blades: the first element starts at {self.elements[0].inner:g} m; "
                "it starts at the root, 0 m"
            )

    @property
    def mass(self) -> float:
        """Mass of all blades [kg]."""
        return self.number * sum(part.mass_per_length * part.length for part in self.elements)

    @property
    def is_twisted(self) -> bool:
        """Whether flapwise and edgewise bending are coupled."""
        return any(part.twist for part in self.elements)


def without_short(parts: tuple[PartT, ...], shortest: float) -> tuple[PartT, ...]:
    """Return tubes or elements of a blade with those joined to a neighbour that are too short.

    A step in a wall is often written as a tube of a millimetre, and a taper as hundreds of short
    ones. Two that are joined have the section of the longer one.

    Parameters
    ----------
    parts : tuple of Tube or BladeElement
        One after the other.
    shortest : float
        Length that none of several stays under [m].
    """
    left = list(parts)
    while len(left) > 1:
        lengths = [part.length for part in left]
        i = int(np.argmin(lengths))
        if lengths[i] >= shortest:
            break
        beside = min({max(i - 1, 0), min(i + 1, len(left) - 1)} - {i}, key=lengths.__getitem__)
        first = min(i, beside)
        left[first : first + 2] = [left[beside].extended(left[i])]
    return tuple(left)


def check_positive(where: str, key: str, value: float) -> None:
    """Raise TurbineError for a figure that is not above zero."""
    if not value > 0:
        raise TurbineError(f"{where}: {key} is {value:g}; it must be positive")


def check_not_negative(where: str, key: str, value: float) -> None:
    """Raise TurbineError for a figure below zero."""
    if not value >= 0:
        raise TurbineError(f"{where}: {key} is {value:g}; it must not be negative")


def check_contiguous(where: str, spans: list[tuple[float, float]]) -> None:
    """Raise TurbineError unless each part starts where the one before ends."""
    if not spans:
        raise TurbineError(f"{where}: at least one element is needed")
    for (_, end), (start, _) in pairwise(spans):
        if abs(start - end) > TOUCHING:
            what = "a gap" if start > end else "an overlap"
            raise TurbineError(
                f"{where}: {what} between the element that ends at {end:g} m and the next, "
                f"which starts at {start:g} m"
            )
