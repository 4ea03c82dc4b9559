"""What link and clock of a unit do wrong is told by name, once."""

from dataclasses import replace
from datetime import UTC, datetime

import pytest

from pipeline.oma.windows import unit_clock
from pipeline.oma.windows.unit_clock import BlockMonitor
from sensors.acquisition.blocks import NANOSECONDS
from tests.pipeline.example_messages import block


def test_a_unit_with_a_good_clock_and_link_gives_no_cause_for_words() -> None:
    watch = BlockMonitor(lateness=5.0)
    for sequence in range(60):
        watch.note(block(sequence))
    assert watch.warnings_until(60 * 40) == ()
    assert watch.still_channel(0, 60 * 40) is None


def test_what_the_link_did_is_counted_by_name() -> None:
    watch = BlockMonitor(lateness=5.0)
    for sequence in (0, 1, 1, 3, 2, 4, 20, 5):
        watch.note(block(sequence))
    codes = {warning.code: warning.text for warning in watch.warnings_until(0)}
    assert {code: text.split()[0] for code, text in codes.items()} == {
        "repeated": "1",
        "out-of-order": "1",
        "late": "1",
    }
    assert watch.warnings_until(0) == ()  # told once


def test_a_block_is_late_by_how_far_the_newest_is_ahead_of_it() -> None:
    watch = BlockMonitor(lateness=5.0)
    for sequence in (1000, 1006, 1002, 1000 - 1):
        watch.note(block(sequence))
    counts = {each.code: each.text.split()[0] for each in watch.warnings_until(0)}
    assert counts == {"out-of-order": "1", "late": "1"}


def test_what_was_there_before_a_restart_comes_twice_and_is_not_late() -> None:
    watch = BlockMonitor(lateness=5.0)
    watch.resume(block(0).session, 700)
    for sequence in (*range(700, 2000), *range(20), *range(690, 900)):
        watch.note(block(sequence))
    counts = {each.code: each.text.split()[0] for each in watch.warnings_until(0)}
    assert counts == {"repeated": "230"}


def test_a_link_that_loses_every_other_block_costs_no_memory(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(unit_clock, "MISSING_KEPT", 100)
    watch = BlockMonitor(lateness=5.0)
    for sequence in range(0, 210, 2):
        watch.note(block(sequence))
    assert len(watch._missing) == 100
    for sequence in (1, 199, 200):
        watch.note(block(sequence))
    counts = {each.code: each.text.split()[0] for each in watch.warnings_until(0)}
    assert counts == {"repeated": "2", "late": "1"}


@pytest.mark.parametrize("ppm", [-40.0, 40.0])
def test_a_clock_that_runs_fast_or_slow_is_told_with_its_rate(ppm: float) -> None:
    watch = BlockMonitor(lateness=5.0)
    for sequence in range(60):
        sound = block(sequence)
        off = round(ppm * 1e-6 * sequence * NANOSECONDS)
        watch.note(replace(sound, start_ns=sound.start_ns + off))
    (warning,) = watch.warnings_until(61 * 40)
    assert warning.code == "clock-drift"
    assert f"{ppm:+.0f} ppm" in warning.text


def test_a_channel_that_dies_within_a_window_is_found_where_it_dies() -> None:
    watch = BlockMonitor(lateness=5.0)
    for sequence in range(20):
        sound = block(sequence)
        samples = sound.samples.copy()
        if sequence >= 12:
            samples[:, 5] = 0.0
        watch.note(replace(sound, samples=samples))
    assert watch.still_channel(0, 20 * 40) == (5, 13.0)
    assert watch.still_channel(0, 10 * 40) is None


@pytest.mark.parametrize(
    ("year", "warned"), [(1970, True), (1980, True), (2000, True), (2024, False)]
)
def test_a_clock_that_was_never_set_is_named(year: int, warned: bool) -> None:
    monitor = BlockMonitor(lateness=5.0)
    begins = round(datetime(year, 1, 2, tzinfo=UTC).timestamp()) * NANOSECONDS
    for number in range(30):
        monitor.note(replace(block(number), start_ns=begins + number * NANOSECONDS))
    found = {each.code: each.text for each in monitor.warnings_until(10**9)}
    assert ("clock-unset" in found) == warned
    assert not warned or f"{year}-01-02" in found["clock-unset"]
