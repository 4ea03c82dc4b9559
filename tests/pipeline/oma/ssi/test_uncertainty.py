"""First-order deviations of poles and shapes: two routes to one number."""

import numpy as np
import pytest

from pipeline.modal_assurance import modal_phase_collinearity, normalised_with_deviations
from pipeline.oma.ssi.ssi_cov import (
    LagCovariances,
    SignalSubspace,
    SystemModes,
    lag_covariances,
    signal_subspace,
    system_modes,
)
from pipeline.oma.ssi.uncertainty import (
    frequency_damping_deviations,
    order_deviations,
    pole_deviations,
    projected_deviations,
    shape_deviations,
    state_deviations,
)
from tests.pipeline.oma.conftest import KnownStructure

ROWS, ORDER, DT = 15, 4, 0.05


@pytest.fixture(scope="module", params=[slice(None), np.array([1])], ids=["all", "one reference"])
def covariances(two_mass_system: KnownStructure, request: pytest.FixtureRequest) -> LagCovariances:
    """Covariances of theory, whose Hankel matrix has rank 4, with the scatter of a record.

    Why of theory: with singular values left beyond the order the exact derivative contains
    1/(s_n² − s_{n+1}²), which a finite step cannot show and the estimate leaves out.
    """
    y = two_mass_system.ambient_response(sampling_rate=1 / DT, duration=200.0, seed=11)
    scatter = lag_covariances(y, n_lags=2 * ROWS, block_length=397, references=request.param)
    lags = DT * np.arange(1, 2 * ROWS + 1)
    omega = 2 * np.pi * two_mass_system.frequencies
    decay = np.exp(-lags[:, None] * two_mass_system.damping_ratios * omega)
    wave = decay * np.cos(lags[:, None] * omega * np.sqrt(1 - two_mass_system.damping_ratios**2))
    theory = np.einsum("tm,mi,mj->tij", wave, two_mass_system.shapes, two_mass_system.shapes)
    theory = theory[:, :, request.param]
    return LagCovariances(theory + (scatter.blocks - scatter.mean), scatter.scales)


def identified(mean: np.ndarray) -> tuple[SignalSubspace, SystemModes]:
    subspace = signal_subspace(mean, block_rows=ROWS, highest_order=ORDER)
    return subspace, next(system_modes(subspace, orders=[ORDER], sampling_interval=DT))


def moved_by(covariances: LagCovariances, block: int, step: float) -> SystemModes:
    """The system when one block's deviation is added to the covariances."""
    return identified(covariances.mean + step * covariances.deviations[block])[1]


def physical(modes: SystemModes) -> np.ndarray:
    """Indices of the structure's two modes, which the noise poles do not come near."""
    return np.array([int(np.argmin(np.abs(modes.frequencies - f))) for f in (1.236, 3.236)])


def test_pole_deviations_are_the_derivative_of_the_identification(
    covariances: LagCovariances,
) -> None:
    subspace, modes = identified(covariances.mean)
    chosen = physical(modes)
    projected = projected_deviations(subspace, covariances.deviations)
    deviations = pole_deviations(state_deviations(order_deviations(projected, modes), chosen))
    analytic = frequency_damping_deviations(modes.poles[chosen], deviations, DT)
    step = 1e-4
    for block in (0, 4, 9):
        plus, minus = (moved_by(covariances, block, sign * step) for sign in (1, -1))
        for name, derivative in (
            ("frequencies", analytic.frequency),
            ("damping_ratios", analytic.damping_ratio),
        ):
            difference = getattr(plus, name)[physical(plus)] - getattr(minus, name)[physical(minus)]
            np.testing.assert_allclose(
                derivative[:, block],
                difference / (2 * step),
                rtol=2e-3,
                atol=1e-4 * np.abs(derivative).max(),
            )


def test_shape_deviations_are_the_derivative_of_the_normalised_shape(
    covariances: LagCovariances,
) -> None:
    subspace, modes = identified(covariances.mean)
    chosen = physical(modes)
    projected = projected_deviations(subspace, covariances.deviations)
    deviations = shape_deviations(state_deviations(order_deviations(projected, modes), chosen))
    step = 1e-4
    for place, mode in enumerate(chosen):
        _, factor = normalised_with_deviations(modes.shapes[:, mode], deviations[place])
        for block in (0, 4, 9):
            plus, minus = (
                normalised_with_deviations(
                    moved.shapes[:, physical(moved)[place]], np.zeros((2, 1))
                )[0]
                for moved in (moved_by(covariances, block, sign * step) for sign in (1, -1))
            )
            np.testing.assert_allclose(
                factor[:, block],
                (plus - minus) / (2 * step),
                rtol=1e-3,
                atol=1e-5 * np.abs(factor).max(),
            )


def test_single_precision_costs_a_std_less_than_a_hundredth_of_its_own_scatter(
    two_mass_system: KnownStructure,
) -> None:
    """A std from n_b blocks scatters by 1/√(2(n_b − 1)). The orders reach into the noise."""
    y = two_mass_system.ambient_response(sampling_rate=1 / DT, duration=300.0, seed=12)
    record = lag_covariances(y, n_lags=2 * ROWS, block_length=149)
    subspace = signal_subspace(record.mean, block_rows=ROWS, highest_order=16)
    scatter = 1 / np.sqrt(2 * (len(record.blocks) - 1))
    single, double = (
        projected_deviations(subspace, record.deviations, precision=precision)
        for precision in (np.float32, np.float64)
    )
    for system in system_modes(subspace, orders=[4, 10, 16], sampling_interval=DT):
        chosen = np.arange(len(system.poles))
        ours, exact = (
            np.linalg.norm(
                pole_deviations(state_deviations(order_deviations(each, system), chosen)), axis=1
            )
            for each in (single, double)
        )
        np.testing.assert_allclose(ours, exact, rtol=scatter / 100)


@pytest.mark.parametrize(
    ("shape", "expected"),
    [
        ([1.0, -2.0, 0.5], 1.0),  # in phase or in opposition
        ([1.0 + 1.0j, 2.0 + 2.0j], 1.0),  # whatever the common phase
        ([1.0, 1.0j], 0.0),
        ([1.0, 1.0 + 1.0j], 5 / 9),  # rr = 2, ii = 1, ri = 1: (1 + 4) / 9
        ([0.0, 0.0], 0.0),
    ],
)
def test_the_collinearity_of_a_shape_is_that_of_its_definition(shape, expected: float) -> None:
    assert modal_phase_collinearity(np.array(shape, complex)) == pytest.approx(expected)
