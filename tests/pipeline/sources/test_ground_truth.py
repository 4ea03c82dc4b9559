"""The truth of a simulated foundation: from the first sample on, and where it changes."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.sources.ground_truth import TRUTH_PERIOD, simulated_truths
from sensors.acquisition.blocks import NANOSECONDS
from sensors.structure.foundation import FoundationSprings

START_NS = 1_700_000_000 * NANOSECONDS


@pytest.mark.parametrize("changes_at", [None, 0.5 * TRUTH_PERIOD, 7.2 * TRUTH_PERIOD])
def test_a_truth_is_given_at_the_beginning_and_at_the_first_look_after_a_change(changes_at) -> None:
    def truth_at(time: float) -> FoundationSprings:
        left = 1.0 if changes_at is None or time < changes_at else 0.8
        return FoundationSprings(1e10 * left, 8e11, 6e10)

    tower = SimpleNamespace(
        settings=SimpleNamespace(duration=20 * TRUTH_PERIOD, start_ns=START_NS),
        layout=SimpleNamespace(turbine="t1"),
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
