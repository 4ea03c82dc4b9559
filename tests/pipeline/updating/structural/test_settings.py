"""[structure] of a scenario: uncertain by default, exact where it is written."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scenario import (
    ScenarioError,
    load_scenario,
    scenario_from_metadata,
    scenario_from_text,
    scenario_metadata,
    with_structure,
)
from pipeline.updating.structural.settings import StructureSettings
from sensors.structure.description import load_turbine

TURBINE = load_turbine("iea15mw_monopile")


def test_a_scenario_that_does_not_mention_its_structure_takes_every_figure_as_uncertain() -> None:
    prior = scenario_from_text("", "mine.toml").updating.structure.prior(TURBINE)
    assert {"steel_modulus", "transition_piece", "added_mass"} <= set(prior.names)


def test_exact_is_written() -> None:
    scenario = scenario_from_text('[structure]\nuncertain = "exact"\n', "mine.toml")
    assert scenario.updating.structure.exact
    assert load_scenario("parked").updating.structure.exact
    assert load_scenario("paper").updating.structure.exact
    assert not load_scenario("tide").updating.structure.exact


def test_each_figure_has_its_own_standard_deviation_or_is_exact() -> None:
    text = '[structure.uncertain]\nsteel_modulus = 0.03\nadded_mass = "exact"\nwater_level = 0.3\n'
    prior = scenario_from_text(text, "mine.toml").updating.structure.prior(TURBINE)
    assert {f.name: f.std for f in prior.figures}["steel_modulus"] == 0.03
    assert "added_mass" not in prior.names
    assert prior.known_level_std == 0.3


def test_a_level_that_nothing_reports_has_a_tide_and_a_zero_of_its_own() -> None:
    """A zero of another datum is the same in every window, so that only the tide moves modes."""
    by_default = scenario_from_text("", "mine.toml").updating.structure.prior(TURBINE)
    assert by_default.unknown_level_std == pytest.approx(
        np.hypot(by_default.tide_std, 1.0), rel=0.02
    )
    text = "[structure.uncertain]\nunknown_water_level = 2.0\n"
    stated = scenario_from_text(text, "mine.toml").updating.structure.prior(TURBINE)
    assert stated.unknown_level_std == stated.tide_std == 2.0


def test_a_turbine_on_land_has_no_uncertain_level() -> None:
    structure = scenario_from_text("", "mine.toml").updating.structure
    prior = structure.prior(replace(TURBINE, water=None))
    assert prior.known_level_std == prior.unknown_level_std == prior.tide_std == 0.0


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "[structure.uncertain]\nsteel_moduls = 1\n",
            r"^mine.toml \[structure.uncertain\]: unknown key 'steel_moduls'; "
            r"did you mean 'steel_modulus'\?$",
        ),
        (
            "[structure.uncertain]\nxyz = 1\n",
            r"\[structure.uncertain\]: unknown key 'xyz'; it takes steel_modulus, ",
        ),
        (
            "[structure.uncertain]\nadded_mass = -1\n",
            r"^mine.toml \[structure.uncertain\]: added_mass is -1",
        ),
        ("[structure.uncertain]\nadded_mass = 0.9\n", "at most 0.5"),
        ("[structure.uncertain]\nflooding = 0.2\n", 'can only be "exact"'),
        ("[structure.uncertain]\nscour_depth = 1.5\n", "no soil, no depth"),
        ('[structure]\nuncertain = "no"\n', 'is "exact" or a table'),
        ("[structure]\nsprings = 1\n", r"mine.toml \[structure\]: .* takes one key, uncertain"),
        ("[updating.uncertain]\nrna_mass = 0.03\n", r"\[structure.uncertain\]"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message) as refused:
        scenario_from_text(text, "mine.toml")
    assert "\n" not in str(refused.value)


def test_a_recording_from_before_the_choice_keeps_its_exact_structure() -> None:
    stored = scenario_metadata(load_scenario("tide"))
    assert not scenario_from_metadata(stored, "new.mcap").updating.structure.exact
    del stored["structure"]
    old = scenario_from_metadata(stored, "old.mcap").updating.structure
    assert old.exact
    assert not old.stated


@pytest.mark.parametrize("stated", [True, False])
def test_a_session_of_an_exact_structure_is_replayed_with_it(stated: bool) -> None:
    settings = StructureSettings(exact=True, stated=stated)
    session = with_structure(scenario_from_text("", "mine.toml"), settings)  # no [structure] in it
    stored = scenario_metadata(session)
    assert scenario_from_metadata(stored, "session.mcap").updating.structure == settings
