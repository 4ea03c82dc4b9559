"""What turned and displaced sensors read is what a layout that has them there reads."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.layout import SensorLayout, biaxial_layout
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.placed_readings import MovableReadings, Placement
from sensors.structure.sensor_readings import ChannelReadings

HEIGHTS = (41.0, 80.0, 106.0)


def layout_at(*heights: float) -> SensorLayout:
    return biaxial_layout("tower", turbine="iea15mw", unit="tower", elevations=heights)


LAYOUT = layout_at(*HEIGHTS)
MODEL = assemble(load_turbine("iea15mw_monopile"))


def moved(rise: float, angle: float) -> SensorLayout:
    c, s = np.cos(angle), np.sin(angle)
    channels = []
    for channel in LAYOUT.channels:
        x, y, z = channel.direction
        turned = (float(c * x - s * y), float(s * x + c * y), z)
        channels.append(replace(channel, elevation=channel.elevation + rise, direction=turned))
    return replace(LAYOUT, channels=tuple(channels))


def smooth_motion() -> np.ndarray:
    """A bending wave of 50 m in both planes: shorter than any mode below 12 Hz has."""
    motion = np.zeros(MODEL.n_dofs)
    k = 2 * np.pi / 50.0
    for z, dofs in zip(MODEL.elevations, MODEL.tower_dofs, strict=True):
        inside = dofs < MODEL.n_dofs
        values = [np.sin(k * z), k * np.cos(k * z), np.cos(k * z), -k * np.sin(k * z), 0.0, 0.0]
        motion[dofs[inside]] = np.array(values)[inside]
    return motion


def placement(rise: float, angle: float) -> Placement:
    n = len(LAYOUT.channels)
    return Placement(headings=np.full(n, angle), heights=np.full(n, rise))


@pytest.mark.parametrize(("rise", "angle"), [(0.1, 0.05), (3.0, 0.3), (-5.0, -0.2), (6.0, 1.0)])
def test_a_moved_sensor_reads_what_its_place_does(rise: float, angle: float) -> None:
    readings, motion = MovableReadings.of(MODEL, LAYOUT), smooth_motion()
    there = ChannelReadings.of(MODEL, moved(rise, angle))
    found = readings.at(placement(rise, angle)).motion
    np.testing.assert_allclose(found.displacement @ motion, there.displacement @ motion, atol=0.01)
    slope = np.abs(there.gravity_slope @ motion).max()
    np.testing.assert_allclose(
        found.gravity_slope @ motion, there.gravity_slope @ motion, atol=0.06 * slope
    )


def test_derivatives_are_those_of_differences() -> None:
    readings, step = MovableReadings.of(MODEL, LAYOUT), 1e-5
    here = readings.at(placement(2.0, 0.3))
    for derived, ahead, behind in (
        (here.by_height, placement(2.0 + step, 0.3), placement(2.0 - step, 0.3)),
        (here.by_heading, placement(2.0, 0.3 + step), placement(2.0, 0.3 - step)),
    ):
        more, less = readings.at(ahead).motion, readings.at(behind).motion
        slope = (more.displacement - less.displacement) / (2 * step)
        np.testing.assert_allclose(derived.displacement, slope, atol=1e-8)
        slope = (more.gravity_slope - less.gravity_slope) / (2 * step)
        np.testing.assert_allclose(derived.gravity_slope, slope, atol=1e-8)


def test_above_the_towers_top_a_sensor_moves_with_the_body_that_it_carries() -> None:
    top = MODEL.description.tower_top
    layout = layout_at(top)
    n = len(layout.channels)
    raised = MovableReadings.of(MODEL, layout).at(Placement(np.zeros(n), np.full(n, 5.0))).motion
    stated = ChannelReadings.of(MODEL, layout)
    slope = stated.gravity_slope / MODEL.description.gravity
    np.testing.assert_allclose(raised.displacement, stated.displacement + 5.0 * slope, atol=1e-9)


def test_an_upright_axis_has_no_heading() -> None:
    upright = tuple(replace(c, direction=(0.0, 0.0, 1.0)) for c in LAYOUT.channels[:1])
    readings = MovableReadings.of(MODEL, replace(LAYOUT, channels=upright))
    found = readings.at(Placement.as_stated(1))
    assert np.abs(found.motion.displacement).max() > 0.1
    np.testing.assert_allclose(found.by_heading.displacement, 0.0, atol=1e-15)
