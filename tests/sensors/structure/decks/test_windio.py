"""A turbine from a WindIO file has the sections that the file states."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from sensors.structure.decks.elastodyn import BLADE_ELEMENTS
from sensors.structure.decks.windio import read_windio
from sensors.structure.foundation import FoundationSprings, TurbineError

pytest.importorskip("yaml", reason="the extra `windio` is not installed")

SPRINGS = FoundationSprings(1e10, 1e12, 1e10)


def ends(first: float, last: float) -> dict[str, list[float]]:
    return {"grid": [0.0, 1.0], "values": [first, last]}


def shell(bottom: float, top: float, diameter: float, wall: float) -> dict[str, Any]:
    """A tower or a monopile of one section."""
    return {
        "reference_axis": {"z": ends(bottom, top)},
        "outer_shape": {"outer_diameter": ends(diameter, diameter)},
        "structure": {
            "outfitting_factor": 1.1,
            "layers": [{"material": "steel", "thickness": ends(wall, wall)}],
        },
    }


def turbine(**components: Any) -> dict[str, Any]:
    """A small turbine; JSON of it is YAML too."""
    elastic = {
        "inertia_matrix": {"grid": [0.0, 1.0], "mass": [300.0, 100.0]},
        "stiffness_matrix": {"grid": [0.0, 1.0], "K44": [2e9, 2e9], "K55": [1e9, 1e9]},
    }
    blade = {
        "reference_axis": {"z": ends(0.0, 60.0)},
        "outer_shape": {"twist": ends(10.0, 0.0)},
        "structure": {"elastic_properties": elastic},
    }
    drivetrain = {
        "outer_shape": {"uptilt": 5.0, "overhang": 5.0, "distance_tt_hub": 2.4},
        "elastic_properties": {"mass": 2e5, "location": [1, 0, 2], "inertia": [1e6, 2e6, 3e6]},
    }
    hub = {
        "diameter": 3.0,
        "cone_angle": 2.5,
        "elastic_properties": {"mass": 5e4, "inertia": [1e5, 0, 0]},
    }
    parts = {"tower": shell(10.0, 90.0, 5.0, 0.03), "blade": blade, "hub": hub}
    return {
        "name": "small",
        "assembly": {"number_of_blades": 3},
        "components": parts | {"drivetrain": drivetrain} | components,
        "materials": [{"name": "steel", "E": 2e11, "rho": 7800.0}],
    }


def written(folder: Path, content: Any) -> Path:
    path = folder / "small.yaml"
    path.write_text(json.dumps(content))
    return path


def test_tubes_blades_and_masses_are_the_files(tmp_path: Path) -> None:
    found = read_windio(written(tmp_path, turbine()), SPRINGS)
    assert (found.mudline, found.tower_top, found.water) == (10.0, 90.0, None)
    assert found.tubes[0].density == pytest.approx(1.1 * 7800)
    assert found.blades is not None
    mass = sum(each.mass_per_length * each.length for each in found.blades.elements)
    assert mass == pytest.approx(60 * 200)
    assert found.blades.elements[0].flapwise_rigidity == pytest.approx(1e9)
    assert found.blades.elements[0].edgewise_rigidity == pytest.approx(2e9)
    assert found.rotor_nacelle.bodies[0].mass == 2e5


def test_the_hub_is_where_the_file_has_it(tmp_path: Path) -> None:
    from sensors.structure.rotor_nacelle import apex

    found = read_windio(written(tmp_path, turbine()), SPRINGS)
    assert apex(found.rotor_nacelle) == pytest.approx([-5.0, 0.0, 2.4])


def test_a_monopile_is_cut_at_the_mudline(tmp_path: Path) -> None:
    path = written(tmp_path, turbine(monopile=shell(-60.0, 10.0, 6.0, 0.06)))
    found = read_windio(path, SPRINGS, mudline=-25.0)
    assert found.mudline == -25.0
    assert found.water is not None
    assert found.transition == 10.0
    with pytest.raises(TurbineError, match="--mudline METRES"):
        read_windio(path, SPRINGS)
    with pytest.raises(TurbineError, match="the monopile is from -60 to 10 m"):
        read_windio(path, SPRINGS, mudline=-80.0)


def test_a_section_that_ends_at_the_mudline_is_not_there(tmp_path: Path) -> None:
    monopile = shell(-60.0, 10.0, 6.0, 0.06)
    monopile["reference_axis"]["z"] = {"grid": [0.0, 0.5, 1.0], "values": [-60.0, -25.0, 10.0]}
    path = written(tmp_path, turbine(monopile=monopile))
    found = read_windio(path, SPRINGS, mudline=-25.0)
    assert found.tubes[0].bottom == -25.0
    assert min(tube.length for tube in found.tubes) > 1.0


@pytest.mark.parametrize("content", [{"a": 1}, [1, 2], "text", {"components": {}}])
def test_another_file_is_refused(tmp_path: Path, content: Any) -> None:
    with pytest.raises(TurbineError, match="no turbine of WindIO 2"):
        read_windio(written(tmp_path, content), SPRINGS)


@pytest.mark.parametrize(
    ("content", "reason"),
    [
        (turbine(floating_platform={}), "has a floating_platform; a description is one tower"),
        (turbine(tower={"outer_shape_bem": {}}), "is of WindIO 1"),
        (turbine(hub={"diameter": 4.0}), "'elastic_properties' is missing"),
    ],
)
def test_what_is_no_tower_of_version_2_is_named(tmp_path: Path, content: Any, reason: str) -> None:
    with pytest.raises(TurbineError, match=reason):
        read_windio(written(tmp_path, content), SPRINGS)


def test_blades_are_equal_elements_with_the_mean_mass_of_the_files_between_their_ends(
    tmp_path: Path,
) -> None:
    blades = read_windio(written(tmp_path, turbine()), SPRINGS).blades
    assert blades is not None
    ends = np.linspace(0.0, 60.0, BLADE_ELEMENTS + 1)
    assert [each.outer for each in blades.elements] == pytest.approx(ends[1:])
    middles = (ends[:-1] + ends[1:]) / 2
    masses = [each.mass_per_length for each in blades.elements]
    assert masses == pytest.approx(300 - 200 * middles / 60)


@pytest.mark.parametrize("products", [[], [4e5, 5e5, 6e5]])
def test_a_body_has_its_moments_of_inertia_and_its_products_where_the_file_has_them(
    products: list[float], tmp_path: Path
) -> None:
    small = turbine()
    body = small["components"]["drivetrain"]["elastic_properties"]
    body["inertia"] = [1e6, 2e6, 3e6, *products]
    (found,) = read_windio(written(tmp_path, small), SPRINGS).rotor_nacelle.bodies
    assert found.inertia == (1e6, 2e6, 3e6)
    assert found.products == (tuple(products) or (0.0, 0.0, 0.0))


def test_a_straight_axis_keeps_the_taper_of_diameter_and_wall(tmp_path: Path) -> None:
    # z of a straight tower needs its two ends only; diameter and wall have grids of their own
    tower = shell(10.0, 90.0, 5.0, 0.03)
    tower["outer_shape"]["outer_diameter"] = {"grid": [0.0, 0.5, 1.0], "values": [8.0, 6.0, 5.0]}
    (layer,) = tower["structure"]["layers"]
    layer["thickness"] = {"grid": [0.0, 0.25, 0.25, 1.0], "values": [0.06, 0.06, 0.04, 0.02]}
    tubes = read_windio(written(tmp_path, turbine(tower=tower)), SPRINGS).tubes
    assert {30.0, 50.0} <= {round(tube.top, 9) for tube in tubes}
    middles = [(tube.bottom + tube.top) / 2 for tube in tubes]
    diameters = np.interp(middles, [10.0, 50.0, 90.0], [8.0, 6.0, 5.0])
    walls = np.where(np.less(middles, 30), 0.06, np.interp(middles, [30.0, 90.0], [0.04, 0.02]))
    assert [tube.diameter for tube in tubes] == pytest.approx(diameters.tolist())
    assert [tube.thickness for tube in tubes] == pytest.approx(walls.tolist())
    assert max(tube.length for tube in tubes) < 80 / 12 + 1e-9


def test_a_taper_is_cut_where_the_mudline_is(tmp_path: Path) -> None:
    monopile = shell(-60.0, 10.0, 6.0, 0.06)
    monopile["outer_shape"]["outer_diameter"] = ends(13.0, 6.0)  # a tenth of a metre a metre
    path = written(tmp_path, turbine(monopile=monopile))
    for tube in read_windio(path, SPRINGS, mudline=-25.0).tubes:
        if tube.top <= 10.0:
            assert tube.diameter == pytest.approx(7 - (tube.bottom + tube.top) / 20)


def test_stations_of_two_tables_that_differ_by_rounding_make_no_sliver(tmp_path: Path) -> None:
    tower = shell(10.0, 90.0, 5.0, 0.03)
    tower["reference_axis"]["z"] = {"grid": [0.0, 1 / 3, 1.0], "values": [10.0, 36.667, 90.0]}
    tower["outer_shape"]["outer_diameter"] = {"grid": [0.0, 0.333, 1.0], "values": [6.0, 6.0, 5.0]}
    tubes = read_windio(written(tmp_path, turbine(tower=tower)), SPRINGS).tubes
    assert min(tube.length for tube in tubes) > 1.0


def layered(*layers: tuple[str, list[float], list[float]]) -> dict[str, Any]:
    """A tower of several layers: material, grid and thickness of each."""
    tower = shell(10.0, 90.0, 5.0, 0.03)
    tower["structure"]["layers"] = [
        {"name": f"wall {n}", "material": material, "thickness": {"grid": grid, "values": values}}
        for n, (material, grid, values) in enumerate(layers, start=1)
    ]
    return tower


def test_layers_of_one_material_are_one_wall(tmp_path: Path) -> None:
    tower = layered(("steel", [0, 1], [0.03, 0.03]), ("steel", [0, 0.5, 1], [0.02, 0.02, 0.0]))
    tubes = read_windio(written(tmp_path, turbine(tower=tower)), SPRINGS).tubes
    walls = [0.03 + 0.02 * min(1, (90 - (tube.bottom + tube.top) / 2) / 40) for tube in tubes]
    assert [tube.thickness for tube in tubes] == pytest.approx(walls)


@pytest.mark.parametrize(
    ("tower", "message"),
    [
        (
            layered(("concrete", [0, 1], [0.3, 0.2]), ("steel", [0, 1], [0.03, 0.03])),
            "the tower has wall 1 of concrete, wall 2 of steel; a tube is of one material",
        ),
        (
            layered(("steel", [0, 1], [0.03, 0.03]), ("steel", [0.2, 0.5], [0.02, 0.02])),
            "thickness of wall 2 of the tower is stated from 0.2 to 0.5; its grid begins at 0 and",
        ),
        (
            layered(("steel", [0, 0.5, 1], [0.03, 0.03])),
            r"thickness of wall 1 of the tower has 2 values on the grid \[0.0, 0.5, 1.0\]; each",
        ),
        (
            layered(("steel", [0, 0.5, 0.4, 1], [0.03] * 4)),
            r"wall 1 of the tower has 4 values on the grid \[0.0, 0.5, 0.4, 1.0\]; each station",
        ),
        (layered(), "the tower has no layers; a wall has one or more"),
        (
            layered(("wood", [0, 1], [0.3, 0.3])),
            "the tower is of 'wood', which is not in materials: steel",
        ),
        (shell(90.0, 10.0, 5.0, 0.03), r"z of the tower's reference_axis is \[90.0, 10.0\] m on"),
    ],
)
def test_a_wall_that_no_tube_stands_for_is_refused(
    tmp_path: Path, tower: dict[str, Any], message: str
) -> None:
    with pytest.raises(TurbineError, match=message):
        read_windio(written(tmp_path, turbine(tower=tower)), SPRINGS)


def test_a_component_without_content_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(TurbineError, match="no turbine of WindIO 2"):
        read_windio(written(tmp_path, turbine(yaw=None)), SPRINGS)
