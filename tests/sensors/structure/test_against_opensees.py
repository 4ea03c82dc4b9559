"""Tower and monopile on their springs against OpenSees, where it is installed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy.linalg import eigh

from sensors.structure.assembly import added_mass, assemble, wetted_share
from sensors.structure.components import RigidBody, RotorNacelle
from sensors.structure.description import TurbineDescription
from tests.sensors.structure.towers import parked_turbine

TOP = RigidBody("rotor-nacelle", mass=1.0166e6, centre=(0.0, 0.0, 4.2), inertia=(2e8, 2e8, 0.0))


def with_a_lumped_top() -> TurbineDescription:
    """The turbine with a rigid top instead of its rotor, weightless, water up to a node."""
    return replace(
        parked_turbine().with_water_level(1.5),
        gravity=0.0,
        blades=None,
        rotor_nacelle=RotorNacelle(bodies=(TOP,)),
        reference_modes=(),
    )


def opensees_frequencies(ops: Any, turbine: TurbineDescription, count: int) -> np.ndarray:
    """Lowest in-plane frequencies [Hz]; the springs as one above the mudline and a rotary one."""
    k11, k22, k12 = turbine.nominal
    ops.wipe()
    ops.model("basic", "-ndm", 2, "-ndf", 3)
    levels = [turbine.mudline, *(tube.top for tube in turbine.tubes)]
    for number, level in enumerate(levels):
        ops.node(number, 0.0, level)
    ops.geomTransf("Linear", 1)
    for i, tube in enumerate(turbine.tubes):
        assert wetted_share(tube, turbine.water) in (0.0, 1.0)
        wet = added_mass(tube, turbine.water) * wetted_share(tube, turbine.water)
        section = (1e3 * tube.area, tube.youngs_modulus, tube.second_moment)  # axially rigid
        mass = ("-mass", tube.mass_per_length + wet, "-cMass")
        ops.element("elasticBeamColumn", i, i, i + 1, *section, 1, *mass)
    arm, ground, top = 1000, 1001, 1002
    for node, level in ((arm, turbine.mudline + k12 / k11), (ground, turbine.mudline + k12 / k11)):
        ops.node(node, 0.0, level)
    ops.node(top, 0.0, turbine.tower_top + TOP.centre[2])
    ops.mass(top, TOP.mass, TOP.mass, TOP.inertia[1])
    ops.rigidLink("beam", 0, arm)
    ops.rigidLink("beam", len(levels) - 1, top)
    ops.fix(0, 0, 1, 0)
    ops.fix(ground, 1, 1, 1)
    ops.uniaxialMaterial("Elastic", 1, k11)
    ops.uniaxialMaterial("Elastic", 2, k22 - k12**2 / k11)
    ops.element("zeroLength", 2000, ground, arm, "-mat", 1, 2, "-dir", 1, 6)
    ops.constraints("Transformation")
    squares = np.array(ops.eigen("-fullGenLapack", count))
    return np.sqrt(squares) / (2 * np.pi)


@pytest.mark.peer
def test_tower_monopile_and_springs_have_the_frequencies_opensees_finds() -> None:
    try:
        import openseespy.opensees as ops
    except (ImportError, RuntimeError) as error:  # it raises RuntimeError without its libraries
        pytest.skip(f"openseespy cannot be imported: {error}")
    turbine = with_a_lumped_top()
    model = assemble(turbine)
    flexibilities = eigh(model.mass, model.stiffness, eigvals_only=True)
    mine = 1 / (2 * np.pi * np.sqrt(flexibilities))  # both planes, heave and twist too
    theirs = opensees_frequencies(ops, turbine, 8)
    nearest = mine[np.abs(mine[:, None] / theirs - 1).argmin(axis=0)]
    assert nearest == pytest.approx(theirs, rel=1e-6)
