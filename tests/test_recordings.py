"""The recordings that come with the project are what their scenario makes."""

from itertools import islice
from pathlib import Path

import numpy as np

from pipeline.scenario import load_scenario
from pipeline.sources.sources import replayed, simulated_tower
from sensors.acquisition.blocks import AccelerationBlock

PARKED = Path(__file__).parents[1] / "recordings" / "parked.mcap"


def test_parked_is_made_again_to_one_step_of_its_converter() -> None:
    scenario = load_scenario("parked")
    recorded = (each for each in replayed(PARKED).messages() if isinstance(each, AccelerationBlock))
    for ours, theirs in islice(zip(recorded, simulated_tower(scenario), strict=False), 60):
        assert ours.start_ns == theirs.start_ns
        step = scenario.simulation.quantisation_step
        np.testing.assert_allclose(ours.samples, theirs.samples, rtol=0, atol=1.001 * step)


def test_parked_is_small_enough_for_git_and_names_its_seed() -> None:
    assert PARKED.stat().st_size < 4.5e6
    source = replayed(PARKED)
    assert (source.scenario.name, source.scenario.seed) == ("parked", 1)
    assert source.duration == 3600.0
