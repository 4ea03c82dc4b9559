"""A description from OpenFAST's ElastoDyn and SubDyn input files.

    ElastoDyn.dat ─► tower and blade files      SubDyn.dat ─► monopile      ─► TurbineDescription

Value and keyword stand on a line, value first; tables follow a title line ("DISTRIBUTED TOWER
PROPERTIES"). Signs: ElastoDyn's ShftTilt and PreCone are negative for an upwind rotor whose shaft
and tips lean away from the tower; here both are then positive. Source: OpenFAST documentation,
ElastoDyn and SubDyn input files.
"""

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
from sensors.structure.description import TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError

STEEL_MODULUS = 210e9  # of a tower of which the deck has only EI [Pa]
TOWER_DENSITY = 8500.0  # with paint, bolts and flanges; NREL/TP-500-38060 [kg/m³]
BLADE_ELEMENTS = 8  # of equal length, that stand for the deck's stations
TIMOSHENKO = 3  # SubDyn's `FEMMod` of members that deform by shear too
FEATHERED_PITCH = 90.0  # of a parked rotor [deg]
ON_GROUND = 0.5  # a tower whose base is nearer to level 0 stands on land [m]


class Deck:
    """One input file: its keywords, and its tables by the line above them."""

    def __init__(self, path: Path) -> None:
        try:
            self.lines = path.read_text("latin-1").splitlines()
        except OSError as error:
            raise TurbineError(f"{path}: {error.strerror}") from error
        self.path = path

    def text(self, keyword: str, *older: str) -> str:
        """Return the value before a keyword, without quotes; TurbineError where it is missing.

        Parameters
        ----------
        keyword : str
            As OpenFAST has it today.
        older : str
            Its names in earlier versions.
        """
        for line in self.lines:
            words = [word.rstrip(":") for word in line.split()]
            if not {keyword, *older}.isdisjoint(words[1:3]):
                return words[0].strip("\"'")
        raise TurbineError(f"{self.path}: there is no {keyword}; is it the right kind of file?")

    def number(self, keyword: str, *older: str) -> float:
        """Return the number before a keyword."""
        text = self.text(keyword, *older)
        try:
            return float(text.replace("D", "E").replace("d", "e"))
        except ValueError:
            raise TurbineError(f"{self.path}: {keyword} is {text!r}; a number is needed") from None

    def table(self, head: str, n_rows: int) -> list[list[str]]:
        """Rows below the column titles, the first of which is `head`; a line of units between."""
        for number, line in enumerate(self.lines):
            if line.split()[:1] == [head]:
                rows = [each.split() for each in self.lines[number + 2 : number + 2 + n_rows]]
                if len(rows) == n_rows and all(rows):
                    return rows
        raise TurbineError(f"{self.path}: there is no table of {head} with {n_rows} rows")

    def beside(self, keyword: str) -> "Deck":
        """Return the file that a keyword names, relative to this one."""
        return Deck(self.path.parent / self.text(keyword).replace("\\", "/"))


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
        SubDyn's file of a monopile: joints one above the other.

    Returns
    -------
    TurbineDescription
        Parked: blades feathered.

    Raises
    ------
    TurbineError
        If a file, a keyword or a table is missing, or the substructure is no monopile.
    """
    deck = Deck(path)
    tubes = tower_tubes(deck)
    pile = () if subdyn is None else monopile_tubes(Deck(subdyn))
    if pile and abs(pile[-1].top - tubes[0].bottom) > 0.01:
        raise TurbineError(
            f"{subdyn}: the monopile ends at {pile[-1].top:g} m; the tower of {path} begins at "
            f"{tubes[0].bottom:g} m"
        )
    whole = (*pile, *tubes)
    platform = deck.number("PtfmMass")
    base = tubes[0].bottom
    masses = (PointMass("platform", base, platform),) if platform > 0 else ()
    in_water = bool(pile) or whole[0].bottom < -ON_GROUND
    return TurbineDescription(
        name=path.stem.removesuffix("_ElastoDyn"),
        title=f"{path.stem.removesuffix('_ElastoDyn')}, from OpenFAST's files",
        source=path.name + ("" if subdyn is None else f", {subdyn.name}"),
        tubes=whole,
        foundation=springs,
        water=Water() if in_water else None,
        rotor_nacelle=_rotor_nacelle(deck),
        blades=_blades(deck),
        point_masses=masses,
        transition=base if pile else None,
    ).meshed()


def tower_tubes(deck: Deck) -> tuple[Tube, ...]:
    """Tubes with the mass and the rigidity of ElastoDyn's stations, one between each two."""
    tower = deck.beside("TwrFile")
    n = int(tower.number("NTwInpSt"))
    table = _numbers(tower, "HtFract", n, 4)
    low, high = deck.number("TowerBsHt"), deck.number("TowerHt")
    heights = low + (high - low) * table[:, 0]
    mass = table[:, 1] * tower.number("AdjTwMa")
    rigidity = table[:, 2] * tower.number("AdjFASt")
    spans = list(pairwise(heights.tolist()))
    middle_mass, middle_rigidity = ((v[1:] + v[:-1]) / 2 for v in (mass, rigidity))
    return tuple(
        tube_of(bottom, top, m, ei)
        for (bottom, top), m, ei in zip(
            spans, middle_mass.tolist(), middle_rigidity.tolist(), strict=True
        )
    )


def tube_of(bottom: float, top: float, mass_per_length: float, rigidity: float) -> Tube:
    """Return the circular tube of steel that has this mass [kg/m] and this EI [N·m²].

    With A = m/ρ and I = EI/E:  D² + d² = 16 I/A  and  D² − d² = 4 A/π.
    """
    area = mass_per_length / TOWER_DENSITY
    both = 16 * rigidity / STEEL_MODULUS / area
    difference = 4 * area / np.pi
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


def monopile_tubes(deck: Deck) -> tuple[Tube, ...]:
    """Members of a SubDyn file as tubes, lowest first; TurbineError for a jacket.

    They deform by shear where SubDyn's do (`FEMMod` 3).
    """
    if deck.number("NReact") != 1:
        raise TurbineError(
            f"{deck.path}: it stands on {deck.text('NReact')} joints: no monopile, which has one"
        )
    joints = {
        int(row[0]): [float(value) for value in row[1:4]]
        for row in deck.table("JointID", int(deck.number("NJoints")))
    }
    sections = {
        int(row[0]): [float(value) for value in row[1:6]]
        for row in deck.table("PropSetID", int(deck.number("NPropSetsCyl", "NPropSets")))
    }
    has_shear = deck.number("FEMMod") == TIMOSHENKO
    tubes = []
    for row in deck.table("MemberID", int(deck.number("NMembers"))):
        ends = sorted((joints[int(row[1])], joints[int(row[2])]), key=lambda joint: joint[2])
        if max(abs(ends[0][0] - ends[1][0]), abs(ends[0][1] - ends[1][1])) > 0.01:
            raise TurbineError(f"{deck.path}: member {row[0]} is not upright: no monopile")
        first, second = sections[int(row[3])], sections[int(row[4])]
        modulus, shear_modulus, density, diameter, thickness = (
            (a + b) / 2 for a, b in zip(first, second, strict=True)
        )
        bottom, top = ends[0][2], ends[1][2]
        tube = Tube(bottom, top, diameter, thickness, modulus, density)
        if has_shear and shear_modulus > 0:
            ratio = modulus / (2 * shear_modulus) - 1  # ν of E = 2 (1 + ν) G
            tube = replace(tube, shear=True, poisson_ratio=ratio)
        tubes.append(tube)
    return tuple(sorted(tubes, key=lambda tube: tube.bottom))


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
    n = int(blade.number("NBlInpSt"))
    columns = blade.table("BlFract", n)
    values = np.array([[float(each) for each in row] for row in columns])
    fraction = values[:, 0]
    twist, mass, flap, edge = values[:, -4:].T  # some versions have the pitch axis between
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
        number=int(deck.number("NumBl")),
        elements=elements,
        hub_radius=deck.number("HubRad"),
        cone=-deck.number("PreCone(1)"),
        pitch=FEATHERED_PITCH,
    )


def mean_between(x: FloatArray, y: FloatArray, low: float, high: float) -> float:
    """Mean of the straight lines through (x, y) from `low` to `high`."""
    places = np.unique(np.concatenate([[low, high], x[(x > low) & (x < high)]]))
    values = np.interp(places, x, y)
    return float(np.sum((values[1:] + values[:-1]) / 2 * np.diff(places)) / (high - low))


def _numbers(deck: Deck, head: str, n_rows: int, n_columns: int) -> FloatArray:
    rows = deck.table(head, n_rows)
    try:
        return np.array([[float(each) for each in row[:n_columns]] for row in rows])
    except ValueError as error:
        raise TurbineError(f"{deck.path}, table of {head}: {error}") from error
