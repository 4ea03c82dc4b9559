"""TurbineDescription: the structure as figures, from a TOML file that ships or that a user wrote.

Axes: x downwind in the parked position (fore-aft), y to the side (side-side), z up from the mean
water level. Positions of the rotor-nacelle assembly are relative to the tower's top.
"""

import math
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sensors.arrays import FloatArray
from sensors.constants import STANDARD_GRAVITY
from sensors.settings import settings_from_table
from sensors.structure.calibration import Calibration
from sensors.structure.foundation import FoundationSprings, SpringSign, TurbineError

Direction = Literal["FA", "SS"]
Vector = tuple[float, float, float]

SHIPPED = ("iea15mw_monopile", "iea15mw_detailed")
LONGEST_ELEMENT = 1 / 12  # of the tower: the first ten frequencies of a mast are then exact to .2 %
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
    """ν [-]; enters the torsional stiffness only."""

    attached_mass: float = 0.0
    """Attached mass of what it carries without stiffness (transition piece) [kg/m]."""

    def __post_init__(self) -> None:
        where = f"tube from {self.bottom:g} to {self.top:g} m"
        if not self.top > self.bottom:
            raise TurbineError(f"{where}: top must lie above bottom")
        for key in ("diameter", "thickness", "youngs_modulus", "density"):
            _require_positive(where, key, getattr(self, key))
        _require_not_negative(where, "attached_mass", self.attached_mass)
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
    def mass_per_length(self) -> float:
        """Mass per length with what the tube carries [kg/m]."""
        return self.density * self.area + self.attached_mass


@dataclass(frozen=True, slots=True)
class Water:
    """Sea water outside the tubes, from the mudline up to its level, and perhaps inside.

    It moves with the tube as C_a ρ π D²/4 [kg/m] in the two horizontal directions. Its weight and
    pressure do not enter. Water inside a flooded tube moves with it, ρ π (D − 2t)²/4 [kg/m].
    """

    level: float = 0.0
    """Level above mean water level [m]."""

    density: float = 1025.0
    """ρ [kg/m³]."""

    added_mass_coefficient: float = 1.0
    """C_a [-]."""

    inside: bool = False
    """Whether the tubes are flooded to the same level."""

    growth: float = 0.0
    """Thickness of marine growth, from the mudline up to the mean level [m]."""

    growth_density: float = 1325.0
    """Of marine growth [kg/m³]; DNV-ST-0437."""

    def __post_init__(self) -> None:
        _require_not_negative("water", "density", self.density)
        _require_not_negative("water", "growth", self.growth)
        _require_not_negative("water", "growth_density", self.growth_density)
        _require_not_negative("water", "added_mass_coefficient", self.added_mass_coefficient)


@dataclass(frozen=True, slots=True)
class PointMass:
    """A mass without stiffness on the tower's axis: a transition piece, a platform."""

    name: str  # what it is, for people
    elevation: float  # above mean water level [m]
    mass: float  # [kg]

    def __post_init__(self) -> None:
        _require_not_negative(f"point mass {self.name!r}", "mass", self.mass)


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
        _require_not_negative(where, "mass", self.mass)
        for axis, value in zip("xyz", self.inertia, strict=True):
            _require_not_negative(where, f"inertia round {axis}", value)
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
        _require_not_negative("rotor_nacelle", "hub_mass", self.hub_mass)
        _require_not_negative("rotor_nacelle", "hub_inertia", self.hub_inertia)


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
            _require_positive(where, key, getattr(self, key))

    @property
    def length(self) -> float:
        """Length of the element [m]."""
        return self.outer - self.inner


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
        _require_contiguous("blades", [(part.inner, part.outer) for part in self.elements])
        if abs(self.elements[0].inner) > TOUCHING:
            raise TurbineError(
                f"blades: the first element starts at {self.elements[0].inner:g} m; "
                "it starts at the root, 0 m"
            )

    @property
    def is_twisted(self) -> bool:
        """Whether flapwise and edgewise bending are coupled."""
        return any(part.twist for part in self.elements)


@dataclass(frozen=True, slots=True)
class ReferenceMode:
    """A mode that a publication lists: what the model's mode of this name is recognised by."""

    name: str
    """The publication's label of the mode."""
    direction: Direction
    """"FA" (fore-aft) or "SS" (side-side)."""
    frequency: float
    """Frequency [Hz]."""

    def __post_init__(self) -> None:
        _require_positive(f"reference mode {self.name!r}", "frequency", self.frequency)


@dataclass(frozen=True, slots=True)
class TurbineDescription:
    """Everything the model of one turbine is made from."""

    name: str
    """Short, used in keys and files."""

    tubes: tuple[Tube, ...]
    """Tubes from the mudline upwards, without gaps."""

    foundation: FoundationSprings
    title: str = ""
    """One line for people."""
    source: str = ""
    """Where the figures come from."""

    gravity: float = STANDARD_GRAVITY
    """Gravity [m/s²]."""

    water: Water | None = None
    rotor_nacelle: RotorNacelle = field(default_factory=RotorNacelle)
    blades: Blades | None = None
    reference_modes: tuple[ReferenceMode, ...] = ()
    point_masses: tuple[PointMass, ...] = ()
    transition: float | None = None  # elevation of the monopile's top, where a transition piece
    # sits; None: no such place is known [m]
    calibration: Calibration | None = None
    """What measurements have reported of its figures (`pilewatch calibrate`)."""

    def __post_init__(self) -> None:
        _require_not_negative("turbine", "gravity", self.gravity)
        for name, elevation in self._named_elevations:
            if not self.mudline <= elevation <= self.tower_top:
                raise TurbineError(
                    f"{name}: elevation {elevation:g} m is not on the tower, {self.mudline:g} to "
                    f"{self.tower_top:g} m"
                )
        _require_contiguous("tubes", [(tube.bottom, tube.top) for tube in self.tubes])
        if self.water is not None and not self.water.level < self.tower_top:
            raise TurbineError(
                f"water: level is {self.water.level:g} m; the tower ends at {self.tower_top:g} m"
            )
        names = [mode.name for mode in self.reference_modes]
        for name in names:
            if names.count(name) > 1:
                raise TurbineError(f"reference mode {name!r} is listed more than once")

    @property
    def _named_elevations(self) -> list[tuple[str, float]]:
        places = [(f"point mass {each.name!r}", each.elevation) for each in self.point_masses]
        return places if self.transition is None else [*places, ("transition", self.transition)]

    @property
    def nominal(self) -> FloatArray:
        """θ = (k11, k22, k12) of the description, (3,) [N/m, N·m/rad, N/rad]."""
        return self.foundation.stiffness

    @property
    def mudline(self) -> float:
        """Elevation of the lowest tube's lower end [m]."""
        return self.tubes[0].bottom

    @property
    def tower_top(self) -> float:
        """Elevation of the highest tube's upper end [m]."""
        return self.tubes[-1].top

    def with_sign(self, sign: SpringSign) -> "TurbineDescription":
        """Return the same turbine with the other sign convention of k12."""
        return replace(self, foundation=replace(self.foundation, sign=sign))

    def with_water_level(self, level: float) -> "TurbineDescription":
        """Return the same turbine with the sea at another level above the mean [m]."""
        return replace(self, water=replace(self.water or Water(), level=level))

    def refined(self, times: int) -> "TurbineDescription":
        """Return the same turbine with every tube cut into `times` equal ones; blades unchanged."""
        if times < 1:
            raise TurbineError(f"tube refinement is {times}; 1 or more is needed")
        return replace(self, tubes=tuple(part for tube in self.tubes for part in _cut(tube, times)))

    def meshed(self) -> "TurbineDescription":
        """Return the same turbine with the tubes cut that are too long to be one element each."""
        longest = LONGEST_ELEMENT * (self.tower_top - self.mudline)
        times = [math.ceil(tube.length / longest - 1e-9) for tube in self.tubes]
        cut = zip(self.tubes, times, strict=True)
        return replace(self, tubes=tuple(part for tube, n in cut for part in _cut(tube, n)))


def load_turbine(name_or_path: str | Path) -> TurbineDescription:
    """Return a turbine that ships (`iea15mw_monopile`) or the description in a user's TOML file.

    Returns
    -------
    TurbineDescription

    Raises
    ------
    TurbineError
        One line that names the file, the section and the key: no such turbine or file, not
        TOML, an unknown or missing key, a value of the wrong type or out of range.
    """
    source = f"{name_or_path}.toml" if name_or_path in SHIPPED else str(name_or_path)
    return parse_turbine(turbine_text(name_or_path), source=source)


def turbine_text(name_or_path: str | Path) -> str:
    """Return the TOML text of a shipped turbine or of a user's file.

    Returns
    -------
    str

    Raises
    ------
    TurbineError
        If there is none.
    """
    if name_or_path in SHIPPED:
        return shipped_text(str(name_or_path))
    path = Path(name_or_path)
    try:
        return path.read_text("utf-8-sig")  # Windows' editors put a mark at the beginning
    except FileNotFoundError:
        raise TurbineError(
            f"{path}: no such file; a turbine is one of {', '.join(SHIPPED)} or a TOML file"
        ) from None
    except (OSError, UnicodeDecodeError) as error:
        raise TurbineError(f"{path}: cannot be read as text ({error})") from error


def shipped_text(name: str) -> str:
    """Return the TOML text of a shipped turbine, to start a description of one's own from."""
    return resources.files("sensors.structure").joinpath(f"{name}.toml").read_text("utf-8")


def parse_turbine(text: str, *, source: str) -> TurbineDescription:
    """Return the description in a TOML text, long tubes cut into elements.

    `source` is the file's name for errors.
    """
    try:
        document = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise TurbineError(f"{source}: not valid TOML: {error}") from error
    materials = document.pop("materials", {})
    if "tubes" in document:
        document["tubes"] = _with_materials(document["tubes"], materials, source)
    return settings_from_table(TurbineDescription, document, source, TurbineError).meshed()


def _with_materials(tubes: Any, materials: Any, source: str) -> Any:
    """Tubes with `material = "NAME"` replaced by the figures of [materials.NAME]."""
    if not isinstance(tubes, list) or not isinstance(materials, Mapping):
        return tubes
    completed = []
    for tube in tubes:
        if isinstance(tube, Mapping) and "material" in tube:
            own = dict(tube)
            material = own.pop("material")
            if not isinstance(materials.get(material), Mapping):
                known = ", ".join(materials) or "none"
                raise TurbineError(
                    f"{source} [[tubes]]: material {material!r} is not in [materials]; "
                    f"it has {known}"
                )
            _require_base_units(materials[material], f"{source} [materials.{material}]")
            tube = {**materials[material], **own}
        completed.append(tube)
    return completed


def _require_base_units(material: Mapping[str, Any], where: str) -> None:
    """What no material has is steel's figure in GPa or in t/m³."""
    for key, least, steel in (("youngs_modulus", 1e6, "210e9 Pa"), ("density", 50.0, "7850 kg/m³")):
        value = material.get(key)
        if isinstance(value, int | float) and 0 < value < least:
            raise TurbineError(f"{where}: {key} is {value:g}; steel has {steel}")


def _cut(tube: Tube, times: int) -> Iterator[Tube]:
    edges = np.linspace(tube.bottom, tube.top, times + 1)
    for bottom, top in pairwise(edges.tolist()):
        yield replace(tube, bottom=bottom, top=top)


def _require_positive(where: str, key: str, value: float) -> None:
    if not value > 0:
        raise TurbineError(f"{where}: {key} is {value:g}; it must be positive")


def _require_not_negative(where: str, key: str, value: float) -> None:
    if not value >= 0:
        raise TurbineError(f"{where}: {key} is {value:g}; it must not be negative")


def _require_contiguous(where: str, spans: list[tuple[float, float]]) -> None:
    """Each part starts where the one before ends."""
    if not spans:
        raise TurbineError(f"{where}: at least one element is needed")
    for (_, end), (start, _) in pairwise(spans):
        if abs(start - end) > TOUCHING:
            what = "a gap" if start > end else "an overlap"
            raise TurbineError(
                f"{where}: {what} between the element that ends at {end:g} m and the next, "
                f"which starts at {start:g} m"
            )
