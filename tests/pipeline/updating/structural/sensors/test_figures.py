"""What gain, heading and height of a sensor do to what it reads."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.structural.sensors.figures import (
    SensorFigure,
    SensorReadings,
    sensor_figures,
)
from sensors.acquisition.layout import biaxial_layout

FIGURES = (
    SensorFigure("gain", "a", "-", 0.01, (0,)),
    SensorFigure("heading", "80 m", "deg", 2.0, (0, 1)),
    SensorFigure("height", "80 m", "m", 0.2, (0, 1)),
)


def test_a_figure_one_standard_deviation_off_is_off_by_its_own_unit() -> None:
    sensors, z = SensorReadings(FIGURES, 2), np.array([1.0, -1.0, 2.0])
    place = sensors.placement(z)
    assert sensors.gains(z) == pytest.approx([1.01, 1.0])
    assert np.degrees(place.headings) == pytest.approx([-2.0, -2.0])
    assert place.heights == pytest.approx([0.4, 0.4])


def test_a_vertical_channel_has_no_heading() -> None:
    layout = biaxial_layout("tower", turbine="one", unit="tower", elevations=(80.0,))
    upright = replace(layout.channels[0], name="z80-up", direction=(0.0, 0.0, 1.0))
    layout = replace(layout, channels=(*layout.channels, upright))
    heading = next(each for each in sensor_figures(layout) if each.kind == "heading")
    height = next(each for each in sensor_figures(layout) if each.kind == "height")
    assert heading.channels == (0, 1)
    assert height.channels == (0, 1, 2)


def test_slopes_of_what_channels_read_are_those_of_differences() -> None:
    """Readings that change linearly along and across the axes: a channel with a gain turns and
    rises with it."""
    sensors = SensorReadings(FIGURES, 2)
    stated = np.array([[1.0, 0.4], [-0.3, 1.0]])
    by_heading, by_height = (
        np.array([[0.2, 1.0], [0.9, -0.3]]),
        np.array([[0.05, 0.02], [0.1, -0.07]]),
    )

    def placed(z: np.ndarray) -> np.ndarray:
        place = sensors.placement(z)
        return stated + by_heading * place.headings + by_height * place.heights

    z = np.array([20.0, 1.5, -3.0])  # a gain a fifth too high: far beyond its own deviation
    slopes = sensors.slopes(z, placed(z), by_heading, by_height)
    for column, step in enumerate(1e-5 * np.eye(3)):
        after, before = (sensors.gains(each) * placed(each) for each in (z + step, z - step))
        np.testing.assert_allclose(slopes[..., column], (after - before) / 2e-5, atol=1e-9)
