"""Values and tables of a deck are found by their labels; what is wrong is named in one line."""

from pathlib import Path

import pytest

from sensors.structure.decks.elastodyn import read_elastodyn
from sensors.structure.decks.input_file import Deck
from sensors.structure.foundation import FoundationSprings, TurbineError
from tests.sensors.structure.decks.written import BLADE_ROWS, BLADE_TITLES, turbine_deck

STIFF = FoundationSprings(1e13, 1e15, 1.0)


def written(folder: Path, text: str) -> Deck:
    path = folder / "a.dat"
    path.write_text(text)
    return Deck(path)


@pytest.mark.parametrize("label", ["PreCone(1)", "PreCone1", "PRECONE[1]", "precone(1):"])
def test_a_keyword_is_found_in_any_spelling(tmp_path: Path, label: str) -> None:
    assert written(tmp_path, f"-4.0 {label} - cone\n").number("PreCone(1)") == -4.0


@pytest.mark.parametrize(
    ("label", "name"), [("BldFile1", "blade.dat"), ("BldFile(1)", "my blade.dat")]
)
def test_a_blade_file_is_found_by_any_label_and_with_a_space_in_its_name(
    tmp_path: Path, label: str, name: str
) -> None:
    changes = {'"blade.dat" BldFile(1)': f'"{name}" {label}'}
    path = turbine_deck(tmp_path, changes=changes, blade_name=name)
    blades = read_elastodyn(path, STIFF).blades
    assert blades is not None
    assert blades.elements[-1].outer == 60.0


def test_a_file_is_found_by_a_name_of_an_earlier_version(tmp_path: Path) -> None:
    deck = written(tmp_path, "'b.dat' OldName\n")
    (tmp_path / "b.dat").write_text("1.5D+02 Value\n")
    assert deck.beside("NewName", "OldName").number("Value") == 150.0


def test_columns_of_a_blade_are_found_by_their_titles(tmp_path: Path) -> None:
    # seventeen columns in the order of FAST 7, with the offsets of the axes at the end
    titles = (
        "BlFract AeroCent StrcTwst BMassDen FlpStff EdgStff GJStff EAStff Alpha FlpIner EdgIner "
        "PrecrvRef PreswpRef FlpcgOf EdgcgOf FlpEAOf EdgEAOf"
    )
    more = "1e9 1e9 0.0 900.0 900.0 0.0 0.0 0.1 0.2 0.03 0.05"
    rows = tuple(f"{row.split()[0]} 0.25 {' '.join(row.split()[1:])} {more}" for row in BLADE_ROWS)
    found = [
        read_elastodyn(turbine_deck(tmp_path, blade=blade, titles=those), STIFF).blades
        for blade, those in ((rows, titles), (BLADE_ROWS, BLADE_TITLES))
    ]
    assert found[0] == found[1]


def test_a_comment_behind_a_row_is_none_of_its_columns(tmp_path: Path) -> None:
    rows = (f"{BLADE_ROWS[0]} ! root", BLADE_ROWS[1])
    commented = read_elastodyn(turbine_deck(tmp_path, blade=rows), STIFF)
    assert commented.blades == read_elastodyn(turbine_deck(tmp_path), STIFF).blades


@pytest.mark.parametrize(
    ("row", "titles", "message"),
    [
        ("0.0 12.0 ! root", BLADE_TITLES, "table of BlFract: BMassDen of row 1 is '!'; a number"),
        ("0.0 12.0", BLADE_TITLES, "table of BlFract: row 1 ends before BMassDen: '0.0 12.0'"),
        (BLADE_ROWS[0], BLADE_TITLES.replace("FlpStff", "Stff"), "no column FlpStff; it has BlFr"),
    ],
)
def test_a_table_that_cannot_be_read_is_named_with_its_row_and_column(
    tmp_path: Path, row: str, titles: str, message: str
) -> None:
    path = turbine_deck(tmp_path, blade=(row, BLADE_ROWS[1]), titles=titles)
    with pytest.raises(TurbineError, match=message):
        read_elastodyn(path, STIFF)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("2.5 NumBl", "NumBl is 2.5; a count is needed"),
        ("nan NumBl", "NumBl is 'nan'; a number is needed"),
        ('"" NumBl', "NumBl is ''; a number is needed"),
        ("3 Blades", "there is no NumBl; is it the right kind of file"),
    ],
)
def test_a_count_that_is_none_is_refused(tmp_path: Path, text: str, message: str) -> None:
    with pytest.raises(TurbineError, match=message):
        written(tmp_path, text).count("NumBl")


def test_a_table_that_ends_too_early_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TurbineError, match="no table of JointID with 2 rows"):
        written(tmp_path, "JointID X\n- -\n1 0.0\n").table("JointID", 2)
