"""A replayed tower gives what was measured, in the order of its clock, and invents nothing."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.replayed import ReplayedTower, due_time
from tests.pipeline.example_messages import LAYOUT, block


def sequences(tower: ReplayedTower) -> list[int]:
    return [message.sequence for message in tower if isinstance(message, AccelerationBlock)]


def test_a_recording_in_order_is_given_as_it_is() -> None:
    recorded = [LAYOUT, *map(block, range(20))]
    assert list(ReplayedTower(recorded)) == recorded


def test_a_gap_stays_a_gap() -> None:
    recorded = [block(sequence) for sequence in (0, 1, 2, 7, 8)]
    assert list(ReplayedTower(recorded)) == recorded


def test_blocks_that_a_mended_link_delivered_late_come_in_their_place() -> None:
    # sequence   0 1 2 6 7 3 4 5 8      the link was cut for three blocks
    recorded = [block(sequence) for sequence in (0, 1, 2, 6, 7, 3, 4, 5, 8)]
    assert sequences(ReplayedTower(recorded)) == list(range(9))


@given(st.permutations(range(12)))
def test_any_order_within_the_cache_becomes_the_order_of_time(order: list[int]) -> None:
    recorded = [block(sequence) for sequence in order]
    assert sequences(ReplayedTower(recorded, latest_blocks=12)) == list(range(12))


def test_two_units_are_interleaved_on_one_clock() -> None:
    one = [block(sequence) for sequence in range(3)]
    other = [block(sequence, unit="jacket") for sequence in range(3)]
    replayed = list(ReplayedTower([*one, *other]))
    assert [message.unit for message in replayed] == ["tower", "jacket"] * 3


def test_a_layout_comes_before_the_blocks_it_describes() -> None:
    assert isinstance(next(iter(ReplayedTower([LAYOUT, block(0)]))), SensorLayout)


def test_a_block_is_due_when_its_last_sample_is_taken() -> None:
    assert due_time(block(0)) == block(1).start_ns
    assert due_time(LAYOUT) is None


YEAR_NS = 31_557_600 * NANOSECONDS


@pytest.mark.parametrize("step_ns", [12 * YEAR_NS, -12 * YEAR_NS, -7200 * NANOSECONDS, NANOSECONDS])
@pytest.mark.parametrize("at", [10, 60])
def test_the_order_is_that_of_the_samples_whatever_the_stamps_say(step_ns: int, at: int) -> None:
    """On main before, 899 of 2000 blocks came late after a step back."""
    recorded = [
        replace(b, start_ns=b.start_ns + step_ns * (b.sequence >= at))
        for b in map(block, range(100))
    ]
    assert list(ReplayedTower(recorded, latest_blocks=30)) == recorded


def test_blocks_that_come_late_are_put_in_order_after_a_step_too() -> None:
    order = [*range(40), *range(50, 60), *range(40, 50), *range(60, 70)]
    recorded = [
        replace(b, start_ns=b.start_ns - 5 * YEAR_NS * (b.sequence >= 20))
        for b in map(block, order)
    ]
    assert sequences(ReplayedTower(recorded)) == list(range(70))


def test_a_unit_whose_clock_stepped_stays_beside_the_other() -> None:
    recorded = []
    for sequence in range(60):
        recorded.append(block(sequence))
        other = block(sequence, unit="jacket")
        recorded.append(replace(other, start_ns=other.start_ns + 12 * YEAR_NS * (sequence < 30)))
    assert [m.unit for m in ReplayedTower(recorded)] == ["tower", "jacket"] * 60


def test_a_boot_of_the_same_name_follows_the_one_before() -> None:
    first = [block(sequence) for sequence in range(30)]
    again = [replace(b, start_ns=b.start_ns - YEAR_NS) for b in first]
    assert sequences(ReplayedTower([*first, *again])) == [*range(30), *range(30)]


def test_stamps_that_scatter_are_kept_and_steps_are_counted_over() -> None:
    """A stamp a fifth of a second off is data; beyond half a second the count is followed."""
    scattered = [
        replace(block(k), start_ns=block(k).start_ns + k % 2 * 200_000_000) for k in range(6)
    ]
    other = [replace(block(k, unit="jacket"), start_ns=block(k).start_ns + 10**8) for k in range(6)]
    units = [message.unit for message in ReplayedTower([*scattered, *other])]
    assert units == ["tower", "jacket", "jacket", "tower"] * 3
