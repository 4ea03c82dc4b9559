"""Sensors are fixed to the tower; fore-aft follows the nacelle."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.nodes.operating_state import in_nacelle_axes
from sensors.acquisition.layout import SensorLayout, turning_matrix
from sensors.errors import InputError
from tests.pipeline.example_estimates import estimate, mode
from tests.pipeline.example_messages import LAYOUT


def test_shapes_of_a_yawed_nacelle_are_turned_back_to_its_axes() -> None:
    """A purely fore-aft mode, seen by sensors fixed to a tower under a nacelle yawed by 30°."""
    along = np.array([0.2, 0.4, 0.6, 1.0])
    angle = np.radians(30.0)
    seen = np.concatenate([along * np.cos(angle), along * np.sin(angle)])
    yawed = replace(estimate(mode(0.16, seen)), yaw=30.0)
    (turned,) = in_nacelle_axes(yawed, LAYOUT).modes
    np.testing.assert_allclose(turned.shape, [*along, 0, 0, 0, 0], atol=1e-12)
    assert turned.shape_std[turned.unit_component] == 0.0
    assert in_nacelle_axes(estimate(mode(0.16, seen)), LAYOUT).modes[0].shape[0] < 0.3


def test_a_turn_by_yaw_and_back_changes_nothing() -> None:
    there, back = turning_matrix(LAYOUT, 37.0), turning_matrix(LAYOUT, -37.0)
    np.testing.assert_allclose(there @ back, np.eye(8), atol=1e-12)


def test_one_axis_at_a_height_cannot_be_turned() -> None:
    single = SensorLayout("one", "t1", "tower", LAYOUT.channels[:1])
    with pytest.raises(InputError, match="one direction only at 41 m"):
        turning_matrix(single, 10.0)


@pytest.mark.parametrize("yaw", [0.0, 360.0, -360.0])
def test_a_nacelle_along_the_towers_axis_is_not_turned(yaw: float) -> None:
    """Nor does it need two axes at a height."""
    single = SensorLayout("one", "t1", "tower", LAYOUT.channels[:1])
    along = replace(estimate(mode(0.16, np.ones(1))), channels=(LAYOUT.channels[0].name,), yaw=yaw)
    assert in_nacelle_axes(along, single) is along
