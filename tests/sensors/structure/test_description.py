"""Descriptions of turbines: what ships, a user's own, and mistakes in it."""

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from sensors.structure.assembly import assemble
from sensors.structure.components import PointMass, Tube, Water, without_short
from sensors.structure.description import (
    SHIPPED,
    TurbineDescription,
    load_turbine,
    parse_turbine,
    shipped_text,
)
from sensors.structure.foundation import TurbineError
from tests.sensors.structure.towers import parked_turbine

SMALL = """
name = "mast"
tubes = [
  { bottom = 0.0, top = 20, diameter = 3.0, thickness = 0.03, material = "steel" },
  { bottom = 20, top = 40, diameter = 2.5, thickness = 0.02, material = "steel", density = 8500.0 },
]
[materials.steel]
youngs_modulus = 210e9
density = 7850
[foundation]
k11 = 1e9
k22 = 1e11
k12 = 0.0
"""


def test_the_shipped_turbine_is_the_iea_15_mw_on_its_monopile() -> None:
    turbine = parked_turbine()
    assert (turbine.mudline, turbine.tower_top, len(turbine.tubes)) == (-30.0, 145.0, 20)
    assert turbine.nominal == pytest.approx([0.098e11, 8.238e11, 0.678e11])
    assert turbine.foundation.sign == "published"
    assert [mode.name for mode in turbine.reference_modes] == [str(i) for i in range(1, 12)]


def test_the_rotor_nacelle_assembly_weighs_1017_tonnes() -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    blade = sum(part.mass_per_length * part.length for part in turbine.blades.elements)
    bodies = sum(body.mass for body in turbine.rotor_nacelle.bodies)
    total = bodies + turbine.rotor_nacelle.hub_mass + turbine.blades.number * blade
    assert blade == pytest.approx(65.23e3, rel=0.01)  # NREL/TP-5000-75698: 65.25 t
    assert total == pytest.approx(1017e3, rel=0.005)  # the same: 1017 t


def test_a_small_description_of_ones_own_is_read_from_its_file(tmp_path: Path) -> None:
    path = tmp_path / "mast.toml"
    path.write_text(SMALL)
    mast = load_turbine(path)
    assert (mast.name, mast.water, mast.blades) == ("mast", None, None)
    assert [tube.density for tube in mast.tubes] == [7850.0] * 6 + [8500.0] * 6  # its own key wins
    assert mast.tubes[0].second_moment == pytest.approx(np.pi / 64 * (3.0**4 - 2.94**4))


def test_long_tubes_are_cut_until_the_frequencies_are_those_of_many_elements(
    tmp_path: Path,
) -> None:
    path = tmp_path / "mast.toml"
    path.write_text(SMALL)
    mast = load_turbine(path)
    assert max(tube.length for tube in mast.tubes) <= (mast.tower_top - mast.mudline) / 12 + 1e-9

    assert first_ten(mast) == pytest.approx(first_ten(mast, 4), rel=2e-3)


def test_a_shipped_description_can_be_started_from() -> None:
    text = shipped_text("iea15mw_monopile").replace('"iea15mw_monopile"', '"mine"')
    assert parse_turbine(text, source="mine.toml").name == "mine"


def test_refining_keeps_the_tubes_and_cuts_them() -> None:
    turbine = parked_turbine()
    finer = turbine.refined(3)
    assert len(finer.tubes) == 60
    assert (finer.mudline, finer.tower_top) == (turbine.mudline, turbine.tower_top)
    assert sum(t.mass_per_length * t.length for t in finer.tubes) == pytest.approx(
        sum(t.mass_per_length * t.length for t in turbine.tubes)
    )
    assert finer.blades == turbine.blades


def test_the_water_level_and_the_sign_can_be_changed_without_the_rest() -> None:
    turbine = parked_turbine()
    assert turbine.with_water_level(1.5).water == Water(level=1.5, density=1025.0)
    assert turbine.with_sign("embedded-pile").foundation.sign == "embedded-pile"
    assert turbine.with_sign("embedded-pile").tubes == turbine.tubes


MISTAKES = [
    ("thickness = 0.03", "thickness = -0.03", r"tubes\[0\].*thickness is -0.03; it must be pos"),
    ("thickness = 0.03", "thickness = 2.0", r"a tube of 3 m has at most 1.5 m"),
    ("diameter = 3.0", "diameter = 0", r"diameter is 0; it must be positive"),
    ("top = 20", "top = 22", r"an overlap between the element that ends at 22 m and .* 20 m"),
    ("top = 20", "top = 19", r"a gap between the element that ends at 19 m"),
    ("top = 40", "top = 10", r"tube from 20 to 10 m: top must lie above bottom"),
    ("diameter = 3.0", "diametre = 3.0", r"unknown key 'diametre'; did you mean 'diameter'\?"),
    ("k22 = 1e11", "", r"mast.toml \[foundation\]: the key 'k22' is missing"),
    ("k22 = 1e11", "k22 = 'stiff'", r"\[foundation\]: k22 is 'stiff'; a number is needed"),
    ("k22 = 1e11", "k22 = true", r"k22 is True; a number is needed"),
    ("k22 = 1e11", "k22 = nan", r"k22 is nan; a finite number is needed"),
    ("k22 = 1e11", "k22 = -1e11", r"\[foundation\]: .*not positive definite"),
    ("k12 = 0.0", "k12 = 2e10", r"k12 < sqrt\(k11·k22\) = 1e\+10 N/rad"),
    ("k12 = 0.0", "k12 = 0.0\nsign = 'pile'", r"sign is 'pile'; it can be 'published' or 'emb"),
    (
        'material = "steel" }',
        "youngs_modulus = 210.0, density = 7850.0 }",
        r"\[tubes\[0\]\]: youngs_modulus is 210; steel has 210e9 Pa",
    ),
    (
        'material = "steel" }',
        "youngs_modulus = 210e6, density = 7850.0 }",
        r"youngs_modulus is 2.1e\+08; steel has 210e9 Pa",
    ),
    ("density = 8500.0", "density = 8.5", r"\[tubes\[1\]\]: density is 8.5; steel has 7850 kg"),
    ("diameter = 3.0", "diameter = 3000", r"\[tubes\[0\]\]: diameter is 3000 m; no tower is wider"),
    ('material = "steel" }', 'material = "iron" }', r"material 'iron' is not in \[materials\]"),
    (
        "k12 = 0.0",
        "k12 = 0.0\nmoving_mass = 8.79",
        r"\[foundation\]: moving_mass is 8.79 kg/m; the lowest tube alone has 2197 kg/m",
    ),
    ("k12 = 0.0", "k12 = 0.0\n[water]\ndensity = 1.025", r"\[water\]: density is 1.025 kg/m³; sea"),
    ("k12 = 0.0", "k12 = 0.0\n[water]\ngrowth_density = 1.3", r"growth_density is 1.3 kg/m³; sea"),
    ('name = "mast"', 'name = "mast', r"mast.toml: not valid TOML"),
    ('name = "mast"', 'name = "mast"\ngravitation = 9.81', r"mast.toml: unknown key 'gravitation'"),
    ('name = "mast"', "", r"mast.toml: the key 'name' is missing"),
    ('name = "mast"', 'name = "mast"\nwater = 3', r"water is 3; a table of keys is needed"),
    ('name = "mast"', 'name = "mast"\nreference_modes = 1', r"reference_modes is 1; a list"),
]


@pytest.mark.parametrize(("right", "wrong", "message"), MISTAKES)
def test_a_mistake_is_named_in_one_line(right: str, wrong: str, message: str) -> None:
    assert right in SMALL
    with pytest.raises(TurbineError, match=message) as caught:
        parse_turbine(SMALL.replace(right, wrong, 1), source="mast.toml")
    assert "mast.toml" in str(caught.value)
    assert "\n" not in str(caught.value)


ROTOR_MISTAKES = [
    ("number = 3", "number = 0", r"\[blades\].*number is 0; at least 1"),
    ("inner = 19.5", "inner = 20.5", r"a gap between the element that ends at 19.5 m"),
    ("modes_per_element = 1", "modes_per_element = 4", r"modes_per_element is 4; 0 to 3"),
    ("mass = 530887.918", "mass = -1.0", r"\[rotor_nacelle.bodies\[0\]\].*mass is -1"),
    ("centre = [-4.688, 0.0, 4.240]", "centre = [1.0, 2.0]", r"centre has 2 values; 3 are needed"),
    (
        "centre = [-4.688, 0.0, 4.240]",
        "centre = [-4.688, 0.0, 4.240]\ninertia_point = [0.0, 0.0, 0.0]",
        r"a principal moment of -1.\d*e\+07 kg·m²",
    ),
    (
        "centre = [-4.688, 0.0, 4.240]",
        "centre = [-4.688, 0.0, 149.24]",
        r"\[rotor_nacelle\]: the centre of 'nacelle' is at 149.24 m; heights here count from",
    ),
    (
        "tower_to_shaft = 4.3478",
        "tower_to_shaft = 150",
        r"tower_to_shaft is at 150 m; heights",
    ),
    ('name = "2", direction = "FA"', 'name = "1", direction = "FA"', r"'1' is listed more than"),
    ('direction = "SS"', 'direction = "SW"', r"direction is 'SW'; it can be 'FA' or 'SS'"),
]


@pytest.mark.parametrize(("right", "wrong", "message"), ROTOR_MISTAKES)
def test_a_mistake_in_the_rotor_is_named_too(right: str, wrong: str, message: str) -> None:
    text = shipped_text("iea15mw_monopile")
    assert right in text
    with pytest.raises(TurbineError, match=message):
        parse_turbine(text.replace(right, wrong, 1), source="mine.toml")


def test_a_mistake_in_a_users_file_begins_with_its_path(tmp_path: Path) -> None:
    path = tmp_path / "mast.txt"
    path.write_text("water = 3\n")
    with pytest.raises(TurbineError) as caught:
        load_turbine(path)
    assert str(caught.value).startswith(f"{path}: ")


def test_a_turbine_that_does_not_exist_is_one_line() -> None:
    with pytest.raises(TurbineError, match="nrel5mw: no such file; a turbine is one of iea15mw"):
        load_turbine("nrel5mw")


def test_a_file_that_is_no_text_is_one_line(tmp_path: Path) -> None:
    path = tmp_path / "picture.toml"
    path.write_bytes(b"\xff\xd8\xff\xe0")
    with pytest.raises(TurbineError, match="cannot be read as text"):
        load_turbine(path)


def test_a_turbine_without_tubes_is_refused() -> None:
    foundation = parked_turbine().foundation
    with pytest.raises(TurbineError, match="tubes: at least one element is needed"):
        TurbineDescription(name="none", tubes=(), foundation=foundation)


TURBINE = parked_turbine()
TUBE, WATER, SPRINGS = TURBINE.tubes[0], TURBINE.water, TURBINE.foundation
NACELLE, BODY = TURBINE.rotor_nacelle, TURBINE.rotor_nacelle.bodies[0]
MASS = PointMass("platform", 15.0, 1e4)
COUPLED = (SPRINGS.k11 * SPRINGS.k22) ** 0.5  # k12 of springs that carry no load [N/rad]


@pytest.mark.parametrize(
    ("component", "figure", "taken", "refused"),
    [
        (TUBE, "bottom", TUBE.top - 1e-3, TUBE.top),
        (TUBE, "thickness", TUBE.diameter / 2, TUBE.diameter / 2 + 1e-6),
        (TUBE, "thickness", 1e-6, 0.0),
        (TUBE, "youngs_modulus", 1.0, 0.0),
        (TUBE, "density", 1e-3, 0.0),
        (TUBE, "poisson_ratio", 0.499, 0.5),
        (TUBE, "poisson_ratio", -0.999, -1.0),
        (TUBE, "attached_mass", 0.0, -1e-3),
        (SPRINGS, "k12", 0.999999 * COUPLED, 1.000001 * COUPLED),
        (SPRINGS, "k12", 0.0, -1.0),
        (SPRINGS, "embedded_length", 0.0, -1e-3),
        (WATER, "density", 0.0, -1e-3),
        (WATER, "added_mass_coefficient", 0.0, -1e-3),
        (WATER, "growth", 0.0, -1e-3),
        (WATER, "growth_density", 0.0, -1e-3),
        (NACELLE, "hub_mass", 0.0, -1e-3),
        (NACELLE, "hub_inertia", 0.0, -1e-3),
        (BODY, "mass", 0.0, -1e-3),
        (MASS, "mass", 0.0, -1e-3),
        (TURBINE.blades, "number", 1, 0),
        (TURBINE.blades, "modes_per_element", 3, 4),
        (TURBINE.blades, "modes_per_element", 0, -1),
        (TURBINE, "gravity", 0.0, -1e-3),
        (TURBINE, "transition", TURBINE.tower_top, TURBINE.tower_top + 1e-3),
        (TURBINE, "transition", TURBINE.mudline, TURBINE.mudline - 1e-3),
    ],
)
def test_a_figure_of_a_component_is_taken_at_its_limit_and_refused_beyond(
    component: Any, figure: str, taken: float, refused: float
) -> None:
    replace(component, **{figure: taken})
    with pytest.raises(TurbineError):
        replace(component, **{figure: refused})


def short_pieces(length: float, section: float = 1.0) -> str:
    """The small mast's TOML with a piece at 20 m whose wall is `section` times as thick."""
    middle = (
        f"  {{ bottom = 20, top = {20 + length}, diameter = 3.0, thickness = {0.03 * section}, "
        'material = "steel" },\n'
    )
    return SMALL.replace("  { bottom = 20,", f"{middle}  {{ bottom = {20 + length},")


@pytest.mark.parametrize("length", [2e-6, 1e-4, 1e-3, 0.01, 0.019])
def test_a_step_that_is_written_as_a_very_short_tube_costs_no_digits(length: float) -> None:
    plain = parse_turbine(SMALL, source="mast.toml")
    stepped = parse_turbine(short_pieces(length), source="mast.toml")
    assert len(stepped.tubes) == len(plain.tubes)
    assert (stepped.mudline, stepped.tower_top) == (0.0, 40.0)
    for refinement in (1, 2):  # a model of departures halves every tube
        found, expected = (first_ten(mast, refinement) for mast in (stepped, plain))
        assert found == pytest.approx(expected, rel=3 * length / 40 + 1e-9)


def test_a_short_heavy_ring_keeps_its_mass() -> None:
    ring = parse_turbine(short_pieces(0.018, section=20.0), source="mast.toml")
    plain = parse_turbine(SMALL, source="mast.toml")
    masses = [sum(t.mass_per_length * t.length for t in mast.tubes) for mast in (ring, plain)]
    A = [np.pi * (3.0 - t) * t for t in (0.6, 0.03)]
    A_above = np.pi * (2.5 - 0.02) * 0.02
    assert masses[0] - masses[1] == pytest.approx(0.018 * (7850 * A[0] - 8500 * A_above), rel=1e-9)


def test_a_taper_of_many_short_tubes_stays_one() -> None:
    edges = np.linspace(0.0, 40.0, 3001)
    walls = np.interp(edges[:-1], [0.0, 40.0], [0.04, 0.02])
    tubes = tuple(
        Tube(b, t, 3.0, w, youngs_modulus=210e9, density=7850.0)
        for b, t, w in zip(edges[:-1].tolist(), edges[1:].tolist(), walls.tolist(), strict=True)
    )
    joined = without_short(tubes, 40.0 / 2000)
    assert all(40.0 / 2000 <= tube.length < 0.041 for tube in joined)
    at = [tube.bottom for tube in joined]
    expected = np.interp(at, edges[:-1], walls).tolist()
    assert [tube.thickness for tube in joined] == pytest.approx(expected, abs=2e-5)


def test_short_stretches_of_a_blade_go_to_their_neighbours() -> None:
    turbine = parked_turbine()
    assert turbine.blades is not None
    whole = turbine.blades.elements
    split = [
        part
        for each in whole[1:]
        for part in (
            replace(each, outer=each.inner + 1e-3, mass_per_length=1.5 * each.mass_per_length),
            replace(each, inner=each.inner + 1e-3),
        )
    ]
    meshed = replace(turbine, blades=replace(turbine.blades, elements=(whole[0], *split))).meshed()
    assert meshed.blades is not None
    assert len(meshed.blades.elements) == len(whole)
    masses = [sum(e.mass_per_length * e.length for e in blade) for blade in (split, whole[1:])]
    kept = sum(e.mass_per_length * e.length for e in meshed.blades.elements)
    assert kept - sum(e.mass_per_length * e.length for e in whole) == pytest.approx(
        masses[0] - masses[1]
    )


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_descriptions_have_no_element_too_short_or_too_long(name: str) -> None:
    turbine = load_turbine(name)
    assert turbine.meshed() == turbine


def first_ten(mast: TurbineDescription, refinement: int = 1) -> np.ndarray:
    """The first ten circular frequencies [rad/s]."""
    model = assemble(mast, tube_refinement=refinement)
    squares = eigh(model.stiffness, model.mass, eigvals_only=True, subset_by_index=[0, 9])
    return np.sqrt(squares)


def test_masses_of_the_top_in_tonnes_are_named_beside_those_of_the_blades() -> None:
    text = shipped_text("iea15mw_monopile")
    for stated, tonnes in (("530887.918", "530.9"), ("190000.0", "190.0"), ("100000.0", "100.0")):
        assert stated in text
        text = text.replace(stated, tonnes)
    with pytest.raises(
        TurbineError, match=r"hub and bodies have 820.9 kg, the blades 195822 kg in all"
    ):
        parse_turbine(text, source="mine.toml")


def test_blades_in_tonnes_per_metre_are_named_beside_what_carries_them() -> None:
    tonnes = re.sub(
        r"mass_per_length = ([\d.]+)",
        lambda found: f"mass_per_length = {float(found[1]) / 1e3:g}",
        shipped_text("iea15mw_monopile"),
    )
    with pytest.raises(
        TurbineError, match=r"hub and bodies have 820888 kg, the blades 195.822 kg in all"
    ):
        parse_turbine(tonnes, source="mine.toml")


def test_a_foundation_that_moves_nothing_is_no_slip_of_the_unit() -> None:
    text = SMALL.replace("k12 = 0.0", "k12 = 0.0\nmoving_mass = 0.0", 1)
    assert parse_turbine(text, source="mast.toml").foundation.moving_mass == 0.0
