"""The truth of a simulated foundation: from the first sample on, and where it changes."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.messages import FoundationTruth
from pipeline.sources.ground_truth import (
    TRUTH_PERIOD,
    later_truths,
    simulated_truths,
    stored_truth,
    with_truths,
)
from sensors.acquisition.blocks import NANOSECONDS
from sensors.simulation.schedule import FoundationSchedule, Schedule, StiffnessEvent
from sensors.structure.foundation import FoundationSprings
from tests.pipeline.example_messages import LAYOUT, block

START_NS = 1_700_000_000 * NANOSECONDS


@pytest.mark.parametrize("changes_at", [None, 0.5 * TRUTH_PERIOD, 7.2 * TRUTH_PERIOD])
def test_a_truth_is_given_at_the_beginning_and_at_the_first_look_after_a_change(changes_at) -> None:
    def truth_at(time: float) -> FoundationSprings:
        left = 1.0 if changes_at is None or time < changes_at else 0.8
        return FoundationSprings(1e10 * left, 8e11, 6e10)

    tower = SimpleNamespace(
        settings=SimpleNamespace(duration=20 * TRUTH_PERIOD, start_ns=START_NS),
        layout=SimpleNamespace(turbine="t1"),
        schedule=Schedule(),
        truth_at=truth_at,
    )
    found = [
        [(each.time_ns - START_NS) / NANOSECONDS, each.k11 / 1e10]
        for each in simulated_truths(tower)
    ]
    expected = [[0.0, 1.0]]
    if changes_at is not None:
        expected.append([TRUTH_PERIOD * np.ceil(changes_at / TRUTH_PERIOD), 0.8])
    assert np.array(found) == pytest.approx(np.array(expected))


def test_a_truth_is_given_at_the_instant_of_an_event_within_the_session() -> None:
    events = tuple(StiffnessEvent(at, (1.0, 0.9, 1.0)) for at in (650.0, -60.0, 1800.0))
    schedule = Schedule(foundation=FoundationSchedule(events=events))

    def truth_at(time: float) -> FoundationSprings:
        return FoundationSprings(1e10, 8e11 * schedule.stiffness_factors(time)[1], 6e10)

    tower = SimpleNamespace(
        settings=SimpleNamespace(duration=1800.0, start_ns=START_NS),
        layout=SimpleNamespace(turbine="t1"),
        schedule=schedule,
        truth_at=truth_at,
    )
    found = [((each.time_ns - START_NS) / 1e9, each.k22 / 8e11) for each in simulated_truths(tower)]
    assert np.array(found) == pytest.approx(np.array([(0.0, 0.9), (650.0, 0.81)]))


def test_a_truth_comes_before_the_first_block_that_lies_behind_it() -> None:
    """One of a block's last instant waits for the next block; what is left is not given."""
    blocks = [block(number) for number in range(3)]
    times = [blocks[0].start_ns, blocks[0].end_ns, blocks[1].end_ns + 1, blocks[2].end_ns]
    truths = [FoundationTruth("t1", time_ns, 1e10, 8e11, 6e10) for time_ns in times]
    given = list(with_truths([LAYOUT, *blocks], iter(truths)))
    expected = [LAYOUT, truths[0], blocks[0], truths[1], blocks[1], truths[2], blocks[2]]
    assert [id(each) for each in given] == [id(each) for each in expected]
    assert list(later_truths(iter(truths), truths[0])) == truths[1:]


def test_a_stored_truth_is_read_as_it_was() -> None:
    stored = {"truth": {"time_ns": "5", "k11": "1.5", "k22": "2.5", "k12": "-3.5"}}
    assert stored_truth(stored, "t1") == FoundationTruth("t1", 5, 1.5, 2.5, -3.5)
    assert stored_truth({}, "t1") is None
