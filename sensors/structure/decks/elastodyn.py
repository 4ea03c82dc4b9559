"""A description from OpenFAST's ElastoDyn and SubDyn input files.

    ElastoDyn.dat ─► tower and blade files      SubDyn.dat ─► monopile      ─► TurbineDescription

Value and keyword stand on a line, value first; tables follow a title line ("DISTRIBUTED TOWER
PROPERTIES"). Signs: ElastoDyn's ShftTilt and PreCone are negative for an upwind rotor whose shaft
and tips lean away from the tower; here both are then positive. Source: OpenFAST documentation,
ElastoDyn and SubDyn input files.
"""

import math
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np

from sensors.arrays import FloatArray
from sensors.structure.components import (
    BladeElement,
    Blades,
    PointMass,
    RigidBody,
    RotorNacelle,
    Tube,
    Water,
)
from sensors.structure.decks.input_file import Deck
from sensors.structure.decks.stations import edges_of, mean_between
from sensors.structure.decks.subdyn import monopile_masses, monopile_tubes
from sensors.structure.description import LONGEST_ELEMENT, TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError

STEEL_MODULUS = 210e9  # of a tower of which the deck has only EI [Pa]
TOWER_DENSITY = 8500.0  # with paint, bolts and flanges; NREL/TP-500-38060 [kg/m³]
BLADE_ELEMENTS = 8  # of equal length, that stand for the deck's stations
FEATHERED_PITCH = 90.0  # of a parked rotor [deg]
JOINED = 0.01  # figures of two files that are this near mean the same elevation [m]
ON_GROUND = 0.5  # a tower whose base is nearer to level 0 stands on land [m]


def read_elastodyn(
    path: Path, springs: FoundationSprings, *, subdyn: Path | None = None
) -> TurbineDescription:
    """Return the turbine of an ElastoDyn file.

    Parameters
    ----------
    path : Path
        ElastoDyn's primary file; tower and blade files stand where it names them.
    springs : FoundationSprings
        At the mudline: the deck has none.
    subdyn : Path, optional
        SubDyn's file of a monopile: joints one above the other, with their concentrated masses.

    Returns
    -------
    TurbineDescription
        Parked: blades feathered.

    Raises
    ------
    TurbineError
        If a file, a keyword or a table is missing or cannot be right, the substructure is no
        monopile, or `PtfmMass` is that of a floater.

    Notes
    -----
    A transition piece (`PtfmMass`) stands on the axis at `PtfmCMzt`, without its rotational
    inertia: a point mass has none.
    """
    try:
        return _description(Deck(path), springs, None if subdyn is None else Deck(subdyn))
    except TurbineError:
        raise
    except (ArithmeticError, IndexError, KeyError, ValueError) as error:
        raise TurbineError(f"{path}: no turbine of ElastoDyn: {error}") from error


def _description(deck: Deck, springs: FoundationSprings, subdyn: Deck | None) -> TurbineDescription:
    path = deck.path
    mudline = deck.number("TowerBsHt") if subdyn is None else monopile_tubes(subdyn)[0].bottom
    longest = LONGEST_ELEMENT * (deck.number("TowerHt") - mudline)
    tubes = tower_tubes(deck, longest)
    base = tubes[0].bottom
    pile = () if subdyn is None else _pile_below(base, subdyn, longest, path)
    whole = (*pile, *tubes)
    name = path.stem.removesuffix("_ElastoDyn")
    in_water = bool(pile) or whole[0].bottom < -ON_GROUND
    turbine = TurbineDescription(
        name=name,
        title=f"{name}, from OpenFAST's files",
        source=path.name + ("" if subdyn is None else f", {subdyn.path.name}"),
        tubes=whole,
        foundation=springs,
        water=Water() if in_water else None,
        rotor_nacelle=_rotor_nacelle(deck),
        blades=_blades(deck),
        transition=base if pile else None,
    )
    masses = () if subdyn is None else monopile_masses(subdyn)
    return replace(turbine, point_masses=(*_platform(deck, turbine), *masses)).meshed()


def _pile_below(base: float, subdyn: Deck, longest: float, path: Path) -> tuple[Tube, ...]:
    """Monopile that ends exactly where the tower begins."""
    pile = monopile_tubes(subdyn, longest)
    if abs(pile[-1].top - base) > JOINED:
        raise TurbineError(
            f"{subdyn.path}: the monopile ends at {pile[-1].top:g} m; the tower of {path} begins "
            f"at {base:g} m"
        )
    return (*pile[:-1], replace(pile[-1], top=base))


def _platform(deck: Deck, turbine: TurbineDescription) -> tuple[PointMass, ...]:
    """A transition piece that the deck has as its platform, at its centre; none without mass.

    A floater carries its turbine by buoyancy and ballast and is several times as heavy (OC4's
    semi-submersible, of the least steel, 3852 t under 599 t); transition pieces weigh 100 to 500 t.
    Degrees of freedom do not tell them apart: monopiles of SubDyn have the platform's free, too.
    """
    mass = deck.number("PtfmMass")
    if mass == 0:
        return ()
    centre = deck.number("PtfmCMzt")
    what = f"{deck.path}: PtfmMass {mass / 1e3:.0f} t at {centre:.4g} m"
    carried = _mass_above(turbine, deck.number("TowerBsHt"))
    if mass > carried:
        raise TurbineError(
            f"{what} weighs more than tower, rotor and nacelle, {carried / 1e3:.0f} t: a floater; "
            "a description is one tower on one set of springs"
        )
    base, top = turbine.mudline, turbine.tower_top
    if not base - JOINED <= centre <= top + JOINED:
        raise TurbineError(
            f"{what} is not on the structure, {base:g} to {top:g} m: a floater, a slab, or a "
            "transition piece whose monopile is missing (--subdyn)"
        )
    return (PointMass("platform", min(max(centre, base), top), mass),)


def _mass_above(turbine: TurbineDescription, base: float) -> float:
    """Mass of tower, rotor and nacelle [kg]."""
    top, blades = turbine.rotor_nacelle, turbine.blades
    elements = () if blades is None else blades.elements * blades.number
    return (
        sum(each.mass_per_length * each.length for each in turbine.tubes if each.top > base)
        + sum(each.mass for each in top.bodies)
        + top.hub_mass
        + sum(each.mass_per_length * each.length for each in elements)
    )


def tower_tubes(deck: Deck, longest: float = math.inf) -> tuple[Tube, ...]:
    """Tubes with the mass and the rigidity of ElastoDyn's stations, one or more between each two.

    Parameters
    ----------
    deck : Deck
        ElastoDyn's primary file.
    longest : float
        A taper is cut into tubes of at most this length [m].
    """
    tower = deck.beside("TwrFile")
    stations = tower.table("HtFract", tower.count("NTwInpSt"))
    table = stations.numbers("HtFract", "TMassDen", "TwFAStif")
    low, high = deck.number("TowerBsHt"), deck.number("TowerHt")
    if not high > low:
        raise TurbineError(
            f"{deck.path}: TowerHt is {high:g} m; it must lie above TowerBsHt, {low:g} m"
        )
    heights = low + (high - low) * table[:, 0]
    mass = table[:, 1] * tower.number("AdjTwMa")
    rigidity = table[:, 2] * tower.number("AdjFASt")
    return tapered_tubes(heights, mass, rigidity, longest)


def tapered_tubes(
    heights: FloatArray, mass: FloatArray, rigidity: FloatArray, longest: float
) -> tuple[Tube, ...]:
    """Return the tubes of stations [m] with mass [kg/m] and EI [N·m²], steps at double stations."""
    if not np.all(np.diff(heights) >= 0):
        falls = int(np.argmax(np.diff(heights) < 0))
        raise TurbineError(
            f"tower: the station at {heights[falls + 1]:g} m follows that at {heights[falls]:g} m; "
            "stations ascend"
        )
    return tuple(
        tube_of(
            bottom,
            top,
            mean_between(heights, mass, bottom, top),
            mean_between(heights, rigidity, bottom, top),
        )
        for bottom, top in pairwise(edges_of(heights, longest))
    )


def tube_of(bottom: float, top: float, mass_per_length: float, rigidity: float) -> Tube:
    """Return the circular tube of steel that has this mass [kg/m] and this EI [N·m²].

    With A = m/ρ and I = EI/E:  D² + d² = 16 I/A  and  D² − d² = 4 A/π.
    """
    area = mass_per_length / TOWER_DENSITY
    difference = 4 * area / np.pi
    both = 16 * rigidity / STEEL_MODULUS / area if area > 0 else -np.inf
    if both <= difference:
        raise TurbineError(
            f"tower from {bottom:g} to {top:g} m: no tube of steel has {mass_per_length:g} kg/m "
            f"and {rigidity:g} N·m²"
        )
    outer, inner = np.sqrt([(both + difference) / 2, (both - difference) / 2]).tolist()
    return Tube(
        bottom=bottom,
        top=top,
        diameter=outer,
        thickness=(outer - inner) / 2,
        youngs_modulus=STEEL_MODULUS,
        density=TOWER_DENSITY,
    )


def _rotor_nacelle(deck: Deck) -> RotorNacelle:
    """Nacelle and yaw bearing; the deck has one inertia, about the yaw axis."""
    x, y, z = (deck.number(f"NacCM{axis}n") for axis in "xyz")
    mass = deck.number("NacMass")
    yaw = max(deck.number("NacYIner") - mass * (x**2 + y**2), 0.0)
    bearing = deck.number("YawBrMass")
    bodies = (RigidBody("nacelle", mass, (x, y, z), (yaw, yaw, yaw)),)
    return RotorNacelle(
        bodies=(*bodies, RigidBody("yaw bearing", bearing)) if bearing > 0 else bodies,
        overhang=deck.number("OverHang"),
        tower_to_shaft=deck.number("Twr2Shft"),
        tilt=-deck.number("ShftTilt"),
        hub_mass=deck.number("HubMass"),
        hub_inertia=deck.number("HubIner"),
    )


def _blades(deck: Deck) -> Blades:
    blade = deck.beside("BldFile(1)")
    stations = blade.table("BlFract", blade.count("NBlInpSt"))
    fraction, twist, mass, flap, edge = stations.numbers(
        "BlFract", "StrcTwst", "BMassDen", "FlpStff", "EdgStff"
    ).T
    length = deck.number("TipRad") - deck.number("HubRad")
    factors = [blade.number(key) for key in ("AdjBlMs", "AdjFlSt", "AdjEdSt")]
    edges = np.linspace(0.0, 1.0, BLADE_ELEMENTS + 1)
    elements = tuple(
        BladeElement(
            inner=low * length,
            outer=high * length,
            mass_per_length=factors[0] * mean_between(fraction, mass, low, high),
            flapwise_rigidity=factors[1] / mean_between(fraction, 1 / flap, low, high),
            edgewise_rigidity=factors[2] / mean_between(fraction, 1 / edge, low, high),
            twist=mean_between(fraction, twist, low, high),
        )
        for low, high in pairwise(edges.tolist())
    )
    return Blades(
        number=deck.count("NumBl"),
        elements=elements,
        hub_radius=deck.number("HubRad"),
        cone=-deck.number("PreCone(1)"),
        pitch=FEATHERED_PITCH,
    )
