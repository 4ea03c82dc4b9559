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
