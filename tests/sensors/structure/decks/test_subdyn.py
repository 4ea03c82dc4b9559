"""A monopile from SubDyn's file has its sections and masses; what is no monopile is refused."""

from pathlib import Path

import pytest

from sensors.structure.decks.elastodyn import read_elastodyn
from sensors.structure.decks.input_file import Deck
from sensors.structure.decks.subdyn import monopile_masses, monopile_tubes
from sensors.structure.foundation import FoundationSprings, TurbineError
from tests.sensors.structure.decks.written import pile_deck, turbine_deck

STIFF = FoundationSprings(1e13, 1e15, 1.0)
FIVE = "CMJointID JMass JMXX JMYY JMZZ"  # columns until 2020
ELEVEN = f"{FIVE} JMXY JMXZ JMYZ MCGX MCGY MCGZ"


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2 2 3 1 1 1c 0", "2 2 3 9 9 1c 0", "member 2 has the section 9; of circular ones there"),
        ("2 2 3 1 1 1c 0", "2 2 77 1 1 1c 0", "member 2 ends at joint 77; there are 1, 2, 3"),
        ("2 2 3 1 1 1c 0", "2 2 3 1 1 3 0", "member 2 has MType 3; a monopile has circular beams"),
        ("3 0.0 0.0 10.0", "3 0.0 0.0 -5.0", "member 2 has no length: both ends at -5 m"),
        ("3 0.0 0.0 10.0", "3 0.0 0.0 top", "JointZss of row 3 is 'top'; a number is needed"),
        ("1 NPropSetsCyl", "0 NPropSetsCyl", "section 1; of circular ones there are none"),
    ],
)
def test_a_member_that_is_no_beam_between_known_joints_is_refused_in_one_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = pile_deck(tmp_path, changes={old: new})
    with pytest.raises(TurbineError, match=message):
        monopile_tubes(Deck(path))


def test_a_tapered_member_is_cut(tmp_path: Path) -> None:
    second = "1 2.1e11 8.08e10 8500.0 6.0 0.06\n2 2.1e11 8.08e10 8500.0 9.0 0.03"
    changes = {
        "1 1 2 1 1 1c 0": "1 2 1 1 2 1c 0",  # named from its upper end
        "1 NPropSetsCyl": "2 NPropSetsCyl",
        "1 2.1e11 8.08e10 8500.0 6.0 0.06": second,
    }
    tubes = monopile_tubes(Deck(pile_deck(tmp_path, changes=changes)), 5.0)
    assert [tube.bottom for tube in tubes] == [-20.0, -15.0, -10.0, -5.0]
    assert [tube.diameter for tube in tubes] == pytest.approx([8.5, 7.5, 6.5, 6.0])
    assert [tube.thickness for tube in tubes] == pytest.approx([0.035, 0.045, 0.055, 0.06])


def test_a_file_without_members_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TurbineError, match="NMembers is 0; a monopile has one or more"):
        monopile_tubes(Deck(pile_deck(tmp_path, changes={"2 NMembers": "0 NMembers"})))


@pytest.mark.parametrize(
    ("titles", "row", "elevation"),
    [
        # the transition piece of the IEA 15 MW monopile, 100 t: IEA-15-240-RWT-Monopile_SubDyn
        (ELEVEN, "3 100000.0 1250000.0 1250000.0 2500000.0 0.0 0.0 0.0 0.0 0.0 0.0", 10.0),
        (ELEVEN, "2 100000.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 1.5", -3.5),
        (ELEVEN, "3 100000.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 0.0 2.0 ! on the tower", 12.0),
        (FIVE, "3 100000.0 0.0 0.0 0.0", 10.0),
    ],
)
def test_a_concentrated_mass_stands_at_its_centre(
    tmp_path: Path, titles: str, row: str, elevation: float
) -> None:
    pile = pile_deck(tmp_path, more=f"1 NCmass - number\n{titles}\n(units)\n{row}\n")
    (mass,) = read_elastodyn(turbine_deck(tmp_path), STIFF, subdyn=pile).point_masses
    assert (mass.mass, mass.elevation) == (1e5, elevation)


@pytest.mark.parametrize("more", ["", f"0 NCmass - number\n{FIVE}\n(units)\n"])
def test_a_file_without_concentrated_masses_has_none(tmp_path: Path, more: str) -> None:
    assert monopile_masses(Deck(pile_deck(tmp_path, more=more))) == ()


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("9 1e5 0 0 0 0 0 0 0 0 0", "a mass of 100000 kg at joint 9; there are 1, 2, 3"),
        ("1 1e5 0 0 0 0 0 0 0 0 -5", "joint 1 of SubDyn': elevation -25 m is not on the tower"),
        ("3 -1e5 0 0 0 0 0 0 0 0 0", "joint 3 of SubDyn': mass is -100000; it must not be neg"),
        ("3 1e5 0 0 0", "table of CMJointID: row 1 ends before MCGZ"),
    ],
)
def test_a_mass_that_is_nowhere_on_the_structure_is_refused(
    tmp_path: Path, row: str, message: str
) -> None:
    pile = pile_deck(tmp_path, more=f"1 NCmass - number\n{ELEVEN}\n(units)\n{row}\n")
    with pytest.raises(TurbineError, match=message):
        read_elastodyn(turbine_deck(tmp_path), STIFF, subdyn=pile)
