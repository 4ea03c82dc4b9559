"""The exact modal integration against closed forms and independent integrators."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.signal import cont2discrete, lsim

from sensors.arrays import FloatArray
from sensors.dynamics.responses.modal_response import AccelerationResponse
from sensors.dynamics.responses.oscillators import ModalOscillators, first_order_hold
from sensors.dynamics.simulated_modes import ModalDamping, ObservedModes, structure_modes
from sensors.structure.assembly import assemble
from sensors.structure.description import load_turbine
from sensors.structure.foundation import TurbineError

RATE = 120.0  # [Hz]


def observed(
    frequencies: list[float],
    damping_ratio: float = 0.01,
    *,
    rotation: float = 0.0,
    corner_frequency: float = 0.0,
) -> ObservedModes:
    """Modes that one load excites and one channel observes, all with unit participation."""
    n = len(frequencies)
    return ObservedModes(
        frequencies=np.array(frequencies),
        damping_ratios=np.full(n, damping_ratio),
        participation=np.ones((n, 1)),
        displacement=np.ones((1, n)),
        rotation=np.full((1, n), rotation),
        corner_frequencies=np.array([corner_frequency]),
        gravity=9.81,
    )


def states(frequency: float, damping_ratio: float, forces: FloatArray) -> tuple[FloatArray, ...]:
    """q, q', q'' of one oscillator under a sampled force, each (n_samples,)."""
    oscillator = ModalOscillators(np.array([frequency]), np.array([damping_ratio]), RATE)
    w = oscillator.advance(forces[None, :])[0]
    past = np.stack([w[2:], w[1:-1], w[:-2]])
    return (
        oscillator.displacement_taps[0] @ past,
        oscillator.velocity_taps[0] @ past,
        oscillator.acceleration_taps[0] @ past,
    )


@pytest.mark.parametrize("frequency", [0.157, 2.6, 12.1, 55.0])
def test_the_recursion_equals_lsim_under_a_random_force(frequency: float) -> None:
    force = np.random.default_rng(4).standard_normal(3000)
    force[0] = 0.0
    omega, zeta = 2 * np.pi * frequency, 0.008
    system = ([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]], [[0.0], [1.0]], np.eye(2), [[0], [0]])
    _, expected, _ = lsim(system, force, np.arange(3000) / RATE, interp=True)
    q, velocity, acceleration = states(frequency, zeta, force)
    np.testing.assert_allclose(q, expected[:, 0], atol=1e-9 * np.abs(expected[:, 0]).max())
    np.testing.assert_allclose(velocity, expected[:, 1], atol=1e-9 * np.abs(expected[:, 1]).max())
    equilibrium = force - 2 * zeta * omega * expected[:, 1] - omega**2 * expected[:, 0]
    np.testing.assert_allclose(acceleration, equilibrium, atol=1e-9 * np.abs(equilibrium).max())


def test_the_propagators_are_those_of_the_triangle_hold() -> None:
    omega, zeta = 2 * np.pi * 3.0, 0.02
    propagator, gamma_0, gamma_1 = first_order_hold(np.array([omega]), np.array([zeta]), 1 / RATE)
    continuous = (
        np.array([[0.0, 1.0], [-(omega**2), -2 * zeta * omega]]),
        np.array([[0.0], [1.0]]),
        np.eye(2),
        np.zeros((2, 1)),
    )
    A, B, _, D, _ = cont2discrete(continuous, 1 / RATE, method="foh")
    # SciPy's state has the force at its sample taken out: ξ = x − Γ1 p
    np.testing.assert_allclose(propagator[0], A, rtol=1e-12)
    np.testing.assert_allclose(gamma_1[0], D[:, 0], rtol=1e-9)
    np.testing.assert_allclose(gamma_0[0] + propagator[0] @ gamma_1[0], B[:, 0], rtol=1e-9)


def test_a_force_that_runs_straight_between_samples_leaves_no_integration_error() -> None:
    force = np.array([0.0, 1.0, -0.4, 0.8, 0.0, 0.0, 0.0])
    times = np.arange(len(force)) / RATE
    omega, zeta = 2 * np.pi * 20.0, 0.01

    def derivative(t: float, x: FloatArray) -> list[float]:
        return [x[1], np.interp(t, times, force) - 2 * zeta * omega * x[1] - omega**2 * x[0]]

    fine = solve_ivp(
        derivative, (0, times[-1]), [0.0, 0.0], t_eval=times, rtol=1e-10, atol=1e-16, max_step=1e-4
    )
    q, velocity, _ = states(20.0, zeta, force)
    np.testing.assert_allclose(q, fine.y[0], atol=1e-6 * np.abs(q).max())
    np.testing.assert_allclose(velocity, fine.y[1], atol=1e-6 * np.abs(velocity).max())


def test_an_oscillator_under_white_noise_has_the_closed_form_variance() -> None:
    """σ² = π S0 / (2 ζ ω³) with S0 two-sided per rad/s, of an oscillator well below the band."""
    frequency, zeta, n = 3.0, 0.02, 2_000_000
    q, _, _ = states(frequency, zeta, np.random.default_rng(11).standard_normal(n))
    two_sided_per_radian = 1.0 / (2 * np.pi * RATE)
    omega = 2 * np.pi * frequency
    held = np.sinc(frequency / RATE) ** 4  # what the straight lines leave of the spectrum there
    expected = held * np.pi * two_sided_per_radian / (2 * zeta * omega**3)
    independent = n / RATE * zeta * omega  # decay times in the record: the variance's scatter
    assert np.var(q[20_000:]) == pytest.approx(expected, rel=4 * np.sqrt(2 / independent))


def test_frequency_response_gives_the_variance_that_the_recursion_has() -> None:
    oscillator = ModalOscillators(np.array([3.0]), np.array([0.02]), RATE)
    frequencies = np.linspace(0.0, 60.0, 600_001)
    response = oscillator.frequency_response(oscillator.displacement_taps, frequencies)[:, 0]
    spectral = np.trapezoid(np.abs(response) ** 2, frequencies) * 2 / RATE
    impulse = np.zeros(60_000)
    impulse[0] = 1.0
    q, _, _ = states(3.0, 0.02, impulse)  # Parseval: the sum over the impulse response
    assert spectral == pytest.approx(np.sum(q**2), rel=1e-6)


def test_energy_lost_in_free_decay_is_the_work_of_the_damper() -> None:
    frequency, zeta = 0.5, 0.01
    force = np.zeros(24_000)
    force[:60] = np.sin(np.pi * np.arange(60) / 60)  # a push of half a second, then nothing
    q, velocity, _ = states(frequency, zeta, force)
    omega = 2 * np.pi * frequency
    energy = 0.5 * velocity**2 + 0.5 * omega**2 * q**2
    power = 2 * zeta * omega * velocity**2
    free = slice(61, None)
    lost = energy[61] - energy[-1]
    assert np.all(np.diff(energy[free]) < 1e-3 * energy[61] / RATE)
    assert np.trapezoid(power[free], dx=1 / RATE) == pytest.approx(lost, rel=1e-3)
    assert lost == pytest.approx(energy[61], rel=1e-3)  # after 200 s nothing is left


def test_no_force_means_no_motion() -> None:
    response = AccelerationResponse(observed([0.2, 3.0]), RATE)
    assert not response.advance(np.zeros((100, 1))).any()


def test_readings_do_not_depend_on_the_chunks_they_are_computed_in() -> None:
    forces = np.random.default_rng(2).standard_normal((1000, 1))
    modes = observed([0.16, 1.1, 12.0], rotation=0.01, corner_frequency=0.1)
    whole = AccelerationResponse(modes, RATE).advance(forces)
    response = AccelerationResponse(modes, RATE)
    pieces = [response.advance(piece) for piece in np.split(forces, [1, 2, 10, 400])]
    np.testing.assert_allclose(np.concatenate(pieces), whole, atol=1e-9 * np.abs(whole).max())


def test_a_resting_tilt_is_read_as_gravity() -> None:
    """Long after a constant force is applied only −g·ψ is left."""
    frequency, psi = 1.0, 0.02
    response = AccelerationResponse(observed([frequency], 0.1, rotation=psi), RATE)
    readings = response.advance(np.ones((6000, 1)))
    static = 1.0 / (2 * np.pi * frequency) ** 2
    assert readings[-1, 0] == pytest.approx(-9.81 * psi * static, rel=1e-6)


def test_a_mode_is_read_as_displacement_plus_gravity_over_omega_squared() -> None:
    """u'' − g ψ = −ω² (φ + g ψ / ω²) q for harmonic motion."""
    frequency, psi = 0.157, 0.01
    with_tilt = AccelerationResponse(observed([frequency], rotation=psi), RATE)
    without = AccelerationResponse(observed([frequency]), RATE)
    at_resonance = np.array([frequency])
    ratio = with_tilt.frequency_response(at_resonance) / without.frequency_response(at_resonance)
    omega = 2 * np.pi * frequency
    assert ratio.real.item() == pytest.approx(1 + 9.81 * psi / omega**2, rel=1e-4)
    assert abs(ratio.imag.item()) < 1e-4


def test_an_ac_coupled_axis_loses_what_lies_below_its_corner() -> None:
    dc = AccelerationResponse(observed([1.0], 0.1, rotation=0.1), RATE)
    ac = AccelerationResponse(observed([1.0], 0.1, rotation=0.1, corner_frequency=0.1), RATE)
    frequencies = np.array([0.001, 0.1, 5.0])
    gain = np.abs(ac.frequency_response(frequencies) / dc.frequency_response(frequencies)).ravel()
    np.testing.assert_allclose(gain, [0.01, np.sqrt(0.5), 1.0], rtol=1e-3)
    assert abs(ac.advance(np.ones((12_000, 1)))[-1, 0]) < 1e-3 * abs(
        dc.advance(np.ones((12_000, 1)))[-1, 0]
    )


def test_frequency_response_is_that_of_the_sampled_readings() -> None:
    modes = observed([0.9, 7.0], 0.03, rotation=0.02, corner_frequency=0.2)
    impulse = np.zeros((2**15, 1))
    impulse[0] = 1.0
    readings = AccelerationResponse(modes, RATE).advance(impulse)[:, 0]
    frequencies = np.fft.rfftfreq(2**15, 1 / RATE)
    response = AccelerationResponse(modes, RATE).frequency_response(frequencies).sum(axis=2)[:, 0]
    np.testing.assert_allclose(np.fft.rfft(readings), response, atol=1e-9 * np.abs(response).max())


def test_modes_are_mass_normalised_and_solve_the_full_equation() -> None:
    model = assemble(load_turbine("iea15mw_monopile"), tube_refinement=2)
    modes = structure_modes(model, ModalDamping(), highest_frequency=20.0)
    modal_mass = modes.shapes.T @ model.mass @ modes.shapes
    np.testing.assert_allclose(modal_mass, np.eye(len(modal_mass)), atol=1e-8)
    squares = (2 * np.pi * modes.frequencies) ** 2
    modal_stiffness = modes.shapes.T @ model.stiffness @ modes.shapes
    np.testing.assert_allclose(np.diag(modal_stiffness), squares, rtol=1e-8)
    assert np.all(np.diff(modes.frequencies) >= 0)


def test_a_tower_too_soft_to_stand_is_refused_with_its_springs() -> None:
    soft = assemble(load_turbine("iea15mw_monopile"), stiffness=(1e6, 1e8, 1e3))
    with pytest.raises(TurbineError, match=r"1e\+06, 1e\+08, 1000.*unstable"):
        structure_modes(soft, ModalDamping(), highest_frequency=60.0)


@pytest.mark.parametrize("ratio", [0.0, 1.0, -0.01])
def test_a_damping_ratio_outside_0_to_1_is_refused(ratio: float) -> None:
    with pytest.raises(TurbineError, match=f"blades is {ratio:g}"):
        ModalDamping(blades=ratio)
