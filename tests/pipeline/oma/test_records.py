"""Structures that nobody knows, measured in every way: the short form of `records`."""

from pathlib import Path

import pytest

from tests.benchmarks.records import Judged, draw_record, false_alarms, judge, run
from tests.tiers import and_at_night


@pytest.mark.parametrize("seeds", and_at_night(range(5001, 5011), range(5001, 5021)))
def test_most_modes_of_unknown_records_are_found_and_few_are_invented(
    seeds: range, tmp_path: Path
) -> None:
    """Records of at most 15 000 samples."""
    total, alarms = Judged(), 0
    for seed in seeds:
        record = draw_record(seed, longest=15_000)
        found = run(record, tmp_path)
        assert not found.rejected
        total += judge(record, found.estimates[0].modes)
        alarms += false_alarms(record, found)
    assert total.findable > 2 * len(seeds)
    assert total.found / total.findable >= 0.8
    assert total.covered / total.found >= 0.85
    assert total.spurious <= 0.2 * len(seeds)
    assert alarms <= 0.1 * len(seeds)
