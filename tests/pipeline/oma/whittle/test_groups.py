"""Suspects whose resonances touch are fitted together."""

import pytest

from pipeline.oma.whittle.groups import TOUCHING_LINES, TOUCHING_WIDTHS, Suspect, grouped

T = 600.0  # [s]
DAMPING = 0.01


def reach(frequency: float) -> float:
    """How far two resonances at about that frequency reach [Hz]."""
    return TOUCHING_WIDTHS * DAMPING * frequency + TOUCHING_LINES / T


def test_neighbours_within_reach_are_one_group_and_others_are_not() -> None:
    first = 1.0
    second = first + 0.9 * reach(first)
    third = second + 1.2 * reach(second)
    suspects = [Suspect(each, DAMPING) for each in (third, first, second)]
    groups = grouped(suspects, T)
    assert [(each.low, each.high) for each in groups] == [(first, second), (third, third)]
    assert groups[0].half_bandwidth == pytest.approx(DAMPING * (first + second) / 2)


def test_a_group_reaches_beyond_its_suspects_by_their_widths_and_some_lines() -> None:
    (group,) = grouped([Suspect(1.0, DAMPING)], T)
    assert group.holds(1.0 + 0.99 * reach(1.0), T)
    assert not group.holds(1.0 - 1.01 * reach(1.0), T)
    assert grouped([], T) == []
