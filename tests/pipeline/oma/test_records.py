"""Structures that nobody knows, measured in every way: the short form of `records`."""

from pathlib import Path

from tests.benchmarks.records import Judged, draw_record, false_alarms, judge, run


def test_most_modes_of_unknown_records_are_found_and_few_are_invented(tmp_path: Path) -> None:
    """Twenty records of at most 15 000 samples, seeds 5001 to 5020, chosen before looking."""
    total, alarms = Judged(), 0
    for seed in range(5001, 5021):
        record = draw_record(seed, longest=15_000)
        found = run(record, tmp_path)
        assert not found.rejected
        total += judge(record, found.estimates[0].modes)
        alarms += false_alarms(record, found)
    assert total.findable > 40
    assert total.found / total.findable >= 0.8
    assert total.covered / total.found >= 0.85
    assert total.spurious <= 4
    assert alarms <= 2
