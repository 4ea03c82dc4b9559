"""A turbine from OpenFAST's files has the sections and the frequencies of its definition."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from pipeline.offline.project_texts import description_toml
from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.decks.elastodyn import (
    BLADE_ELEMENTS,
    read_elastodyn,
    tower_tubes,
    tube_of,
)
from sensors.structure.decks.input_file import Deck
from sensors.structure.decks.subdyn import monopile_tubes
from sensors.structure.description import TurbineDescription, load_turbine, parse_turbine
from sensors.structure.foundation import FoundationSprings, TurbineError
from tests.sensors.structure.decks.written import pile_deck, turbine_deck

STIFF = FoundationSprings(1e13, 1e15, 1.0)


@pytest.fixture(scope="module")
def oc3() -> TurbineDescription:
    """The NREL 5 MW turbine on the OC3 monopile, as a peer package has its files."""
    spec = find_spec("pybmodes")
    if spec is None or spec.origin is None:
        pytest.skip("pybmodes, which brings the files, is not installed")
    folder = Path(spec.origin).parent / "_examples/reference_decks/nrel5mw_oc3monopile"
    if not folder.is_dir():
        pytest.skip("this version of pybmodes has no such files")
    name = "NRELOffshrBsline5MW_OC3Monopile"
    return read_elastodyn(
        folder / f"{name}_ElastoDyn.dat", STIFF, subdyn=folder / f"{name}_SubDyn.dat"
    )


def test_a_tube_is_found_again_from_its_mass_and_rigidity() -> None:
    tube = tube_of(0.0, 1.0, 4306.51, 4.7449e11)  # the lowest station of the NREL 5 MW's tower
    assert tube.mass_per_length == pytest.approx(4306.51)
    assert tube.bending_rigidity == pytest.approx(4.7449e11)
    assert (tube.diameter, tube.thickness) == pytest.approx((6.0, 0.027), rel=2e-3)


def test_a_decks_factors_scale_the_towers_mass_and_rigidity(tmp_path: Path) -> None:
    (tmp_path / "tower.dat").write_text(
        "2 NTwInpSt\n1.1 AdjTwMa\n0.9 AdjFASt\nHtFract TMassDen TwFAStif TwSSStif\n(-) (kg/m) "
        "(Nm^2) (Nm^2)\n0.0 4000.0 4.5e11 4.5e11\n1.0 4000.0 4.5e11 4.5e11\n"
    )
    (tmp_path / "main.dat").write_text('"tower.dat" TwrFile\n10.0 TowerBsHt\n90.0 TowerHt\n')
    (tube,) = tower_tubes(Deck(tmp_path / "main.dat"))
    assert (tube.bottom, tube.top) == (10.0, 90.0)
    assert tube.mass_per_length == pytest.approx(1.1 * 4000.0)
    assert tube.bending_rigidity == pytest.approx(0.9 * 4.5e11)


def test_a_tower_of_two_stations_keeps_its_taper(tmp_path: Path) -> None:
    rows = ("0.0 8000.0 8e11 8e11", "1.0 2000.0 1e11 1e11")
    tubes = read_elastodyn(turbine_deck(tmp_path, tower=rows), STIFF).tubes
    assert len(tubes) == 12
    for tube in tubes:
        height = (tube.bottom + tube.top - 20) / 160  # from 10 to 90 m [-]
        assert tube.mass_per_length == pytest.approx(8000 - 6000 * height)
        assert tube.bending_rigidity == pytest.approx(8e11 - 7e11 * height)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("90.0 TowerHt", "9.0 TowerHt", "TowerHt is 9 m; it must lie above TowerBsHt, 10 m"),
        ("3 NumBl", "0 NumBl", "blades: number is 0; at least 1 is needed"),
    ],
)
def test_a_figure_that_cannot_be_right_is_refused(
    tmp_path: Path, old: str, new: str, message: str
) -> None:
    with pytest.raises(TurbineError, match=message):
        read_elastodyn(turbine_deck(tmp_path, changes={old: new}), STIFF)


def test_stations_that_do_not_ascend_are_refused(tmp_path: Path) -> None:
    rows = ("0.0 4e3 4e11 4e11", "0.6 4e3 4e11 4e11", "0.5 4e3 4e11 4e11", "1.0 4e3 4e11 4e11")
    message = "the station at 50 m follows that at 58 m; stations ascend"
    with pytest.raises(TurbineError, match=message):
        read_elastodyn(turbine_deck(tmp_path, tower=rows), STIFF)


@pytest.mark.parametrize("mass", [1e5, 0.0, -1.0])
def test_what_no_tube_has_is_refused(mass: float) -> None:
    with pytest.raises(TurbineError, match="no tube of steel"):
        tube_of(0.0, 10.0, mass, 1e9)


def test_the_oc3_monopile_has_the_masses_of_its_definition(oc3: TurbineDescription) -> None:
    # NREL/TP-500-38060: tower of the OC3 monopile 237 t, nacelle 240 t, rotor 110 t
    tower = sum(t.mass_per_length * t.length for t in oc3.tubes if t.bottom > 9.9)
    assert tower == pytest.approx(237e3, rel=0.01)
    assert oc3.blades is not None
    lengths = [each.outer - each.inner for each in oc3.blades.elements]
    assert len(lengths) == BLADE_ELEMENTS
    assert lengths == pytest.approx(lengths[:1] * BLADE_ELEMENTS)
    blades = 3 * sum(e.mass_per_length * (e.outer - e.inner) for e in oc3.blades.elements)
    assert blades + oc3.rotor_nacelle.hub_mass == pytest.approx(110e3, rel=0.01)
    assert (oc3.mudline, oc3.tower_top) == pytest.approx((-20.0, 87.6), abs=1e-3)
    assert (oc3.rotor_nacelle.tilt, oc3.blades.cone) == (5.0, 2.5)


def test_the_oc3_monopile_has_the_first_frequency_of_its_code_comparison(
    oc3: TurbineDescription,
) -> None:
    # OC3 phase I (NREL/TP-5000-48191): 0.27 to 0.28 Hz on a rigid base; gravity takes off 2 to 3 %
    layout = biaxial_layout("l", turbine=oc3.name, unit="u", elevations=(40.0, 87.0))
    model = ModalModel(oc3, layout)
    frequencies = np.sort(model.modal(model.nominal[None]).frequencies[0])
    assert 0.265 < frequencies[0] < frequencies[1] < 0.282
    light = ModalModel(replace(oc3, gravity=1e-4), layout)
    without = np.sort(light.modal(light.nominal[None]).frequencies[0])
    assert 0.276 < without[0] < without[1] < 0.28
    np.testing.assert_allclose(frequencies[:2] / without[:2], 0.98, atol=0.005)


def test_the_text_is_read_again_as_the_same_structure(oc3: TurbineDescription) -> None:
    for turbine in (oc3, load_turbine("iea15mw_monopile")):
        again = parse_turbine(description_toml(turbine), source="again.toml")
        assert again.blades is not None
        assert turbine.blades is not None
        assert again.name == turbine.name
        assert [tube.shear for tube in again.tubes] == [tube.shear for tube in turbine.tubes]
        for attribute in ("bottom", "diameter", "thickness", "density", "youngs_modulus"):
            np.testing.assert_allclose(
                [getattr(tube, attribute) for tube in again.tubes],
                [getattr(tube, attribute) for tube in turbine.tubes],
                rtol=1e-8,
            )
        assert again.rotor_nacelle == turbine.rotor_nacelle
        assert again.water == turbine.water


SUBDYN = """
{theory} FEMMod - element model
{legs} NReact
{members} NMembers
3 NJoints
JointID X Y Z
- - - -
1 0.0 0.0 -20.0
2 0.0 0.0 -5.0
3 {x} 0.0 10.0
MemberID MJointID1 MJointID2 MPropSetID1 MPropSetID2
- - - - -
1 1 2 1 1
2 2 3 1 1
1 {sections}
PropSetID YoungE ShearG MatDens XsecD XsecT
- - - - - -
1 2.1e11 8.08e10 8500.0 6.0 0.06
"""


@pytest.mark.parametrize("sections", ["NPropSets", "NPropSetsCyl"])
def test_a_monopile_of_any_version_of_subdyn_is_read(tmp_path: Path, sections: str) -> None:
    path = tmp_path / "a.dat"
    path.write_text(SUBDYN.format(theory=1, legs=1, members=2, x=0.0, sections=sections))
    assert [(tube.bottom, tube.top) for tube in monopile_tubes(Deck(path))] == [
        (-20.0, -5.0),
        (-5.0, 10.0),
    ]


@pytest.mark.parametrize(("theory", "shear"), [(1, False), (3, True)])
def test_a_monopile_deforms_by_shear_where_subdyn_has_it_so(
    tmp_path: Path, theory: int, shear: bool
) -> None:
    path = tmp_path / "a.dat"
    text = SUBDYN.format(theory=theory, legs=1, members=2, x=0.0, sections="NPropSetsCyl")
    path.write_text(text.replace("8.08e10", "7.5e10"))
    for tube in monopile_tubes(Deck(path)):
        assert tube.shear is shear
        assert tube.poisson_ratio == pytest.approx(0.4 if shear else 0.3)


@pytest.mark.parametrize(
    ("legs", "x", "message"),
    [(4, 0.0, "stands on 4 joints: no monopile"), (1, 3.0, "member 2 is not upright")],
)
def test_a_jacket_is_refused_in_one_line(tmp_path: Path, legs: int, x: float, message: str) -> None:
    path = tmp_path / "a.dat"
    path.write_text(SUBDYN.format(theory=1, legs=legs, members=2, x=x, sections="NPropSets"))
    with pytest.raises(TurbineError, match=message):
        monopile_tubes(Deck(path))


# Tower, rotor and nacelle of the small deck weigh 642 t: 80 m of 4 t/m, 50 t, 200 t, 3 x 24 t.


def with_platform(folder: Path, mass: float, centre: float) -> TurbineDescription:
    changes = {"0.0 PtfmMass": f"{mass} PtfmMass", "10.0 PtfmCMzt": f"{centre} PtfmCMzt"}
    return read_elastodyn(turbine_deck(folder, changes=changes), STIFF, subdyn=pile_deck(folder))


# NREL/TP-500-47535 (OC3's spar), TP-5000-60601 (OC4's semi-submersible), r-test's barge of ITI
@pytest.mark.parametrize(
    ("mass", "centre"), [(7.46633e6, -89.9155), (3.85218e6, -8.6588), (5.452e6, -0.281768)]
)
def test_a_floater_is_refused_with_its_mass(tmp_path: Path, mass: float, centre: float) -> None:
    message = f"PtfmMass {mass / 1e3:.0f} t at {centre:.4g} m weighs more than .*, 642 t: a floater"
    with pytest.raises(TurbineError, match=message):
        with_platform(tmp_path, mass, centre)


def test_a_platform_of_negative_mass_is_refused(tmp_path: Path) -> None:
    with pytest.raises(TurbineError, match="mass is -1; it must not be negative"):
        with_platform(tmp_path, -1.0, 10.0)


def test_a_platform_that_is_not_on_the_structure_is_refused(tmp_path: Path) -> None:
    message = r"PtfmMass 300 t at -25 m is not on the structure, -20 to 90 m: a floater, a slab, or"
    with pytest.raises(TurbineError, match=message):
        with_platform(tmp_path, 3e5, -25.0)


@pytest.mark.parametrize(("centre", "elevation"), [(10.0, 10.0), (4.0, 4.0), (-20.001, -20.0)])
def test_a_transition_piece_stands_where_its_centre_is(
    tmp_path: Path, centre: float, elevation: float
) -> None:
    # 450 t at the tower's base: the IEA 15 MW monopile of 2020
    (piece,) = with_platform(tmp_path, 4.5e5, centre).point_masses
    assert (piece.mass, piece.elevation) == (4.5e5, elevation)


def test_the_floaters_of_a_peer_package_are_refused() -> None:
    spec = find_spec("pybmodes")
    if spec is None or spec.origin is None:
        pytest.skip("pybmodes, which brings the files, is not installed")
    decks = Path(spec.origin).parent / "_examples/reference_decks"
    floaters = [
        path
        for path in sorted(decks.glob("*/*_ElastoDyn.dat"))
        if path.parent.name.endswith(("spar", "semi"))
    ]
    for path in floaters:
        with pytest.raises(TurbineError, match="weighs more than tower, rotor and nacelle"):
            read_elastodyn(path, STIFF)


def test_a_monopile_ends_exactly_where_the_tower_begins(tmp_path: Path) -> None:
    pile = pile_deck(tmp_path, changes={"3 0.0 0.0 10.0": "3 0.0 0.0 10.0001"})
    found = read_elastodyn(turbine_deck(tmp_path), STIFF, subdyn=pile)
    assert 10.0 in [tube.top for tube in found.tubes]
    low = pile_deck(tmp_path, changes={"3 0.0 0.0 10.0": "3 0.0 0.0 9.0"})
    with pytest.raises(TurbineError, match=r"ends at 9 m; the tower of .* begins at 10 m"):
        read_elastodyn(turbine_deck(tmp_path), STIFF, subdyn=low)


def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.dat").write_text("nothing\n")
    with pytest.raises(TurbineError, match="there is no TowerBsHt; is it the right kind"):
        read_elastodyn(tmp_path / "a.dat", STIFF)
