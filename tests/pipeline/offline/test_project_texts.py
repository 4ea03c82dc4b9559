"""What a project's folder has of its structure."""

from pathlib import Path
from typing import Any

import pytest

from pipeline.offline.project_texts import structure_text
from sensors.errors import InputError
from sensors.structure.foundation import FoundationSprings

SPRINGS = FoundationSprings(1e9, 1e11, 5e9)


@pytest.mark.parametrize("structure", ["iea15mw_monopile", "none"])
@pytest.mark.parametrize(
    "given", [{"subdyn": Path("a_SubDyn.dat")}, {"springs": SPRINGS}, {"mudline": 0.0}]
)
def test_a_structure_that_has_its_springs_takes_none_of_another_programs_figures(
    structure: str, given: dict[str, Any]
) -> None:
    with pytest.raises(InputError, match="--subdyn, --springs and --mudline are for"):
        structure_text(structure, **given)
    assert structure_text(structure) is None


@pytest.mark.parametrize(
    ("name", "given", "message"),
    [
        ("a.yaml", {"subdyn": Path("a_SubDyn.dat"), "springs": SPRINGS}, "--subdyn is for"),
        ("a.bmi", {"subdyn": Path("a_SubDyn.dat"), "springs": SPRINGS}, "--subdyn is for"),
        ("a_ElastoDyn.dat", {"mudline": 0.0, "springs": SPRINGS}, "--mudline is for"),
        ("a.yaml", {}, "has no springs of the mudline"),
    ],
)
def test_each_program_takes_its_own_figures_alone(
    name: str, given: dict[str, Any], message: str, tmp_path: Path
) -> None:
    (tmp_path / name).write_text("")
    with pytest.raises(InputError, match=message):
        structure_text(str(tmp_path / name), **given)
    with pytest.raises(InputError, match="no such file"):
        structure_text(str(tmp_path / "missing.yaml"))
