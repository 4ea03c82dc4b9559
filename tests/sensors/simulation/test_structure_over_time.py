"""What the simulated structure reports of itself while it changes."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sensors.simulation.structure_over_time import ChangingStructure, rms_motion


@pytest.mark.parametrize("across", [0.0, 0.6, 1.0])
def test_the_mudlines_motion_is_that_of_both_directions_together(across: float) -> None:
    """An ellipse with half axes of 1 and `across`: half of the sum of their squares."""
    angle = 2 * np.pi * np.arange(1000) / 1000
    model = SimpleNamespace(n_dofs=6, spring_dofs=np.array([[0, 4], [1, 3]]))

    def displacements(rows: np.ndarray) -> np.ndarray:
        dofs = np.zeros((6, len(angle)))
        dofs[0], dofs[1], dofs[4] = np.cos(angle), across * np.sin(angle) + 5.0, 3.0 * angle
        return rows @ dofs

    response = cast(Any, SimpleNamespace(displacements=displacements))
    structure = cast(Any, SimpleNamespace(model=model))
    motion = ChangingStructure.mudline(structure, response)
    expected = pytest.approx(np.sqrt((1 + across**2) / 2))
    assert [rms_motion([motion]), rms_motion(np.split(motion, [300], axis=1))] == [expected] * 2
