"""What the simulated structure reports of itself while it changes."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.simulated_modes import structure_modes
from sensors.simulation.schedule import FoundationSchedule, StiffnessEvent
from sensors.simulation.structure_over_time import ChangingStructure, rms_motion
from sensors.simulation.tower import SimulatedTower, SimulationSettings
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine


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


def test_the_structure_changes_at_an_event_and_is_the_changed_ones_then() -> None:
    """The springs lose 30 %: the poles are those of a tower on such springs, and not before."""
    turbine = load_turbine("iea15mw_monopile")
    layout = biaxial_layout("l", turbine="t1", unit="tower", elevations=(41, 145))
    weaker = FoundationSchedule(events=(StiffnessEvent(10.0, (0.7, 0.7, 0.7)),))
    tower = SimulatedTower(turbine, layout, SimulationSettings(duration=20.0, foundation=weaker))
    structure = tower._structure
    whole, changed = (np.sort(structure.at(time).poles.imag) for time in (0.0, 15.0))
    np.testing.assert_allclose(whole[:2] / 2 / np.pi, structure.modes.frequencies[:2], rtol=1e-3)
    assert changed[0] < 0.99 * whole[0]
    weak = assemble(
        turbine, stiffness=0.7 * structure._stiffness, tube_refinement=structure._refinement
    )
    expected = structure_modes(
        weak, structure._damping, highest_frequency=structure._highest_frequency
    )
    np.testing.assert_allclose(changed[:6] / 2 / np.pi, expected.frequencies[:6], rtol=1e-3)
