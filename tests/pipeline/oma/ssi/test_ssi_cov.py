"""The truncated decomposition is the leading part of the whole one."""

import numpy as np
import pytest

from pipeline.oma.ssi.ssi_cov import (
    HankelOperator,
    LagCovariances,
    block_hankel,
    lag_covariances,
    leading_singular_triplets,
    signal_subspace,
    system_modes,
)
from tests.pipeline.oma.conftest import KnownStructure

ROWS = 40


@pytest.fixture(scope="module")
def covariances(cantilever: KnownStructure) -> LagCovariances:
    y = cantilever.ambient_response(sampling_rate=20.0, duration=400.0, seed=5)
    return lag_covariances(y, n_lags=2 * ROWS, block_length=390)


def test_the_operator_is_the_block_hankel_matrix(covariances: LagCovariances) -> None:
    operator = HankelOperator(covariances.mean, ROWS)
    hankel = block_hankel(covariances.mean, ROWS)
    assert operator.shape == hankel.shape
    x = np.random.default_rng(1).standard_normal((hankel.shape[1], 3))
    z = np.random.default_rng(2).standard_normal((hankel.shape[0], 3))
    np.testing.assert_allclose(operator @ x, hankel @ x, atol=1e-12)
    np.testing.assert_allclose(operator.transposed_times(z), hankel.T @ z, atol=1e-12)


def test_leading_triplets_are_those_of_the_full_decomposition(covariances: LagCovariances) -> None:
    triplets = leading_singular_triplets(HankelOperator(covariances.mean, ROWS), 24)
    assert triplets is not None
    left, singular_values, right = triplets
    full = np.linalg.svd(block_hankel(covariances.mean, ROWS))
    np.testing.assert_allclose(singular_values, full.S[:24], rtol=1e-10)
    np.testing.assert_allclose(np.abs(np.sum(left * full.U[:, :24], axis=0)), 1.0, atol=1e-7)
    np.testing.assert_allclose(left.T @ left, np.eye(24), atol=1e-12)
    np.testing.assert_allclose(right.T @ right, np.eye(24), atol=1e-9)


def test_singular_values_that_coincide_are_all_found() -> None:
    """Four channels that decay alike but have nothing else in common: each value is fourfold."""
    lags = np.arange(1, 81)
    wave = 0.97**lags * np.cos(0.4 * lags) + 0.5 * 0.95**lags * np.cos(1.3 * lags)
    covariances = wave[:, None, None] * np.eye(4)
    triplets = leading_singular_triplets(HankelOperator(covariances, 40), 16)
    assert triplets is not None
    full = np.linalg.svd(block_hankel(covariances, 40))
    np.testing.assert_allclose(triplets[1], full.S[:16], rtol=1e-10)
    np.testing.assert_allclose(np.diff(full.S[:16].reshape(4, 4), axis=1), 0.0, atol=1e-10)


def test_singular_values_that_fall_too_slowly_are_decomposed_in_full() -> None:
    """Random covariances: nothing separates the first singular values from the next."""
    covariances = np.random.default_rng(3).standard_normal((160, 3, 3))
    assert leading_singular_triplets(HankelOperator(covariances, 80), 10) is None
    subspace = signal_subspace(covariances, block_rows=80, highest_order=10)
    full = np.linalg.svd(block_hankel(covariances, 80))
    np.testing.assert_allclose(subspace.singular_values, full.S[:10], rtol=1e-12)


def test_the_order_of_a_modes_truth_gives_its_closed_form(two_mass_system: KnownStructure) -> None:
    """Covariances of theory have rank 4: the poles of order 4 are exact."""
    dt = 0.05
    lags = dt * np.arange(1, 41)
    omega, zeta = 2 * np.pi * two_mass_system.frequencies, two_mass_system.damping_ratios
    wave = np.exp(-lags[:, None] * zeta * omega) * np.cos(
        lags[:, None] * omega * np.sqrt(1 - zeta**2)
    )
    theory = np.einsum("tm,mi,mj->tij", wave, two_mass_system.shapes, two_mass_system.shapes)
    subspace = signal_subspace(theory, block_rows=20, highest_order=4)
    modes = next(system_modes(subspace, orders=[4], sampling_interval=dt))
    order = np.argsort(modes.frequencies)
    np.testing.assert_allclose(modes.frequencies[order], two_mass_system.frequencies, rtol=1e-9)
    np.testing.assert_allclose(modes.damping_ratios[order], zeta, rtol=1e-7)
