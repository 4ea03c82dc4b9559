"""A monopile from SubDyn's file has its sections and masses; what is no monopile is refused."""

from pathlib import Path

import pytest

from sensors.structure.decks.input_file import Deck
from sensors.structure.decks.subdyn import monopile_tubes
from sensors.structure.foundation import TurbineError
from tests.sensors.structure.decks.written import pile_deck


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("2 2 3 1 1 1c 0", "2 2 3 9 9 1c 0", "member 2 has the section 9; of circular ones there"),
        ("2 2 3 1 1 1c 0", "2 2 77 1 1 1c 0", "member 2 ends at joint 77; there are 1, 2, 3"),
        ("2 2 3 1 1 1c 0", "2 2 3 1 1 3 0", "member 2 has MType 3; a monopile has circular beams"),
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
