"""A description from a BModes or pyBModes tower file (.bmi) and its file of section properties.

Value and label stand on a line, value first, as in OpenFAST's files. The file has mass and EI along
the tower, from which follow tubes of steel, and one rigid body for rotor and nacelle; it has no
springs. Inertias of that body are about its own centre. Source: BModes user's guide, NREL 2007.
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
        If a file or a figure is missing, it is a blade, or the tower floats.
    """
    deck = Deck(path)
    if deck.number("beam_type") != TOWER:
        raise TurbineError(f"{path}: beam_type is {deck.text('beam_type')}; {TOWER} is a tower")
    if deck.number("tow_support") and deck.number("mass_pform"):
        raise TurbineError(f"{path}: mass_pform is {deck.text('mass_pform')} kg: no monopile")
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
