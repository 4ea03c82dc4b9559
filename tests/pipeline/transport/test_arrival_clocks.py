"""A live unit's stamps are held against the clock of the machine that its blocks arrive at."""

from dataclasses import replace

import pytest

from pipeline.transport.arrival_clocks import MOST_WARNINGS, ArrivalClocks
from tests.pipeline.example_messages import block

SECOND = 10**9  # [ns]
YEAR = 365 * 86400


def warned(off: float, n_blocks: int = 30, delay: float = 0.2, pace: float = 1.0) -> list[str]:
    """What is warned of a unit whose clock is `off` [s], its blocks arriving at a pace."""
    clocks = ArrivalClocks()
    first_ns = block(0).end_ns
    for number in range(n_blocks):
        sent = block(number)
        stamped = replace(sent, start_ns=sent.start_ns + round(off * SECOND))
        measured = (sent.end_ns - first_ns) / pace
        clocks.note(stamped, round(first_ns + measured + delay * SECOND))
    return [each.text for each in clocks.warnings]


@pytest.mark.parametrize("off", [6.0, 90.0, 10.0 * YEAR])
def test_a_clock_that_is_ahead_is_warned_of_with_the_figure(off: float) -> None:
    (text,) = warned(off)
    assert f"{off - 0.2:.0f} s ahead" in text


@pytest.mark.parametrize("off", [-6.0, -7200.0, -20.0 * YEAR])
def test_a_clock_that_is_behind_is_warned_of_with_the_figure(off: float) -> None:
    (text,) = warned(off)
    assert f"{-off + 0.2:.0f} s behind" in text


def test_a_clock_that_is_right_within_seconds_is_not_warned_of() -> None:
    assert warned(4.0) == warned(-4.0) == warned(0.0, delay=3.0) == []


@pytest.mark.parametrize(("minutes", "named"), [(60, False), (90, True)])
def test_a_rate_that_no_stamp_shows_is_named_once_the_clock_is_off(minutes, named) -> None:
    """A converter at 1000 ppm less than it states, stamps counted from its samples."""
    clocks = ArrivalClocks()
    for number in range(60 * minutes - 40, 60 * minutes):
        sent = block(number)
        clocks.note(sent, sent.end_ns + round(1e-3 * number * SECOND))
    assert [each.code for each in clocks.warnings] == ["clock-off"] * named


def test_a_backlog_after_a_cut_is_no_wrong_clock() -> None:
    assert warned(0.0, delay=86400.0, pace=20.0) == []


def test_few_blocks_prove_nothing() -> None:
    assert warned(3600.0, n_blocks=4) == []


def test_a_stray_stamp_is_not_taken_for_the_clock() -> None:
    clocks = ArrivalClocks()
    for number in range(20):
        sent = block(number)
        off = 3600 * SECOND if number == 10 else 0
        clocks.note(replace(sent, start_ns=sent.start_ns + off), sent.end_ns)
    assert clocks.warnings == ()


def test_the_warning_ends_when_the_clock_is_set_right() -> None:
    clocks = ArrivalClocks()
    for number in range(40):
        sent = block(number)
        off = 60 * SECOND if number < 20 else 0
        clocks.note(replace(sent, start_ns=sent.start_ns + off), sent.end_ns)
        if number == 19:
            assert [each.code for each in clocks.warnings] == ["clock-off"]
    assert clocks.warnings == ()


def test_of_many_units_those_furthest_off_are_named() -> None:
    clocks = ArrivalClocks()
    for unit in range(3 * MOST_WARNINGS):
        for number in range(20):
            sent = replace(block(number), unit=f"u{unit}")
            off = 60 * unit * SECOND
            clocks.note(replace(sent, start_ns=sent.start_ns + off), sent.end_ns)
    assert len(clocks.warnings) == MOST_WARNINGS
    assert f"unit u{3 * MOST_WARNINGS - 1} of" in clocks.warnings[0].text


def test_of_many_units_clocks_behind_are_as_far_off_as_those_ahead() -> None:
    """u1 is a minute ahead, u2 two behind, u3 three ahead, …: the last ones are named."""
    clocks, most = ArrivalClocks(), 2 * MOST_WARNINGS
    for unit in range(1, most + 1):
        off = 60 * unit * (-1) ** (unit + 1) * SECOND
        for number in range(20):
            sent = replace(block(number), unit=f"u{unit}")
            clocks.note(replace(sent, start_ns=sent.start_ns + off), sent.end_ns)
    named = [f"unit u{most - place} of" in each.text for place, each in enumerate(clocks.warnings)]
    assert named == [True] * MOST_WARNINGS


def test_as_many_units_as_may_be_watched_are_watched(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("pipeline.transport.arrival_clocks.MOST_UNITS", 2)
    clocks = ArrivalClocks()
    for k in range(30):
        for unit in ("a", "b"):
            each = replace(block(k), unit=unit)
            clocks.note(each, each.end_ns + 3600 * 10**9)
    assert len(clocks.warnings) == 2


@pytest.mark.parametrize(("pace", "wrong"), [(1.8, True), (2.2, False)])
def test_blocks_that_arrive_more_than_twice_as_fast_as_measured_are_a_backlog(
    pace: float, wrong: bool
) -> None:
    assert bool(warned(-7200.0, pace=pace)) is wrong
