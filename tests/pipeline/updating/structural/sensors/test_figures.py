"""What gain, heading and height of a sensor do to what it reads."""

import numpy as np
import pytest

from pipeline.updating.structural.sensors.figures import SensorFigure, SensorReadings

FIGURES = (
    SensorFigure("gain", "a", "-", 0.01, (0,)),
    SensorFigure("heading", "80 m", "deg", 2.0, (0, 1)),
    SensorFigure("height", "80 m", "m", 0.2, (0, 1)),
)


def test_a_figure_one_standard_deviation_off_is_off_by_its_own_unit() -> None:
    state = SensorReadings(FIGURES, 2).state(np.array([1.0, -1.0, 2.0]))
    assert state.gains == pytest.approx([1.01, 1.0])
    assert np.degrees(state.headings) == pytest.approx([-2.0, -2.0])
    assert state.heights == pytest.approx([0.4, 0.4])
