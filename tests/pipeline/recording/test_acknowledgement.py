"""What a recorder acknowledges: blocks by number and stamp, once they are synced."""

from dataclasses import replace

from hypothesis import given
from hypothesis import strategies as st

from pipeline.messages import BlockRange, RecordedUntil
from pipeline.recording.acknowledgement import MOST_RANGES, Acknowledgements
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import START_NS, block

SECOND = 10**9  # [ns]


def on_disk(kept: Acknowledgements) -> tuple[RecordedUntil, ...]:
    kept.sync()
    return kept.acknowledged(0)


def acknowledged(blocks: list[AccelerationBlock]) -> list[tuple[int, int]]:
    """First and last + 1 of the ranges after these blocks."""
    kept = Acknowledgements()
    for each in blocks:
        kept.note(each)
    return [(each.first, each.end) for said in on_disk(kept)[-1:] for each in said.ranges]


def test_blocks_on_end_are_one_range() -> None:
    assert acknowledged([block(0), block(1), block(2)]) == [(0, 3)]


def test_nothing_is_acknowledged_before_it_is_synced_nor_after_a_disk_that_refused() -> None:
    kept = Acknowledgements()
    kept.note(block(0))
    assert kept.acknowledged(0) == ()
    kept.forget()
    assert on_disk(kept) == ()


def test_a_gap_that_is_filled_later_closes() -> None:
    assert acknowledged([block(0), block(3)]) == [(0, 1), (3, 4)]
    assert acknowledged([block(0), block(3), block(1), block(2)]) == [(0, 4)]


def test_a_unit_that_started_again_under_its_name_has_ranges_of_its_own() -> None:
    again = [replace(each, start_ns=each.start_ns + 900 * SECOND) for each in (block(0), block(1))]
    kept = Acknowledgements()
    for each in (block(0), block(1), block(2), *again):
        kept.note(each)
    (said,) = on_disk(kept)
    assert [(each.first, each.end) for each in said.ranges] == [(0, 3), (0, 2)]
    assert said.has(1, again[1].start_ns)
    assert not said.has(2, again[1].start_ns + SECOND)
    assert said.ranges[-1].end == 2


def test_ranges_are_bounded() -> None:
    assert len(acknowledged([block(3 * n) for n in range(2 * MOST_RANGES)])) == MOST_RANGES


def test_of_too_many_ranges_those_that_grew_last_are_kept() -> None:
    """The first one grows when all others are there: it stays, the second has to go."""
    many = [*(block(3 * n) for n in range(MOST_RANGES)), block(1), block(3 * MOST_RANGES)]
    kept = [(0, 2), *((3 * n, 3 * n + 1) for n in range(2, MOST_RANGES + 1))]
    assert sorted(acknowledged(many)) == kept


def test_a_block_that_comes_again_is_acknowledged_again() -> None:
    kept = Acknowledgements()
    kept.note(block(0))
    on_disk(kept)
    kept.note(block(0))
    assert [said.ranges[-1].end for said in on_disk(kept)] == [1]
    assert on_disk(kept) == ()


@given(st.permutations(range(12)), st.integers(0, 12))
def test_whatever_the_order_exactly_what_was_noted_is_acknowledged(
    order: list[int], count: int
) -> None:
    kept = Acknowledgements()
    for number in order[:count]:
        kept.note(block(number))
    said = on_disk(kept)
    known = {n for n in range(12) for each in said if each.has(n, block(n).start_ns)}
    assert known == set(order[:count])


def stamped(sequence: int, start_ns: int) -> AccelerationBlock:
    """A block of a tenth of a second."""
    return replace(block(sequence), start_ns=start_ns, samples=block(sequence).samples[:4])


def ranges_of(*blocks: AccelerationBlock) -> tuple[BlockRange, ...]:
    kept = Acknowledgements()
    for each in blocks:
        kept.note(each)
    (said,) = on_disk(kept)
    return said.ranges


def test_a_range_has_the_earliest_and_the_latest_stamp_of_its_blocks() -> None:
    """A clock that is set back by three tenths of a second leaves one run of blocks."""
    tenth = SECOND // 10
    stamps = [START_NS, START_NS + tenth, START_NS - tenth, START_NS]
    (one,) = ranges_of(*(stamped(k, stamp) for k, stamp in enumerate(stamps)))
    assert (one.first, one.end) == (0, 4)
    assert (one.earliest_ns, one.latest_ns) == (min(stamps), max(stamps))


def test_numbers_that_go_on_after_a_step_of_the_clock_are_another_range() -> None:
    """They may be those of another boot under the same name."""
    found = ranges_of(block(0), replace(block(1), start_ns=START_NS + 3600 * SECOND))
    assert [(each.first, each.end) for each in found] == [(0, 1), (1, 2)]
