"""How the model's modes move with the water, where some of them are not seen at another level."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from pipeline.updating.structural.joint_model import JointModel
from sensors.arrays import FloatArray

SHAPES = np.array([[1.0, 0.4, -0.3], [1.0, 0.5, -0.2], [0.2, 1.0, 0.6]])
FREQUENCIES = np.array([12.11, 12.49, 14.0])  # the first two: alike, 3 % apart
SLOPES = np.array([-0.0005, -0.001, -0.008])  # ∂ ln f / ∂ level [1/m]
CURVATURES = np.array([0.0, 0.0, 0.0005])  # [1/m²]


class Model(JointModel):
    """Three modes on their parabolas, some of which are missing a metre lower or higher."""

    def __init__(self, missing: dict[float, list[int]]) -> None:
        self.missing = missing

    def _at_level(self, u: FloatArray, rise: float) -> Any:
        kept = [mode for mode in range(3) if mode not in self.missing.get(rise, [])]
        moved = FREQUENCIES * np.exp(SLOPES * rise + CURVATURES * rise**2)
        return SimpleNamespace(frequencies=moved[kept], shapes=SHAPES[kept])


def partners(missing: dict[float, list[int]]) -> list[Any]:
    model, u = Model(missing), np.zeros(1)
    return model.partners_in_water(u, model._at_level(u, 0.0))


def test_modes_have_their_slope_and_curvature() -> None:
    for mode, partner in enumerate(partners({})):
        assert partner.curve == pytest.approx([SLOPES[mode], CURVATURES[mode]], abs=1e-12)


@pytest.mark.parametrize("rise", [-1.0, 1.0])
def test_a_mode_that_is_not_seen_at_one_level_goes_straight_on_there(rise: float) -> None:
    """Its neighbour of like shape is no continuation: it would seem to move by 3 % a metre."""
    first, second, third = partners({rise: [1]})
    assert first.curve == pytest.approx([SLOPES[0], 0.0], abs=1e-12)
    assert second.curve == pytest.approx([SLOPES[1], 0.0], abs=1e-12)
    assert second.shapes[int(rise) + 1] == pytest.approx(SHAPES[1])
    assert third.curve == pytest.approx([SLOPES[2], CURVATURES[2]], abs=1e-12)
