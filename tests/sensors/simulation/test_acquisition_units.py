"""Clocks of acquisition units: what their settings say of the stamps."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import FORE_AFT, Accelerometer, SensorLayout
from sensors.simulation.acquisition_units import (
    UnitError,
    UnitSettings,
    read_by_units,
    unit_layouts,
)

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


@pytest.mark.parametrize("drift", [2500.0, -2500.0])
def test_a_converter_that_is_fast_takes_more_samples_of_the_same_time(drift: float) -> None:
    """Sample m is of the time m / (rate (1 + drift)), by its stamp and by what it measures."""
    seconds, slow = np.arange(20 * 200) / 20.0, 0.05  # [s], [Hz]
    wave = np.sin(2 * np.pi * slow * seconds).astype(np.float32)
    blocks = [
        replace(
            FIRST,
            sequence=k,
            first_sample=20 * k,
            start_ns=FIRST.start_ns + k * NANOSECONDS,
            samples=np.column_stack([wave, wave])[20 * k : 20 * (k + 1)],
        )
        for k in range(200)
    ]
    units = (UnitSettings("right", (20.0,)), UnitSettings("off", (60.0,), clock_drift=drift))
    read = [each for each in read_by_units(blocks, LAYOUT, units) if each.unit == "off"]
    taken = np.array([each.first_sample for each in read]) / (20.0 * (1 + 1e-6 * drift))
    stamps = [(each.start_ns - FIRST.start_ns) / NANOSECONDS for each in read]
    assert stamps == pytest.approx(taken, abs=1e-9)
    inner = slice(5, -5)
    first = np.array([each.samples[0, 0] for each in read])
    assert first[inner] == pytest.approx(np.sin(2 * np.pi * slow * taken)[inner], abs=2e-3)


@pytest.mark.parametrize("start", [0.0, 2.0, 3.0, 30.0])
def test_a_unit_that_starts_later_has_the_towers_samples_of_its_stamps(start: float) -> None:
    """Up to the session's end and none beyond it, wherever the unit starts."""
    tower = np.random.default_rng(5).standard_normal((20 * 60, 2)).astype(np.float32)
    blocks = [
        replace(
            FIRST,
            sequence=k,
            first_sample=20 * k,
            start_ns=FIRST.start_ns + k * NANOSECONDS,
            samples=tower[20 * k : 20 * (k + 1)],
        )
        for k in range(60)
    ]
    units = (UnitSettings("early", (20.0,)), UnitSettings("later", (60.0,), start=start))
    read = [each for each in read_by_units(blocks, LAYOUT, units) if each.unit == "later"]
    stamps = [(each.start_ns - FIRST.start_ns) / NANOSECONDS for each in read]
    assert stamps == pytest.approx(np.arange(start, 60.0))
    samples = np.concatenate([each.samples[:, 0] for each in read])
    np.testing.assert_array_equal(samples, tower[round(20 * start) :, 1])


def test_a_unit_without_a_height_or_with_one_where_no_sensor_is_is_refused() -> None:
    with pytest.raises(UnitError, match=r"unit low: elevations is \[\]; it reads at least one"):
        UnitSettings("low", ())
    line = "unit low: elevations has 21 m, where no sensor is; there are sensors at 20, 60 m"
    with pytest.raises(UnitError, match=line):
        unit_layouts(LAYOUT, (UnitSettings("low", (20.0, 21.0)), UnitSettings("high", (60.0,))))
