"""A farm's turbines: foundations, seeds and names of their own, the same in every run."""

from dataclasses import replace

import numpy as np

from pipeline.scenario import farm_members, load_scenario
from pipeline.sources import simulated, simulated_tower
from sensors.blocks import AccelerationBlock
from sensors.turbine.foundation import positive_definite


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
