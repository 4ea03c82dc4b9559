"""An accelerometer reads the structure's acceleration, and gravity where the tower tilts."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.layout import LayoutError, biaxial_layout
from sensors.structure.assembly import assemble
from sensors.structure.sensor_readings import ChannelReadings
from tests.sensors.structure.towers import uniform_layout, uniform_tower

MOON = 1.625  # [m/s²]


def test_the_gravity_that_a_tilted_sensor_reads_is_the_towers_own() -> None:
    """A rigid tilt ψ about the base: u = ψ z, and g ψ at every height."""
    for gravity in (0.0, MOON, 9.81):
        model = assemble(uniform_tower(gravity=gravity))
        layout = uniform_layout()
        observation = ChannelReadings.of(model, layout)
        motion = np.zeros(model.n_dofs)
        for elevation, dofs in zip(model.elevations, model.tower_dofs, strict=True):
            kept = dofs < model.n_dofs  # heave and twist of the base are fixed
            motion[dofs[kept]] = np.array([elevation, 1.0, 0, 0, 0, 0])[kept]
        fore_aft = layout.directions[:, 0]
        assert observation.displacement @ motion == pytest.approx(layout.elevations * fore_aft)
        assert observation.gravity_slope @ motion == pytest.approx(gravity * fore_aft, abs=1e-12)


def test_a_shape_as_read_is_its_displacement_plus_tilt_over_omega_squared() -> None:
    """u'' − g ψ = −ω² (φ + g ψ / ω²): at half the frequency the tilt counts four times as much."""
    observation = ChannelReadings(
        displacement=np.array([[1.0], [0.5]]),
        gravity_slope=np.array([[0.0], [0.1]]),
        corner_frequencies=np.zeros(2),
    )
    vectors = np.ones((1, 1))
    for omega in (0.5, 1.0, 2.0):
        (shape,) = observation.shapes(vectors, np.array([omega**2]))
        assert shape == pytest.approx([1.0, 0.5 + 0.1 / omega**2])


def test_an_ac_coupled_sensor_lags_and_weakens_near_its_corner() -> None:
    """First-order high pass: gain 1/√2 at the corner, all above it."""
    coupled = ChannelReadings(np.ones((2, 1)), np.zeros((2, 1)), np.array([0.0, 0.1]))
    at_corner, above = (
        coupled.shapes(np.ones((1, 1)), np.array([(2 * np.pi * f) ** 2]))[0] for f in (0.1, 10.0)
    )
    assert at_corner == pytest.approx([1.0, 0.5])  # Re 1/(1 − j)
    assert above == pytest.approx([1.0, 1.0], abs=1e-3)


def test_a_sensor_that_is_not_on_the_tower_is_named() -> None:
    layout = biaxial_layout("high", turbine="uniform", unit="tower", elevations=[120.0])
    with pytest.raises(LayoutError, match=r"elevation 120 m is not on the tower .* 0 to 100 m"):
        ChannelReadings.of(assemble(uniform_tower()), replace(layout))
