"""What is remembered of a unit's blocks, for as long as it measures."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.nodes.units.acquisition_units import AcquisitionUnit, read_back
from pipeline.oma.settings import OmaSettings
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockMark

SETTINGS = OmaSettings(window_duration=60.0, hop=60.0)
RATE = 20  # [Hz]
FIRST = AccelerationBlock("t", "tower", "s", "l", 0, 0, 0, float(RATE), np.zeros((RATE, 2)))


def block(number: int, n_samples: int = RATE) -> AccelerationBlock:
    first = number * n_samples
    return replace(
        FIRST,
        sequence=number,
        first_sample=first,
        start_ns=round(first / RATE * NANOSECONDS),
        samples=np.zeros((n_samples, 2)),
    )


def unit_of(numbers: range, n_samples: int = RATE) -> AcquisitionUnit:
    unit = AcquisitionUnit(SETTINGS)
    for number in numbers:
        unit.marks.append(BlockMark.of(block(number, n_samples)))
        if number % 600 == 599:
            unit.forget_unread()
    return unit


def test_as_many_blocks_are_remembered_after_hours_as_after_ten_minutes() -> None:
    counts = {len(unit_of(range(seconds)).marks) for seconds in (600, 6_000, 19_800)}
    assert counts == {round(read_back(SETTINGS)) + 1}


@pytest.mark.parametrize("n_samples", [1, RATE, 10 * RATE])
def test_a_restart_finds_the_block_that_an_open_window_begins_in(n_samples: int) -> None:
    n_blocks = 1_000 * RATE // n_samples
    unit = unit_of(range(n_blocks), n_samples)
    needed = (n_blocks - 1) * n_samples - 100 * RATE  # an open window and what may be late
    assert unit.mark_before(needed) == BlockMark.of(block(needed // n_samples, n_samples))


def test_the_last_block_before_a_day_without_samples_is_still_known() -> None:
    unit = unit_of(range(300))
    after = block(86_400)
    unit.marks.append(BlockMark.of(after))
    unit.forget_unread()
    assert unit.mark_before(after.first_sample - 1) == BlockMark.of(block(299))
    assert unit.expected(after).first_sample == after.first_sample
