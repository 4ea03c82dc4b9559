"""What the pipeline survives, in short: the long forms are `python -m tests.benchmarks trials`."""

from pathlib import Path

import pytest

from tests.benchmarks._disk_trial import disk_trial
from tests.benchmarks._farm_trial import farm_trial
from tests.benchmarks._fuzz_trial import fuzz_trial
from tests.benchmarks._kill_trial import kill_trial
from tests.benchmarks._link_trials import cut_trial, frozen_trial, router_trial
from tests.benchmarks._security_trial import security_trial
from tests.benchmarks.transport import Load
from tests.benchmarks.trials import day_trial, recorded

# The undisturbed sessions beside the trials' own processes are of one recording.
pytestmark = pytest.mark.usefixtures("identified_once")


def test_a_cable_cut_for_seconds_costs_no_block() -> None:
    outcome = cut_trial(duration=2.0, rate=100.0, how="silent")
    assert outcome.received == outcome.published == 400
    assert (outcome.lost, outcome.repeated, outcome.disordered) == (0, 0, 0)
    assert outcome.recovered > 100  # of 200 that were published while it was cut


def test_what_was_published_beyond_the_cache_while_the_cable_was_cut_is_lost_and_counted() -> None:
    outcome = cut_trial(duration=2.0, rate=1000.0, how="reset")
    assert 0 < outcome.lost == outcome.published - outcome.received
    assert (outcome.repeated, outcome.disordered) == (0, 0)


def test_a_frozen_reader_holds_nobody_up_and_misses_nothing() -> None:
    outcome = frozen_trial(duration=3.0, rate=100.0)
    assert outcome.received == outcome.published == 500
    assert outcome.lost == 0
    assert outcome.put_longest_ms < 3000.0  # no put waited until the reader went on


def test_a_router_that_is_killed_and_comes_back_costs_no_block() -> None:
    outcome = router_trial(away=1.0, rate=100.0)
    assert outcome.received == outcome.published == 500
    assert (outcome.lost, outcome.repeated) == (0, 0)


@pytest.fixture(scope="module")
def recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A little more than one window."""
    return recorded(tmp_path_factory.mktemp("source"), duration=66.0)


@pytest.mark.nightly
def test_a_full_disk_ends_the_recording_and_nothing_else(tmp_path: Path, recording: Path) -> None:
    outcome = disk_trial(tmp_path, recording, kilobytes=30)
    assert outcome.exit_code == 0
    assert outcome.warned
    assert 0 < outcome.recorded < outcome.published == 66
    assert outcome.told_lost == outcome.published - outcome.recorded
    assert outcome.same_posterior


@pytest.mark.nightly
def test_a_flood_of_nonsense_ends_no_node_and_is_counted(tmp_path: Path) -> None:
    outcome = fuzz_trial(tmp_path, examples=40, rate=400.0, seed=3, rounds=1)
    assert outcome.alive
    assert outcome.malformed > 0.3 * outcome.sent
    assert 1 <= outcome.told_malformed <= 5  # once a node, in the end
    assert outcome.recorded_after == 30
    assert outcome.exit_code == 0


def test_only_whom_the_station_knows_gets_in_and_each_says_only_what_it_may(tmp_path: Path) -> None:
    outcome = security_trial(tmp_path)
    assert len(outcome.refused) == 3
    assert all(outcome.refused.values())
    assert outcome.own_blocks == outcome.viewer_heard == 20
    assert (outcome.foreign_blocks, outcome.viewer_said, outcome.forged_statuses) == (0, 0, 0)
    assert (outcome.node_statuses, outcome.node_blocks) == (1, 0)
    assert {"t1.tower", "viewer", "compute"} <= set(outcome.told_connections)
    assert outcome.exit_code == 0


def test_a_session_whose_nodes_are_killed_ends_with_the_same_posterior_and_nothing_missing(
    tmp_path: Path, recording: Path
) -> None:
    outcome = kill_trial(
        tmp_path,
        recording,
        speed=20.0,
        kills=("recorder", "updating"),
        seed=3,
        rrd=False,
    )
    assert len(outcome.kills) == 2
    assert (outcome.published, outcome.missing, outcome.repeated) == (66, 0, 0)
    assert outcome.told_recorded == 66
    assert (outcome.windows, outcome.differing) == (1, 0)
    assert outcome.exit_code == 0


@pytest.mark.nightly
def test_a_farm_in_real_time_is_recorded_whole(tmp_path: Path) -> None:
    outcome = farm_trial(tmp_path, Load(turbines=200, channels=8, rate=40.0, seconds=3))
    assert outcome.recorded == outcome.published == 600
    assert outcome.lost == 0
    assert outcome.exit_code == 0


def test_hours_of_blocks_in_parts_come_back_whole_and_memory_stays_flat(tmp_path: Path) -> None:
    outcome = day_trial(tmp_path, hours=1.0, part=900.0)
    assert outcome.blocks == 3600
    assert outcome.lost == 0
    assert outcome.memory_growth < 0.05
