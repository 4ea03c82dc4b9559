"""TurbineDescription: the structure as figures, from a TOML file that ships or that a user wrote.

Axes: x downwind in the parked position (fore-aft), y to the side (side-side), z up from the mean
water level. Positions of the rotor-nacelle assembly are relative to the tower's top.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from importlib import resources
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np

from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.constants import STANDARD_GRAVITY
from sensors.settings import settings_from_table, toml_table
from sensors.structure.calibration import Calibration
from sensors.structure.components import (
    Blades,
    PointMass,
    RotorNacelle,
    Tube,
    Water,
    check_contiguous,
    check_not_negative,
    check_positive,
    without_short,
)
from sensors.structure.foundation import FoundationSprings, SpringSign, TurbineError

Direction = Literal["FA", "SS"]

SHIPPED = ("iea15mw_monopile", "iea15mw_detailed")
LONGEST_ELEMENT = 1 / 12  # of the tower: the first ten frequencies of a mast are then exact to .2 %
# Of the tower or the blade: 12 EI/L³ of a shorter one rounds off what the rest is held by.
SHORTEST_ELEMENT = 1 / 2000
# What is outside these is in another unit, or counted from elsewhere.
LIGHTEST_PILE = 0.05  # moving mass of a pile over that of the lowest tube [-]
LIGHTEST_WATER = 500.0  # [kg/m³]
LIGHTEST_NACELLE = 0.02  # hub and bodies over the blades [-]
LIGHTEST_BLADES = 0.002  # over hub and bodies [-]
HIGHEST_ON_TOP = 0.25  # height above the tower's top over that of the tower [-]
WIDEST_TUBE = 50.0  # tube that a tower or its foundation may have [m]
SLENDERNESS = 20.0  # height over diameter of the mast drawn [-]


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
        check_positive(f"reference mode {self.name!r}", "frequency", self.frequency)


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
    """Where the values come from."""

    gravity: float = STANDARD_GRAVITY
    """Gravity [m/s²]."""

    water: Water | None = None
    rotor_nacelle: RotorNacelle = field(default_factory=RotorNacelle)
    blades: Blades | None = None
    reference_modes: tuple[ReferenceMode, ...] = ()
    point_masses: tuple[PointMass, ...] = ()
    transition: float | None = None
    """Elevation of the monopile's top, where a transition piece sits [m]; absent: not known."""
    calibration: Calibration | None = None
    """What measurements have reported of its figures (`pilewatch calibrate`)."""

    def __post_init__(self) -> None:
        check_not_negative("turbine", "gravity", self.gravity)
        for name, elevation in self._named_elevations:
            if not self.mudline <= elevation <= self.tower_top:
                raise TurbineError(
                    f"{name}: elevation {elevation:g} m is not on the tower, {self.mudline:g} to "
                    f"{self.tower_top:g} m"
                )
        check_contiguous("tubes", [(tube.bottom, tube.top) for tube in self.tubes])
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

    @property
    def has_shear(self) -> bool:
        """Whether tubes deform by shear too."""
        return any(tube.shear for tube in self.tubes)

    def with_shear(self, shear: bool) -> "TurbineDescription":
        """Return the same turbine with tubes that all deform by shear too, or only bend."""
        return replace(self, tubes=tuple(replace(tube, shear=shear) for tube in self.tubes))

    def refined(self, times: int) -> "TurbineDescription":
        """Return the same turbine with every tube cut into `times` equal ones; blades unchanged."""
        if times < 1:
            raise TurbineError(f"tube refinement is {times}; 1 or more is needed")
        if times == 1:
            return self
        return replace(self, tubes=tuple(part for tube in self.tubes for part in _cut(tube, times)))

    def meshed(self) -> "TurbineDescription":
        """Return the same turbine with elements of useful lengths: too long tubes are cut, too
        short tubes and stretches of a blade go to a neighbour."""
        height = self.tower_top - self.mudline
        tubes = without_short(self.tubes, SHORTEST_ELEMENT * height)
        times = [math.ceil(tube.length / (LONGEST_ELEMENT * height) - 1e-9) for tube in tubes]
        cut = zip(tubes, times, strict=True)
        blades = self.blades
        if blades is not None:
            shortest = SHORTEST_ELEMENT * blades.elements[-1].outer
            blades = replace(blades, elements=without_short(blades.elements, shortest))
        tubes = tuple(part for tube, n in cut for part in _cut(tube, n))
        return replace(self, tubes=tubes, blades=blades)


def load_turbine(name_or_path: str | Path) -> TurbineDescription:
    """Return a turbine that ships (`iea15mw_monopile`) or the description in a user's TOML file.

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
        reason = getattr(error, "strerror", None) or error
        raise TurbineError(f"{path}: cannot be read as text: {reason}") from error


def shipped_text(name: str) -> str:
    """Return the TOML text of a shipped turbine, to start a description of one's own from."""
    return resources.files("sensors.structure").joinpath(f"{name}.toml").read_text("utf-8")


def parse_turbine(text: str, *, source: str) -> TurbineDescription:
    """Return the description in a TOML text, long tubes cut into elements.

    `source` is the file's name for errors.
    """
    document = toml_table(text, source, TurbineError)
    materials = document.pop("materials", {})
    if document.get("tubes") == []:
        raise TurbineError(f"{source}: tubes is empty; a structure has at least one, lowest first")
    if "tubes" in document:
        document["tubes"] = _with_materials(document["tubes"], materials, source)
        _require_tubes_in_base_units(document["tubes"], source)
    described = settings_from_table(TurbineDescription, document, source, TurbineError)
    _require_kilograms(described, source)
    _require_places_from_the_top(described, source)
    return described.meshed()


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
    """What no material has is steel's figure in GPa, MPa, kN/m² or t/m³."""
    for key, least, steel in (("youngs_modulus", 5e8, "210e9 Pa"), ("density", 50.0, "7850 kg/m³")):
        value = material.get(key)
        if isinstance(value, int | float) and 0 < value < least:
            raise TurbineError(f"{where}: {key} is {value:g}; steel has {steel}")


def _require_tubes_in_base_units(tubes: Any, source: str) -> None:
    """Raise TurbineError for figures of tubes that stand in another unit than the key's."""
    if not isinstance(tubes, list):
        return
    for number, tube in enumerate(tubes):
        if not isinstance(tube, Mapping):
            continue
        where = f"{source} [tubes[{number}]]"
        _require_base_units(tube, where)
        width = tube.get("diameter")
        if isinstance(width, int | float) and WIDEST_TUBE < width < math.inf:
            raise TurbineError(
                f"{where}: diameter is {width:g} m; no tower is wider than {WIDEST_TUBE:g} m "
                "(one of 9 m has 9.0)"
            )


def _require_kilograms(described: TurbineDescription, source: str) -> None:
    """Raise TurbineError for masses that only tonnes can have meant, or g/cm³."""
    moving, lowest = described.foundation.moving_mass, described.tubes[0]
    if moving and moving < LIGHTEST_PILE * lowest.mass_per_length:
        raise TurbineError(
            f"{source} [foundation]: moving_mass is {moving:g} kg/m; the lowest tube alone has "
            f"{lowest.mass_per_length:.4g} kg/m (0: nothing moves below the mudline)"
        )
    water = described.water or Water()
    for key in ("density", "growth_density"):
        if 0 < (density := getattr(water, key)) < LIGHTEST_WATER:
            raise TurbineError(
                f"{source} [water]: {key} is {density:g} kg/m³; sea water has 1025 kg/m³"
            )
    blades = described.blades
    if blades is not None:
        top = described.rotor_nacelle.mass
        if 0 < top < LIGHTEST_NACELLE * blades.mass or blades.mass < LIGHTEST_BLADES * top:
            raise TurbineError(
                f"{source} [rotor_nacelle]: hub and bodies have {top:g} kg, the blades "
                f"{blades.mass:g} kg in all; one of the two is not in kg"
            )


def _require_places_from_the_top(described: TurbineDescription, source: str) -> None:
    """Raise TurbineError for heights on the top that count from the sea or from the mudline."""
    most = HIGHEST_ON_TOP * (described.tower_top - described.mudline)
    rotor = described.rotor_nacelle
    heights = [(f"the centre of {body.name!r}", body.centre[2]) for body in rotor.bodies]
    for name, height in (*heights, ("tower_to_shaft", rotor.tower_to_shaft)):
        if abs(height) > most:
            raise TurbineError(
                f"{source} [rotor_nacelle]: {name} is at {height:g} m; heights here count from the "
                f"tower's top, which is at {described.tower_top:g} m"
            )


def _cut(tube: Tube, times: int) -> Iterator[Tube]:
    edges = np.linspace(tube.bottom, tube.top, times + 1)
    for bottom, top in pairwise(edges.tolist()):
        yield replace(tube, bottom=bottom, top=top)


def bare_mast(layout: SensorLayout) -> TurbineDescription:
    """Return one tube from the ground or the lowest sensor up to the highest one.

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
