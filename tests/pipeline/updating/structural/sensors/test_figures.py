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
