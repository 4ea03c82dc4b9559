"""The angle by which all sensors are turned, from the shapes of paired modes."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.updating.structural.sensors.turned_layouts import ANGLES, turned_macs


@pytest.mark.parametrize("angle", [0.0, 23.0, -71.0, 89.0])
def test_shapes_of_turned_sensors_are_those_of_their_partners_at_that_angle(angle: float) -> None:
    """Three modes at three heights, two sensors each; one component is not known, the second mode
    is one of a close pair, whose shape is not compared, and sensors stood a degree or two off."""
    rng = np.random.default_rng(4)
    motion = rng.standard_normal((3, 3, 2))  # (n_modes, n_heights, x and y)
    headings = np.radians(rng.normal(0.0, 2.0, 3))

    def read(turn: np.ndarray | float) -> np.ndarray:
        """By sensors along x and y, turned."""
        c, s = np.cos(turn), np.sin(turn)
        x, y = motion[..., 0], motion[..., 1]
        return np.stack([c * x + s * y, c * y - s * x], axis=-1).reshape(3, 6)

    step = 1e-6
    modes = SimpleNamespace(
        readings=read(headings),
        by_heading=(read(headings + step) - read(headings - step)) / (2 * step),
    )
    used = [
        SimpleNamespace(identified=n, model_modes=(n,), shape_used=n == 0, shape_unlike=n == 2)
        for n in range(3)
    ]
    measured = np.hstack([np.ones((3, 1)), -3.0 * read(np.radians(angle))])
    measured[2, 4] = np.nan
    evidence: Any = SimpleNamespace(modes=[SimpleNamespace(mean=row) for row in measured])
    peak: Any = SimpleNamespace(comparison=SimpleNamespace(linearisation=modes, used=used))
    found = turned_macs(evidence, peak, np.repeat(headings, 2))
    assert found.shape == (2, len(ANGLES))
    np.testing.assert_allclose(found.max(axis=1), 1.0, atol=1e-9)
    np.testing.assert_array_equal(ANGLES[found.argmax(axis=1)], angle)
