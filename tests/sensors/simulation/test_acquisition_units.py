"""Clocks of acquisition units: what their settings say of the stamps."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.simulation.acquisition_units import UnitSettings, read_by_units

LAYOUT = SensorLayout(
    "two",
    "t",
    "tower",
    (Accelerometer("z20", 20.0, FORE_AFT), Accelerometer("z60", 60.0, FORE_AFT)),
)
FIRST = AccelerationBlock(
    turbine="t",
    unit="tower",
    session="s",
    layout_id="two",
    sequence=0,
    first_sample=0,
    start_ns=1_800_000_000 * NANOSECONDS,
    sampling_rate=20.0,
    samples=np.zeros((20, 2), np.float32),
)


@pytest.mark.parametrize("offset", [3e-3, -0.2])
def test_stamps_of_a_clock_that_is_late_by_seconds_are_that_much_larger(offset: float) -> None:
    blocks = [
        replace(FIRST, sequence=k, first_sample=20 * k, start_ns=FIRST.start_ns + k * NANOSECONDS)
        for k in range(10)
    ]
    units = (UnitSettings("right", (20.0,)), UnitSettings("off", (60.0,), clock_offset=offset))
    read = list(read_by_units(blocks, LAYOUT, units))
    stamps = {unit: [b.start_ns for b in read if b.unit == unit] for unit in ("right", "off")}
    late = (np.array(stamps["off"]) - np.array(stamps["right"])) / NANOSECONDS
    assert late == pytest.approx(np.full(len(late), offset), abs=1e-9)
