"""A monopile from SubDyn's input file: its members as tubes, its concentrated masses as points.

Source: OpenFAST documentation, SubDyn input file.
"""

import math
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from sensors.structure.components import PointMass, Tube, Vector
from sensors.structure.decks.input_file import Deck
from sensors.structure.decks.stations import edges_of, mean_between
from sensors.structure.foundation import TurbineError

TIMOSHENKO = 3  # `FEMMod` of members that deform by shear too
CIRCULAR_BEAM = ("1", "1c")  # `MType` of a member, before and since there are rectangular ones
PLUMB = 0.01  # an upright member's joints are one above the other to this [m]


def monopile_tubes(deck: Deck, longest: float = math.inf) -> tuple[Tube, ...]:
    """Members of a SubDyn file as tubes, lowest first; TurbineError for a jacket.

    They deform by shear where SubDyn's do (`FEMMod` 3).

    Parameters
    ----------
    deck : Deck
        SubDyn's file.
    longest : float
        A tapered member is cut into tubes of at most this length [m].
    """
    if deck.number("NReact") != 1:
        raise TurbineError(
            f"{deck.path}: it stands on {deck.text('NReact')} joints: no monopile, which has one"
        )
    joints, sections = _joints(deck), _sections(deck)
    has_shear = deck.number("FEMMod") == TIMOSHENKO
    tubes = []
    for member in _members(deck):
        places = [member.joint(joints, each) for each in member.ends]
        if math.dist(places[0][:2], places[1][:2]) > PLUMB:
            raise TurbineError(f"{member.name} is not upright: no monopile")
        if places[0][2] == places[1][2]:
            raise TurbineError(f"{member.name} has no length: both ends at {places[0][2]:g} m")
        heights = np.array([place[2] for place in places])
        figures = np.array([member.section(sections, each) for each in member.sections])
        order = np.argsort(heights)
        heights, figures = heights[order], figures[order]
        is_tapered = bool(np.any(figures[0] != figures[1]))
        for bottom, top in pairwise(edges_of(heights, longest if is_tapered else math.inf)):
            modulus, shear_modulus, density, diameter, thickness = (
                mean_between(heights, each, bottom, top) for each in figures.T
            )
            tube = Tube(bottom, top, diameter, thickness, modulus, density)
            if has_shear and shear_modulus > 0:
                ratio = modulus / (2 * shear_modulus) - 1  # ν of E = 2 (1 + ν) G
                tube = replace(tube, shear=True, poisson_ratio=ratio)
            tubes.append(tube)
    if not tubes:
        raise TurbineError(f"{deck.path}: NMembers is 0; a monopile has one or more")
    return tuple(sorted(tubes, key=lambda tube: tube.bottom))


def monopile_masses(deck: Deck) -> tuple[PointMass, ...]:
    """Concentrated masses of a SubDyn file, each at the height of its centre on the pile's axis.

    A point mass has neither rotational inertia nor a place beside the axis: `JMXX` to `JMYZ`,
    `MCGX` and `MCGY` do not enter. Of the IEA 15 MW turbine's transition piece the mass, 100 t,
    moves the first ten frequencies by up to 2.4 %, the inertia, 1.25e6 kg·m², by up to 0.04 %.
    """
    if not deck.has("NCmass") or deck.count("NCmass") == 0:
        return ()
    joints = _joints(deck)
    table = deck.table("CMJointID", deck.count("NCmass"))
    above = table.numbers("MCGZ")[:, 0] if table.has("MCGZ") else np.zeros(len(table.rows))
    masses = []
    for (number, mass), height in zip(table.numbers(0, 1).tolist(), above.tolist(), strict=True):
        if int(number) not in joints:
            raise TurbineError(
                f"{deck.path}: a mass of {mass:g} kg at joint {number:g}; {_those(joints)}"
            )
        name = f"joint {number:g} of SubDyn"
        masses.append(PointMass(name, joints[int(number)][2] + height, mass))
    return tuple(each for each in masses if each.mass > 0)


@dataclass(frozen=True, slots=True)
class _Member:
    """A row of the table of members."""

    name: str
    """File and number, for errors."""
    ends: tuple[int, int]
    sections: tuple[int, int]

    def joint(self, joints: dict[int, Vector], number: int) -> Vector:
        """Place of the joint at an end."""
        if number not in joints:
            raise TurbineError(f"{self.name} ends at joint {number}; {_those(joints)}")
        return joints[number]

    def section(self, sections: dict[int, tuple[float, ...]], number: int) -> tuple[float, ...]:
        """Figures of the section at an end."""
        if number not in sections:
            raise TurbineError(
                f"{self.name} has the section {number}; of circular ones {_those(sections)}"
            )
        return sections[number]


def _those(known: dict[int, Vector] | dict[int, tuple[float, ...]]) -> str:
    return f"there are {', '.join(map(str, known))}" if known else "there are none"


def _members(deck: Deck) -> list[_Member]:
    """Members, all circular beams."""
    table = deck.table("MemberID", deck.count("NMembers"))
    kinds = table.texts("MType") if table.has("MType") else [CIRCULAR_BEAM[0]] * len(table.rows)
    members = []
    for row, kind in zip(table.numbers(*range(5)).astype(int).tolist(), kinds, strict=True):
        member = _Member(f"{deck.path}: member {row[0]}", (row[1], row[2]), (row[3], row[4]))
        if kind not in CIRCULAR_BEAM:
            raise TurbineError(f"{member.name} has MType {kind}; a monopile has circular beams, 1c")
        members.append(member)
    return members


def _joints(deck: Deck) -> dict[int, Vector]:
    """Place of each joint [m] by its number."""
    rows = deck.table("JointID", deck.count("NJoints")).numbers(*range(4)).tolist()
    return {int(number): (x, y, z) for number, x, y, z in rows}


def _sections(deck: Deck) -> dict[int, tuple[float, ...]]:
    """E, G [Pa], density [kg/m³], diameter and wall [m] of each circular section by its number."""
    table = deck.table("PropSetID", deck.count("NPropSetsCyl", "NPropSets"))
    return {int(row[0]): tuple(row[1:]) for row in table.numbers(*range(6)).tolist()}
