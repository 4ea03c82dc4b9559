"""What the pipeline survives, in short: the long forms are `python -m tests.benchmarks trials`."""

from pathlib import Path

from tests.benchmarks.trials import day_trial, kill_trial


def test_a_session_whose_nodes_are_killed_ends_with_the_same_posterior_and_nothing_missing(
    tmp_path: Path,
) -> None:
    outcome = kill_trial(
        tmp_path, duration=130.0, speed=15.0, kills=("recorder", "updating"), seed=3
    )
    assert len(outcome.kills) == 2
    assert outcome.published == 130
    assert outcome.missing == 0
    assert outcome.windows == 2
    assert outcome.differing == 0
    assert outcome.lost == 0


def test_hours_of_blocks_in_parts_come_back_whole_and_memory_stays_flat(tmp_path: Path) -> None:
    outcome = day_trial(tmp_path, hours=2.0, part=900.0)
    assert outcome.blocks == 7200
    assert outcome.lost == 0
    assert outcome.memory_growth < 0.05
