"""What every test shares: one thread, repeatable examples, a short recording simulated once."""

import os
import tempfile
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.scenario import Scenario, scenario_from_text
from pipeline.sources.sources import record_simulation, replayed, simulated

# As every way of running the graph does: small matrices are faster on one thread.
threadpool_limits(limits=1)

pytest_plugins = ["tests.tiers"]

# Spools of publishers that tests start, in this process or another, are the tests' own.
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="pilewatch-state-")

SHORT_SCENARIO = """
title = "Two short windows of the parked turbine"
seed = 3

[simulation]
duration = 240.0
transient = 120.0

[oma]
window_duration = 120.0
hop = 120.0
highest_frequency = 9.5

[updating.pairing]
search_draws = 100
refined = 2

[structure.uncertain]
flooding = "exact"
"""


@pytest.fixture(scope="session")
def short_scenario() -> Scenario:
    """Four minutes of the parked turbine in two windows, with a short search for pairs.

    Thirty modes and two alternatives of the structure take every step that forty and four take.
    """
    return scenario_from_text(SHORT_SCENARIO, "short.toml")


@pytest.fixture(scope="session")
def short_recording(tmp_path_factory: pytest.TempPathFactory, short_scenario: Scenario) -> Path:
    """The same, recorded."""
    path = tmp_path_factory.mktemp("recording") / "short.mcap"
    record_simulation(simulated(short_scenario), path)
    return path


@pytest.fixture(scope="session")
def short_session(tmp_path_factory: pytest.TempPathFactory, short_recording: Path) -> Path:
    """The session of that recording: modes, posteriors and events beside the samples."""
    folder = tmp_path_factory.mktemp("session")
    run_session(replayed(short_recording), SessionOptions(folder, way="lock-step", rrd=False))
    return folder / "session.mcap"
