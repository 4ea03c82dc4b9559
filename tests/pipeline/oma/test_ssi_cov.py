"""The truncated decomposition is the leading part of the whole one."""

import numpy as np
import pytest

from pipeline.oma.covariance import LagCovariances, block_hankel, lag_covariances
from pipeline.oma.ssi_cov import (
    HankelOperator,
    leading_singular_triplets,
    signal_subspace,
    singular_triplets_of_gram,
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


def test_the_gram_matrix_has_the_same_leading_triplets(covariances: LagCovariances) -> None:
    hankel = block_hankel(covariances.mean, ROWS)
    triplets = singular_triplets_of_gram(hankel, 12)
    assert triplets is not None
    left, singular_values, right = triplets
    full = np.linalg.svd(hankel)
    np.testing.assert_allclose(singular_values, full.S[:12], rtol=1e-10)
    np.testing.assert_allclose(np.abs(np.sum(left * full.U[:, :12], axis=0)), 1.0, atol=1e-9)
    np.testing.assert_allclose(left.T @ left, np.eye(12), atol=1e-9)
    np.testing.assert_allclose(right.T @ right, np.eye(12), atol=1e-12)


def test_singular_values_that_squaring_loses_are_decomposed_in_full(
    two_mass_system: KnownStructure,
) -> None:
    """A second mode a hundred thousand times weaker in both of its channels."""
    lags = np.arange(1, 41)
    strong, weak = np.cos(0.3 * lags) * 0.99**lags, np.cos(0.9 * lags) * 0.99**lags
    theory = strong[:, None, None] * np.eye(2)[0] * np.eye(2)[:1].T
    theory = theory + 1e-7 * weak[:, None, None] * np.eye(2)[1] * np.eye(2)[1:].T
    assert singular_triplets_of_gram(block_hankel(theory, 20), 4) is None
    subspace = signal_subspace(theory, block_rows=20, highest_order=4)
    modes = next(system_modes(subspace, orders=[4], sampling_interval=1.0))
    np.testing.assert_allclose(np.sort(np.angle(modes.poles)), [0.3, 0.9], rtol=1e-9)


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
