"""Which boot a block is of, by its numbers and its stamps."""

from dataclasses import replace

import pytest

from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.boots import (
    ENOUGH_TO_START,
    NOTABLE_CLOCK_STEP,
    RATE_ERROR,
    BootCounter,
)
from tests.pipeline.example_messages import START_NS, block

SECOND = 10**9  # [ns]


def stamped(sequence: int, second: float) -> AccelerationBlock:
    """A block of a second under a stamp of its own."""
    return replace(block(sequence), start_ns=START_NS + round(second * SECOND))


def boots_of(
    *blocks: AccelerationBlock, repeats: bool = False, counter: BootCounter | None = None
) -> list[int]:
    counter = counter or BootCounter()
    return [counter.boot_of(each, repeats=repeats) for each in blocks]


def test_numbers_that_begin_again_under_later_stamps_are_another_boot() -> None:
    assert boots_of(*map(block, range(10)), stamped(0, 100), stamped(1, 101)) == [0] * 10 + [1] * 2


@pytest.mark.parametrize(("number", "boot"), [(4, 1), (5, 0), (6, 0)])
def test_a_number_nearer_to_zero_than_to_the_newest_is_of_a_new_boot(
    number: int, boot: int
) -> None:
    assert boots_of(block(10), stamped(number, 1000))[-1] == boot


@pytest.mark.parametrize("sign", [-1, 1])
@pytest.mark.parametrize(("share", "boot"), [(0.99, 0), (1.01, 1)])
def test_stamps_fit_within_half_a_second_and_a_hundredth_of_the_time(
    sign: int, share: float, boot: int
) -> None:
    """A block that was late by fifty seconds."""
    off = share * (NOTABLE_CLOCK_STEP + 50 * RATE_ERROR)
    assert boots_of(block(60), stamped(10, 10 + sign * off))[-1] == boot


def test_as_many_numbers_that_came_before_as_prove_it_are_a_new_boot_from_their_first_on() -> None:
    counter = BootCounter()
    boots_of(block(9), counter=counter)
    again = [stamped(5 + n, 1000 + n) for n in range(ENOUGH_TO_START)]
    found = boots_of(*again[:-1], repeats=True, counter=counter)
    assert found == [0] * (ENOUGH_TO_START - 1)
    assert boots_of(again[-1], repeats=True, counter=counter) == [1]
    assert counter.also == ENOUGH_TO_START - 1
    assert boots_of(stamped(5 + ENOUGH_TO_START, 1000 + ENOUGH_TO_START), counter=counter) == [1]
    assert counter.also == 0


def test_numbers_that_do_not_follow_each_other_prove_no_boot() -> None:
    counter = BootCounter()
    boots_of(block(90), counter=counter)
    apart = [stamped(50 + 2 * n, 1000 + 2 * n) for n in range(2 * ENOUGH_TO_START)]
    assert set(boots_of(*apart, repeats=True, counter=counter)) == {0}


def test_a_block_of_an_earlier_boot_that_comes_late_is_of_that_boot() -> None:
    counter = BootCounter()
    boots_of(*map(block, range(10)), stamped(0, 100), stamped(1, 101), counter=counter)
    assert boots_of(block(10), stamped(2, 102), block(4), counter=counter) == [0, 1, 0]
    assert counter.boot_at(11, START_NS + 11 * SECOND) == 0
    assert counter.boot_at(3, START_NS + 103 * SECOND) == 1
    assert counter.boot_at(3, START_NS + 1000 * SECOND) == 1  # of none: the present one


@pytest.mark.parametrize(("number", "unused"), [(1, 0), (4, 3)])
def test_numbers_that_were_passed_over_without_a_missing_sample_are_counted(
    number: int, unused: int
) -> None:
    counter = BootCounter()
    assert counter.unused_before(block(0)) == 0
    boots_of(block(0), counter=counter)
    assert counter.unused_before(replace(block(number), first_sample=40)) == unused
    assert counter.unused_before(replace(block(number), first_sample=80)) == 0
