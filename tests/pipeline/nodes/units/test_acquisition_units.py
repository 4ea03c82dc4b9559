"""What is remembered of a unit's blocks, for as long as it measures."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import QualityWarning
from pipeline.nodes.units.acquisition_units import (
    AcquisitionUnit,
    AcquisitionUnits,
    UnitBlock,
    UnitSession,
    read_back,
)
from pipeline.oma.settings import OmaSettings
from pipeline.oma.window_identification import WindowContext
from pipeline.oma.windows.block_admission import Boot
from pipeline.oma.windows.windowing import Beginning
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock, BlockMark
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout

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


def test_a_session_after_another_expects_the_block_behind_the_last_that_it_had() -> None:
    """Block 9 was joined, 10 to 14 are lost: they are what is missing."""
    unit = unit_of(range(10))
    for number in (8, 9, 7):
        unit.note_joined(block(number))
    assert unit.expected(block(15)) == Beginning(10 * RATE, 10)
    assert unit.expected(block(5)) == Beginning(5 * RATE, 5)


@pytest.mark.parametrize("answered", [0, 3, 100])
def test_windows_that_overlap_need_samples_from_one_hop_a_window_on(answered: int) -> None:
    settings = OmaSettings(window_duration=60.0, hop=20.0)
    layout = SensorLayout(
        "l", "t", "tower", tuple(Accelerometer(name, 20.0, FORE_AFT) for name in "ab")
    )
    begun = UnitBlock(block(0), Boot("s", 0), Beginning(0, 0))
    session = UnitSession(begun, {"l": layout}, WindowContext(settings, lambda *_: None))
    session.resume({"window": answered, "origin": 7}, {"tower": Beginning(0, 0)})
    assert session.needed() == {"tower": 7 + answered * 20 * RATE}


def test_a_refusal_names_unit_and_turbine_whatever_they_are_called() -> None:
    units = AcquisitionUnits(SETTINGS, most=2)
    assert units.last_refusal("t1") == ""
    units.named("mast: top").admission.refuse(QualityWarning("code", "too fast: 9 kHz"))
    assert units.last_refusal("t1") == "unit mast: top of t1: too fast: 9 kHz"


def test_refused_blocks_of_a_unit_that_is_let_go_stay_counted() -> None:
    units = AcquisitionUnits(SETTINGS, most=1)
    for name in ("a", "b", "b"):
        units.named(name).admission.refuse(QualityWarning("code", "text"))
    assert units.refused == {"code": 3}
    assert units.gone == 1
