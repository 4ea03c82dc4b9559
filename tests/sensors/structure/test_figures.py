"""A figure changes what its title says, and nothing else."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.structure.components import PointMass, RigidBody
from sensors.structure.description import TurbineDescription
from sensors.structure.figures import FIGURES, JUDGEMENT, figures_of, varied
from tests.sensors.structure.towers import parked_turbine


def masses(turbine: TurbineDescription) -> dict[str, float]:
    """Of the parts [kg]."""
    nacelle, blades = turbine.rotor_nacelle, turbine.blades
    assert blades is not None
    return {
        "bodies": sum(body.mass for body in nacelle.bodies),
        "hub": nacelle.hub_mass,
        "blades": sum(e.mass_per_length * (e.outer - e.inner) for e in blades.elements),
        "tubes": sum(tube.mass_per_length * tube.length for tube in turbine.tubes),
    }


def changed_by(figure: str, departure: float) -> dict[str, float]:
    """Relative change of every part's mass, parts that keep theirs left out."""
    before, after = masses(parked_turbine()), masses(varied(parked_turbine(), {figure: departure}))
    changes = {name: round(after[name] / before[name] - 1, 9) for name in before}
    return {name: change for name, change in changes.items() if change}


def test_the_rotor_nacelle_mass_is_that_of_nacelle_yaw_bearing_and_hub() -> None:
    assert changed_by("rna_mass", 0.02) == {"bodies": 0.02, "hub": 0.02}


def test_masses_of_blades_and_of_steel_are_figures_of_their_own() -> None:
    assert changed_by("blade_mass", -0.03) == {"blades": -0.03}
    assert changed_by("steel_density", 0.01) == {"tubes": 0.01}


def test_a_prior_whose_width_no_source_states_says_so() -> None:
    for figure in FIGURES:
        assert JUDGEMENT in figure.source or figure.source.startswith("as the"), figure.name


def test_a_moment_of_inertia_about_another_point_changes_about_the_centre() -> None:
    turbine = parked_turbine()
    body = RigidBody("nacelle", 5e5, (-4.0, 0.0, 4.0), (4e7,) * 3, inertia_point=(0.0, 0.0, 0.0))
    stated = replace(turbine, rotor_nacelle=replace(turbine.rotor_nacelle, bodies=(body,)))
    (after,) = varied(stated, {"nacelle_yaw_inertia": 0.5}).rotor_nacelle.bodies
    yaw = 4e7 - 5e5 * 4.0**2
    assert np.diag(after.tensor) == pytest.approx([4e7 - 5e5 * 16, 4e7 - 5e5 * 32, 1.5 * yaw])
    (after,) = varied(stated, {"rna_mass": 0.5}).rotor_nacelle.bodies
    np.testing.assert_allclose(after.tensor, body.tensor)


def test_described_masses_on_the_tower_may_be_more_or_less_than_described() -> None:
    """The figure `transition_piece` is further mass, of which there cannot be less than none."""
    piece, damper = PointMass("transition piece", 15.0, 250e3), PointMass("damper", 130.0, 10e3)
    tubes = tuple(replace(tube, attached_mass=100.0) for tube in parked_turbine().tubes)
    turbine = replace(parked_turbine(), point_masses=(piece, damper), tubes=tubes)
    lighter = varied(turbine, {"point_masses": -0.1, "transition_piece": 5e3})
    assert [each.mass for each in lighter.point_masses] == pytest.approx([225e3, 9e3, 5e3])
    assert {each.attached_mass for each in lighter.tubes} == {90.0}
    assert "point_masses" in {
        figure.name for figure in figures_of(replace(turbine, point_masses=()))
    }
    assert "point_masses" in {figure.name for figure in figures_of(turbine)}
    assert "point_masses" not in {figure.name for figure in figures_of(parked_turbine())}
