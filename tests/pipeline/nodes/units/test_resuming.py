"""Which recorded messages a restart needs."""

from dataclasses import replace

from pipeline.nodes.units.resuming import OVERTAKING, needed_messages
from sensors.acquisition.blocks import BlockMark
from tests.pipeline.example_messages import block


def test_a_block_is_needed_that_came_up_to_ten_messages_before_one_that_lies_before_it() -> None:
    marked, late = block(0), block(1)
    others = [replace(block(n), unit="other") for n in range(OVERTAKING)]
    marks = {"tower": BlockMark.of(marked)}
    assert list(needed_messages([late, *others[1:], marked], marks)) == [late, marked]
    assert list(needed_messages([late, *others, marked], marks)) == [marked]


def test_of_two_units_in_step_each_goes_on_with_its_own_first_needed_block() -> None:
    """Their blocks have the same numbers, stamps and sessions."""
    past = [replace(block(n), unit=unit) for n in range(20) for unit in ("tower", "nacelle")]
    marks = {"tower": BlockMark.of(block(15)), "nacelle": BlockMark.of(block(5))}
    needed = [(each.unit, each.sequence) for each in needed_messages(past, marks)]
    assert [number for unit, number in needed if unit == "tower"] == [*range(15, 20)]
    assert [number for unit, number in needed if unit == "nacelle"] == [*range(5, 20)]
