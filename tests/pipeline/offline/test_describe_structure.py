"""Descriptions of structures: key figures against hand calculation, the picture, the command."""

from pathlib import Path

import numpy as np
import pytest

from pipeline.offline.describe_structure import _largest_step, structure_figures
from pipeline.report.structure import draw_structure
from sensors.structure.description import load_turbine, parse_turbine

POLE = """
name = "pole"
[[tubes]]
bottom = 0.0
top = 60.0
diameter = 3.0
thickness = 0.03
youngs_modulus = 210e9
density = 7850.0
[foundation]
k11 = 1e15
k22 = 1e18
k12 = 0.0
"""


def test_a_clamped_pole_has_the_frequency_of_the_closed_form() -> None:
    """ω = (β L)² √(EI / (m L⁴)), β L = 1.8751 and 4.6941, without gravity."""
    described = parse_turbine("gravity = 0.0\n" + POLE, source="pole.toml")
    tube = described.tubes[0]
    figures = structure_figures(described)
    rigidity = tube.bending_rigidity / (tube.mass_per_length * 60.0**4)
    expected = np.array([1.8751041, 4.6940911]) ** 2 * np.sqrt(rigidity) / (2 * np.pi)
    found = sorted({round(f, 6) for f, direction, _ in figures.first if direction == "FA"})
    assert found[:2] == pytest.approx(expected, rel=2e-3)
    assert figures.tube_mass == pytest.approx(7850 * np.pi * 2.97 * 0.03 * 60)
    assert (figures.top_mass, figures.blade_mass, figures.water_depth) == (0.0, 0.0, 0.0)


def test_a_mode_that_turns_the_tower_about_its_axis_is_called_so() -> None:
    """The disc's inertia brings the first torsion below the bending modes listed."""
    body = "[[rotor_nacelle.bodies]]\nname = 'disc'\nmass = 1.0\ninertia = [1.0, 1.0, 4e6]\n"
    described = parse_turbine(POLE + "[rotor_nacelle]\n" + body, source="pole.toml")
    twisting = [
        f for f, direction, _ in structure_figures(described).first if direction == "torsion"
    ]
    assert len(twisting) == 1


def test_the_shipped_turbine_has_the_masses_of_its_sources() -> None:
    """Rotor-nacelle assembly 1017 t, NREL/TP-5000-75698 Table 5-1; blades 3 × 65.25 t."""
    figures = structure_figures(load_turbine("iea15mw_monopile"))
    assert figures.top_mass + figures.blade_mass == pytest.approx(1017e3, rel=0.01)
    assert figures.blade_mass == pytest.approx(3 * 65.25e3, rel=0.01)
    assert figures.first[0][0] == pytest.approx(0.1573, rel=1e-3)
    assert figures.as_json()["water_depth_m"] == 30.0
    assert dict(figures.rows())["inertia of the nacelle"] == "stated"


def test_the_second_bending_modes_are_listed_behind_those_of_the_blades() -> None:
    """The definition's modes 4 and 5; between them and the first pair are the blades' own."""
    figures = structure_figures(load_turbine("iea15mw_monopile"))
    bending = [f for f, _, blades in figures.first if blades < 0.5]
    assert bending[2:4] == pytest.approx([1.0898, 1.1064], rel=0.02)


def test_the_picture_is_written(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    draw_structure(structure_figures(load_turbine("iea15mw_monopile")), tmp_path / "tower.png")
    assert (tmp_path / "tower.png").stat().st_size > 20_000


def test_of_the_steps_between_widths_the_largest_counts() -> None:
    assert _largest_step([1.0, 1.1, 1.6, 1.5]) == pytest.approx(0.5)
    assert _largest_step([1.0]) == 0.0


def test_what_a_pole_does_not_have_is_described_as_nothing() -> None:
    rows = dict(structure_figures(parse_turbine(POLE, source="pole.toml")).rows())
    assert rows["rotor radius"] == "0 m"
    assert rows["inertia of the nacelle"] == "none"
    assert rows["water depth"] == "0 m"
    assert rows["mass of the blades"] == rows["mass on the top, without blades"] == "0 t"
    assert rows["largest step of the diameter"] == "0.00 m"
    assert rows["mass of the tubes"] == f"{7.85 * np.pi * 2.97 * 0.03 * 60:,.0f} t"
