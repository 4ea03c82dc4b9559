"""What every test shares: one thread, repeatable examples, a short recording simulated once."""

import atexit
import fcntl
import gc
import os
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from threadpoolctl import threadpool_limits

from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.scenario import Scenario, scenario_from_text
from pipeline.sources.sources import record_simulation, replayed, simulated

# As every way of running the graph does: small matrices are faster on one thread.
threadpool_limits(limits=1)

pytest_plugins = ["tests.tiers", "tests.identified_once"]

# Spools of publishers that tests start, in this process or another, are the tests' own.
os.environ["XDG_STATE_HOME"] = tempfile.mkdtemp(prefix="pilewatch-state-")
atexit.register(shutil.rmtree, os.environ["XDG_STATE_HOME"], ignore_errors=True)

# A hundred processes that tests start share what the first of them compiles, and the next run of
# the suite finds its assertions rewritten: that takes as long as all imports.
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
sys.dont_write_bytecode = False


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without collecting garbage; what stands then is never looked through again.

    Modules and tests are a million objects that stay to the end. Each full collection of garbage
    passes all of them: a fifth of the suite's time.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.freeze()
        gc.enable()


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


def made_once(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """A folder that is filled once, whichever of a run's processes needs it first."""
    base = factory.getbasetemp()
    base = base.parent if "PYTEST_XDIST_WORKER" in os.environ else base  # what they share
    folder = base / name
    with (base / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not folder.exists():
            part = factory.mktemp(f"{name}-part")
            make(part)
            part.rename(folder)
    return folder


@pytest.fixture(scope="session")
def short_recording(tmp_path_factory: pytest.TempPathFactory, short_scenario: Scenario) -> Path:
    """The same, recorded."""

    def make(folder: Path) -> None:
        record_simulation(simulated(short_scenario), folder / "short.mcap")

    return made_once(tmp_path_factory, "recording", make) / "short.mcap"


@pytest.fixture(scope="session")
def short_session(
    tmp_path_factory: pytest.TempPathFactory, short_recording: Path, identified_answers: Path
) -> Path:
    """The session of that recording: modes, posteriors and events beside the samples."""
    from tests.identified_once import remembering  # a plugin: pytest rewrites what it imports

    def make(folder: Path) -> None:
        options = SessionOptions(folder, way="lock-step", rrd=False)
        with remembering(identified_answers):
            run_session(replayed(short_recording), options)

    return made_once(tmp_path_factory, "session", make) / "session.mcap"
