"""Complex modes of a structure with any damping: against white noise, energy, full matrices."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from sensors.acquisition.layout import biaxial_layout
from sensors.dynamics.damped_modes import DampedSystem, damped_system
from sensors.dynamics.responses.damped_response import DampedResponse
from sensors.dynamics.responses.modal_response import AccelerationResponse
from sensors.dynamics.simulated_modes import (
    ModalDamping,
    ObservedModes,
    StructureModes,
    observed_modes,
    structure_modes,
)
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.foundation import TurbineError
from sensors.structure.sensor_readings import ChannelReadings
from sensors.structure.structural_model import StructuralModel

TURBINE = load_turbine("iea15mw_monopile")
LAYOUT = biaxial_layout("four", turbine="t", unit="u", elevations=(41.0, 80.0, 106.0, 145.0))


@cache
def tower_modes() -> tuple[StructuralModel, StructureModes, ObservedModes]:
    """The tower, its modes below 30 Hz, and forces at some of its nodes."""
    model = assemble(TURBINE)
    modes = structure_modes(model, ModalDamping(), highest_frequency=30.0)
    forces = np.zeros((model.n_dofs, 4))
    forces[model.tower_dofs[[3, 8, 14, 20], [0, 2, 0, 2]], range(4)] = 1.0
    return model, modes, observed_modes(model, modes, LAYOUT, forces)


def oscillator(frequency: float, damping_ratio: float) -> DampedSystem:
    """One mode of mass 1 with a unit load on it, read as acceleration without tilt."""
    omega = 2 * np.pi * frequency
    pole = omega * (-damping_ratio + 1j * np.sqrt(1 - damping_ratio**2))
    damping = 2 * damping_ratio * omega
    one = np.ones((1, 1))
    modes = ObservedModes(
        np.array([frequency]), np.array([damping_ratio]), one, one, 0 * one, np.zeros(1), 9.81
    )
    vector = one / np.sqrt(2 * pole + damping)
    return DampedSystem(np.array([pole]), vector, np.array([[damping]]), modes, one, one)


def test_hardly_damped_modes_read_the_shapes_of_the_undamped_structure_tilt_included() -> None:
    """φ + g ψ / ω², the first modes' by a quarter more at 41 m."""
    model = assemble(TURBINE)
    modes = structure_modes(model, ModalDamping(1e-9, 1e-9), highest_frequency=3.0)
    observed = observed_modes(model, modes, LAYOUT, np.zeros((model.n_dofs, 1)))
    squares = (2 * np.pi * modes.frequencies) ** 2
    expected = ChannelReadings.of(model, LAYOUT).shapes(modes.shapes.T, squares)
    for ours, theirs in zip(damped_system(model, modes, observed).readings, expected, strict=True):
        unit = np.argmax(np.abs(theirs))
        np.testing.assert_allclose(ours / ours[unit], theirs / theirs[unit], atol=1e-6)


def test_an_ac_coupled_channel_reads_motion_at_its_corner_by_half_the_power_an_eighth_early() -> (
    None
):
    """iω / (iω + ω_c) = (1 + i) / 2 at ω = ω_c."""
    direct = oscillator(0.5, 1e-9)
    coupled = replace(direct, modes=replace(direct.modes, corner_frequencies=np.array([0.5])))
    assert coupled.readings / direct.readings == pytest.approx(np.full((1, 1), 0.5 + 0.5j))


def test_an_oscillator_under_white_noise_has_the_variance_of_theory() -> None:
    """σ² = π S₀ / (2 ζ ω³ m²), S₀ two-sided per rad/s; a band of many bandwidths is white enough.
    2 hours at 0.5 Hz and ζ 5 %, seed 6: the variance scatters by √(1/(ζ ω T))."""
    frequency, zeta, rate, n = 0.5, 0.05, 50.0, 360_000
    response = DampedResponse(oscillator(frequency, zeta), rate)
    force = np.random.default_rng(6).standard_normal((n, 1))
    response.advance(force)
    displacement = response.displacements(np.ones((1, 1)))[0]
    omega = 2 * np.pi * frequency
    two_sided = 1.0 / rate / (2 * np.pi)  # of unit variance samples [N²·s/rad]
    expected = np.pi * two_sided / (2 * zeta * omega**3)
    scatter = np.sqrt(1 / (zeta * omega * n / rate))
    assert np.var(displacement) == pytest.approx(expected, rel=4 * scatter)


def test_without_load_an_oscillator_loses_the_energy_that_its_damper_takes() -> None:
    """E(t) + ∫ c q'² dt stays what it was; the motion started by one kick."""
    frequency, zeta, rate = 0.5, 0.02, 200.0
    omega = 2 * np.pi * frequency
    response = DampedResponse(oscillator(frequency, zeta), rate)
    kick = np.zeros((4000, 1))
    kick[0] = 1.0
    acceleration = response.advance(kick)[:, 0]
    q = response.displacements(np.ones((1, 1)))[0]
    velocity = -(acceleration[2:] + omega**2 * q[2:]) / (2 * zeta * omega)  # q'' + c q' + ω² q = 0
    energy = 0.5 * velocity**2 + 0.5 * (omega * q[2:]) ** 2
    power = 2 * zeta * omega * velocity**2
    taken = np.concatenate([[0.0], np.cumsum(0.5 * (power[1:] + power[:-1])) / rate])
    np.testing.assert_allclose(energy + taken, energy[0], rtol=1e-4)
    assert energy[-1] < 0.1 * energy[0]


def test_a_damped_system_without_dampers_is_the_modal_one() -> None:
    """Two recursions, two poles or one complex one a mode: the same readings and gains."""
    model, modes, observed = tower_modes()
    rate = 60.0
    plain, damped = (
        AccelerationResponse(observed, rate),
        DampedResponse(damped_system(model, modes, observed), rate),
    )
    force = np.random.default_rng(2).standard_normal((500, observed.participation.shape[1]))
    expected = plain.advance(force)
    found = np.concatenate([damped.advance(force[:123]), damped.advance(force[123:])])
    np.testing.assert_allclose(found, expected, atol=1e-8 * np.abs(expected).max())
    f = np.linspace(0.05, 25.0, 40)
    gains = plain.gains(f)
    np.testing.assert_allclose(damped.gains(f), gains, atol=1e-8 * np.abs(gains).max())


def test_dampers_enter_as_in_the_direct_solution_of_the_full_matrices() -> None:
    """(K + iω(C + D) − ω²M) u = f with D not proportional, against the complex modes."""
    model, _, _ = tower_modes()
    modes = structure_modes(model, ModalDamping(), highest_frequency=1e6)
    dampers = np.zeros_like(model.mass)
    top = model.tower_dofs[-1, 0]
    dampers[top, top] = 2e5  # [N·s/m]
    force = np.zeros((model.n_dofs, 1))
    force[model.tower_dofs[3, 0]] = 1.0
    observed = observed_modes(model, modes, LAYOUT, force)
    system = damped_system(model, modes, observed, dampers)
    momentum = model.mass @ modes.shapes
    proportional = (momentum * (4 * np.pi * modes.damping_ratios * modes.frequencies)) @ momentum.T
    for frequency in (0.1, 0.16, 1.1):
        omega = 2 * np.pi * frequency
        dynamic = model.stiffness + 1j * omega * (proportional + dampers)
        u = np.linalg.solve(dynamic - omega**2 * model.mass, force[:, 0])
        z = [
            vectors.T @ observed.participation[:, 0] / (1j * omega - poles)
            for vectors, poles in (
                (system.vectors, system.poles),
                (system.vectors.conj(), system.poles.conj()),
            )
        ]
        q = system.vectors @ z[0] + system.vectors.conj() @ z[1]
        displacement = modes.shapes @ q
        tower = model.tower_dofs[:, 0]
        largest = np.abs(u[tower]).max()
        np.testing.assert_allclose(displacement[tower], u[tower], atol=1e-6 * largest)


def test_a_structure_that_changes_into_itself_goes_on_undisturbed() -> None:
    model, modes, observed = tower_modes()
    same = damped_system(model, modes, observed)
    whole, cut = DampedResponse(same, 60.0), DampedResponse(same, 60.0)
    force = np.random.default_rng(2).standard_normal((400, observed.participation.shape[1]))
    expected = whole.advance(force)
    first = cut.advance(force[:200])
    cut.change(damped_system(model, modes, observed))
    found = np.concatenate([first, cut.advance(force[200:])])
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())


def test_displacement_and_velocity_go_on_when_the_foundation_gives_way() -> None:
    """At the moment of a 10 % loss of k22 the tower's displacement does not jump."""
    model, modes, observed = tower_modes()
    softer = assemble(TURBINE, stiffness=TURBINE.nominal * [1.0, 0.9, 1.0])
    changed = structure_modes(softer, ModalDamping(), highest_frequency=30.0)
    response = DampedResponse(damped_system(model, modes, observed), 60.0)
    force = np.zeros((600, observed.participation.shape[1]))
    force[0] = 1.0
    rows = np.zeros((1, model.n_dofs))
    rows[0, model.tower_dofs[-1, 0]] = 1.0
    response.advance(force)
    before = response.displacements(rows)[0]
    again = observed_modes(softer, changed, LAYOUT, np.zeros((model.n_dofs, 4)))
    response.change(damped_system(softer, changed, again))
    response.advance(np.zeros((600, 4)))
    after = response.displacements(rows)[0]
    step = np.abs(np.diff(before)).max()
    assert abs(after[0] - before[-1]) < 1.5 * step


def test_a_structure_with_dampers_too_strong_to_swing_is_refused() -> None:
    model, modes, observed = tower_modes()
    with pytest.raises(TurbineError, match="overdamped"):
        damped_system(model, modes, observed, 1e9 * np.eye(model.n_dofs))
