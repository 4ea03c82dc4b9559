"""A tower from a BModes file has the sections and the frequencies of its definition."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.decks.bmodes import read_bmodes
from sensors.structure.foundation import FoundationSprings, TurbineError

STIFF = FoundationSprings(1e13, 1e15, 1.0)

MAIN = """
{beam} beam_type 1: blade, 2: tower (-)
{radius} radius: tower height above ground or MSL (m)
0.0 hub_rad: tower rigid-base height (m)
2.4e5 tip_mass tower-top mass (kg)
-0.4 cm_loc offset (m)
1.9 cm_axial offset (m)
4e7 ixx_tip (kg-m^2)
2e7 iyy_tip (kg-m^2)
2.5e7 izz_tip (kg-m^2)
'sections.dat' sec_props_file name of the file
1.1 sec_mass_mult: (-)
0.9 flp_stff_mult: (-)
1 tow_support: (-)
{draft} draft : depth of tower base from MSL (m)
{platform} mass_pform : platform mass (kg)
"""
SECTIONS = """Properties
4 n_secs: number of stations (-)

sec_loc str_tw tw_iner mass_den flp_iner edge_iner flp_stff
(-) (deg) (deg) (kg/m) (kg-m) (kg-m) (Nm^2)
0.0 0 0 9000.0 0 0 1.0e12
0.5 0 0 9000.0 0 0 1.0e12
0.5 0 0 4000.0 0 0 4.5e11
1.0 0 0 4000.0 0 0 4.5e11
"""


def written(folder: Path, *, beam: int = 2, platform: float = 0.0) -> Path:
    (folder / "sections.dat").write_text(SECTIONS)
    path = folder / "tower.bmi"
    path.write_text(MAIN.format(beam=beam, radius=80.0, draft=20.0, platform=platform))
    return path


def test_tubes_have_the_mass_and_the_rigidity_of_the_stations(tmp_path: Path) -> None:
    found = read_bmodes(written(tmp_path), STIFF)
    assert (found.mudline, found.tower_top) == (-20.0, 80.0)
    assert found.water is not None
    lowest, highest = found.tubes[0], found.tubes[-1]
    assert lowest.mass_per_length == pytest.approx(1.1 * 9000)
    assert highest.bending_rigidity == pytest.approx(0.9 * 4.5e11)
    assert any(tube.top == pytest.approx(30.0) for tube in found.tubes)  # the step
    (body,) = found.rotor_nacelle.bodies
    assert (body.mass, body.centre, body.inertia) == (2.4e5, (-0.4, 0.0, 1.9), (4e7, 2e7, 2.5e7))


def test_the_base_can_be_stated(tmp_path: Path) -> None:
    found = read_bmodes(written(tmp_path), STIFF, mudline=0.0)
    assert (found.mudline, found.tower_top, found.water) == (0.0, 100.0, None)


@pytest.mark.parametrize(
    ("beam", "platform", "message"),
    [(1, 0.0, "beam_type is 1; 2 is a tower"), (2, 1e7, "mass_pform is 10000000.0 kg: no mono")],
)
def test_blades_and_floaters_are_refused(
    tmp_path: Path, beam: int, platform: float, message: str
) -> None:
    with pytest.raises(TurbineError, match=message):
        read_bmodes(written(tmp_path, beam=beam, platform=platform), STIFF)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("36 n_secs_k_distr: stations", "n_secs_k_distr is 36, springs along the pile; a descr"),
        ("2 n_attachments: of wires", "n_attachments is 2, tension wires; a description is one"),
    ],
)
def test_what_is_not_held_at_its_base_alone_is_refused(
    tmp_path: Path, line: str, message: str
) -> None:
    path = written(tmp_path)
    path.write_text(f"{path.read_text()}{line}\n")
    with pytest.raises(TurbineError, match=message):
        read_bmodes(path, STIFF)
    path.write_text(path.read_text().replace("1 tow_support", "0 tow_support"))
    assert read_bmodes(path, STIFF).tower_top == 80.0


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("0.5 0 0 4000.0", "0.5 0 0 none", "table of sec_loc: mass_den of row 3 is 'none'; a num"),
        ("0.5 0 0 4000.0", "0.4 0 0 4000.0", "the station at 20 m follows that at 30 m; stations"),
        ("1.0 0 0 4000.0", "1.0 0 0", "table of sec_loc: row 4 ends before flp_stff"),
        (
            "1.0 0 0 4000.0 0 0 4.5e11",
            "1.0 0 0 -4000.0 0 0 0",
            "no tube of steel has -733.333 kg/m",
        ),
        ("4 n_secs", "9 n_secs", "there is no table of sec_loc with 9 rows"),
    ],
)
def test_a_table_that_cannot_be_read_is_one_line(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = written(tmp_path)
    (tmp_path / "sections.dat").write_text(SECTIONS.replace(old, new))
    with pytest.raises(TurbineError, match=message):
        read_bmodes(path, STIFF)


def test_a_taper_of_two_stations_is_cut(tmp_path: Path) -> None:
    path = written(tmp_path)
    rows = "0.0 0 0 9000.0 0 0 1.0e12\n1.0 0 0 4000.0 0 0 4.5e11"
    head = SECTIONS.split("0.0 0 0")[0].replace("4 n_secs", "2 n_secs")
    (tmp_path / "sections.dat").write_text(head + rows)
    tubes = read_bmodes(path, STIFF).tubes
    assert len(tubes) == 12
    assert tubes[0].mass_per_length == pytest.approx(1.1 * (9000 - 5000 / 24))


def test_the_nrel_5mw_on_land_has_the_first_frequency_of_its_definition() -> None:
    # NREL/TP-500-38060, Table 9-1: first tower fore-aft 0.3195 (ADAMS) to 0.3240 Hz (FAST).
    # pyBModes itself has 0.3334: what a model gives without the coupling m·h of the top's offset.
    spec = find_spec("pybmodes")
    if spec is None or spec.origin is None:
        pytest.skip("pybmodes, which brings the file, is not installed")
    name = "01_nrel5mw_land"
    path = Path(spec.origin).parent / f"_examples/sample_inputs/reference_turbines/{name}"
    if not path.is_dir():
        pytest.skip("this version of pybmodes has no such file")
    turbine = replace(read_bmodes(path / f"{name}_tower.bmi", STIFF), gravity=0.0)
    assert (turbine.mudline, turbine.tower_top, turbine.water) == (0.0, 87.6, None)
    layout = biaxial_layout("l", turbine=turbine.name, unit="u", elevations=(40.0, 80.0))
    model = ModalModel(turbine, layout)
    side_side, fore_aft = np.sort(model.modal(model.nominal[None]).frequencies[0])[:2]
    assert 0.3195 < fore_aft < 0.3240
    assert side_side < fore_aft
