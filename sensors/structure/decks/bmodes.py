"""A description from a BModes or pyBModes tower file (.bmi) and its file of section properties.

Value and label stand on a line, value first, as in OpenFAST's files. The file has mass and EI along
the tower, from which follow tubes of steel, and one rigid body for rotor and nacelle; it has no
springs. Inertias of that body are about its own centre. Distributed added mass is left out: a
description has that of its water. Source: BModes user's guide, NREL 2007.
"""

from pathlib import Path

from sensors.structure.components import RigidBody, RotorNacelle, Tube, Water
from sensors.structure.decks.elastodyn import ON_GROUND, tapered_tubes
from sensors.structure.decks.input_file import Deck
from sensors.structure.description import LONGEST_ELEMENT, TurbineDescription
from sensors.structure.foundation import FoundationSprings, TurbineError

TOWER = 2  # beam_type


def read_bmodes(
    path: Path, springs: FoundationSprings, *, mudline: float | None = None
) -> TurbineDescription:
    """Return the tower of a .bmi file with a rigid rotor and nacelle.

    Parameters
    ----------
    path : Path
        The main file; the section properties stand where it names them.
    springs : FoundationSprings
        At the tower's base.
    mudline : float, optional
        Elevation of the base [m]; None: as `draft` and `hub_rad` have it.

    Raises
    ------
    TurbineError
        If a file or a figure is missing or cannot be right, it is a blade, the tower floats, or
        wires or springs along the pile hold it.
    """
    try:
        return _description(Deck(path), springs, mudline)
    except TurbineError:
        raise
    except (ArithmeticError, IndexError, KeyError, ValueError) as error:
        raise TurbineError(f"{path}: no tower of BModes: {error}") from error


def _description(
    deck: Deck, springs: FoundationSprings, mudline: float | None
) -> TurbineDescription:
    path = deck.path
    if deck.number("beam_type") != TOWER:
        raise TurbineError(f"{path}: beam_type is {deck.text('beam_type')}; {TOWER} is a tower")
    _require_one_set_of_springs(deck)
    draft = deck.number("draft") if deck.number("tow_support") else 0.0
    stated = deck.number("hub_rad") - draft
    length = deck.number("radius") - stated
    base = stated if mudline is None else mudline
    return TurbineDescription(
        name=path.stem,
        title=f"{path.stem}, from BModes",
        source=path.name,
        tubes=_tubes(deck, base, length),
        foundation=springs,
        water=Water() if base < -ON_GROUND else None,
        rotor_nacelle=RotorNacelle(bodies=(_top_body(deck),)),
    ).meshed()


def _require_one_set_of_springs(deck: Deck) -> None:
    """Raise TurbineError for a floater, a guyed tower and a pile with springs along it."""
    if not deck.number("tow_support"):
        return  # what stands below is not read by BModes either
    if deck.number("mass_pform"):
        raise TurbineError(f"{deck.path}: mass_pform is {deck.text('mass_pform')} kg: no monopile")
    for keyword, what in (
        ("n_secs_k_distr", "springs along the pile"),
        ("n_attachments", "tension wires"),
    ):
        if deck.has(keyword) and deck.count(keyword):
            raise TurbineError(
                f"{deck.path}: {keyword} is {deck.count(keyword)}, {what}; a description is one "
                "tower on one set of springs at its base"
            )


def _tubes(deck: Deck, base: float, length: float) -> tuple[Tube, ...]:
    """Tubes with the mass and the EI between stations; two at one place are a step."""
    sections = deck.beside("sec_props_file")
    table = sections.table("sec_loc", sections.count("n_secs"))
    place, mass, rigidity = table.numbers(0, 3, 6).T
    return tapered_tubes(
        base + length * place,
        mass * deck.number("sec_mass_mult"),
        rigidity * deck.number("flp_stff_mult"),
        LONGEST_ELEMENT * length,
    )


def _top_body(deck: Deck) -> RigidBody:
    centre = (deck.number("cm_loc"), 0.0, deck.number("cm_axial"))
    inertia = (deck.number("ixx_tip"), deck.number("iyy_tip"), deck.number("izz_tip"))
    return RigidBody("rotor and nacelle", deck.number("tip_mass"), centre, inertia)
