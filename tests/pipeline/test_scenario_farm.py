"""A farm's turbines: foundations, seeds and names of their own, the same in every run."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scenario import ScenarioError, farm_members, load_scenario, scenario_from_text
from pipeline.sources.sources import simulated, simulated_tower
from sensors.acquisition.blocks import AccelerationBlock
from sensors.structure.foundation import positive_definite


def test_every_turbine_has_a_foundation_seed_and_name_of_its_own() -> None:
    members = farm_members(load_scenario("farm"))
    assert len(members) == 4
    for own in ("seed", "turbine", "sensors"):
        assert len({getattr(member, own) for member in members}) == 4
    assert len({member.simulation.stiffness_ratios for member in members}) == 4


def test_the_farms_foundations_lie_within_its_spread_and_stand() -> None:
    scenario = load_scenario("farm")
    for seed in range(1, 40):
        for member in farm_members(replace(scenario, seed=seed)):
            ratios = np.array(member.simulation.stiffness_ratios)
            assert np.abs(ratios - 1.0).max() <= scenario.farm.spread
            assert positive_definite(ratios * scenario.structure.nominal)


def test_a_farm_is_the_same_in_every_run_and_another_under_another_seed() -> None:
    scenario = load_scenario("farm")
    assert farm_members(scenario) == farm_members(scenario)
    assert farm_members(scenario) != farm_members(replace(scenario, seed=2))


def test_a_farm_of_one_is_the_scenario_itself() -> None:
    parked = load_scenario("parked")
    assert farm_members(parked) == (parked,)


def test_a_farms_blocks_come_in_order_of_time_and_are_those_of_its_turbines() -> None:
    scenario = load_scenario("farm")
    short = replace(scenario.simulation, duration=3.0, transient=2.0, noise_share=0.0)
    scenario = replace(scenario, simulation=short, farm=replace(scenario.farm, turbines=2))
    blocks = [m for m in simulated(scenario).messages() if isinstance(m, AccelerationBlock)]
    assert [b.start_ns for b in blocks] == sorted(b.start_ns for b in blocks)
    for member in farm_members(scenario):
        own = [b.samples for b in blocks if b.turbine == member.turbine.id]
        alone = [b.samples for b in simulated_tower(member)]
        np.testing.assert_array_equal(np.concatenate(own), np.concatenate(alone))


OWN = """
[farm]
turbines = 3
log_std = 0.02

[[farm.members]]
number = 2
id = "south"
elevations = [80.0, 145.0]
stiffness = [1.0, 0.85, 1.0]
springs_sign = "embedded-pile"
"""


def test_a_member_has_a_name_sensors_sign_and_stiffness_of_its_own() -> None:
    first, second, third = farm_members(scenario_from_text(OWN, "own.toml"))
    assert [m.turbine.id for m in (first, second, third)] == ["iea15mw-1", "south", "iea15mw-3"]
    assert len(second.layout.channels) == 4
    assert len(first.layout.channels) == len(third.layout.channels) == 8
    signs = [each.structure.foundation.sign for each in (first, second, third)]
    assert signs == ["published", "embedded-pile", "published"]
    stiff = farm_members(scenario_from_text(OWN.replace("0.85", "1.0"), "own.toml"))[1]
    ratios = [np.array(each.simulation.stiffness_ratios) for each in (second, stiff)]
    np.testing.assert_allclose(ratios[0] / ratios[1], [1.0, 0.85, 1.0])


def test_logarithms_of_the_springs_spread_by_the_stated_deviation() -> None:
    text = "[farm]\nturbines = 120\nlog_std = 0.02\n"
    members = farm_members(scenario_from_text(text, "wide.toml"))
    logs = np.log([member.simulation.stiffness_ratios for member in members])
    np.testing.assert_allclose(logs.std(axis=0), 0.02, rtol=0.2)
    assert np.abs(np.corrcoef(logs.T) - np.eye(3)).max() < 0.3


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[[farm.members]]\nnumber = 0", "members have the numbers"),
        ("[[farm.members]]\n[[farm.members]]\nnumber = 1", "each once"),
        ("[[farm.members]]\nstiffness = [1.0, 0.0, 1.0]", "factors are positive"),
        ("[farm]\nlog_std = 0.7", "log_std is 0.7"),
    ],
)
def test_a_farm_that_cannot_be_is_refused(text: str, message: str) -> None:
    with pytest.raises(ScenarioError, match=message):
        scenario_from_text(text, "farm.toml")


def test_two_turbines_of_one_name_and_a_foundation_that_cannot_stand_are_refused() -> None:
    twins = '[[farm.members]]\nid = "a"\n[[farm.members]]\nid = "a"\n'
    with pytest.raises(ScenarioError, match="2 turbines called 'a'"):
        farm_members(scenario_from_text(twins, "twins.toml"))
    soft = "[farm]\nturbines = 2\n[[farm.members]]\nstiffness = [0.1, 0.1, 1.0]\n"
    with pytest.raises(ScenarioError, match="positive definite"):
        farm_members(scenario_from_text(soft, "soft.toml"))


def test_a_member_may_have_another_structure() -> None:
    text = "[farm]\nturbines = 2\n[[farm.members]]\nnumber = 2\ndescription = 'iea15mw_detailed'\n"
    first, second = farm_members(scenario_from_text(text, "farm.toml"))
    assert first.turbine.description == "iea15mw_monopile"
    assert second.structure.name != first.structure.name
