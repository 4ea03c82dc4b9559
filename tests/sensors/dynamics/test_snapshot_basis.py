"""A basis of the modes of many points: against the whole matrices."""

import numpy as np
import pytest
from scipy.linalg import eigh
from scipy.sparse import csr_array

from sensors.dynamics.snapshot_basis import SparseStack, snapshot_basis

N = 120
HIGHEST = 1.0  # [Hz]


def chain(springs: np.ndarray) -> csr_array:
    """Stiffness of masses in a row, the first of which stands on a spring of its own."""
    inner = np.append(springs[1:], 0.0)
    diagonal = np.diag(springs + inner)
    return csr_array(diagonal - np.diag(inner[:-1], 1) - np.diag(inner[:-1], -1))


def point(i: int) -> tuple[csr_array, csr_array]:
    """A row of masses whose foundation and lower half vary."""
    generator = np.random.default_rng(i)
    springs = np.full(N, 9e3)
    springs[0] *= np.exp(generator.uniform(-3, 1))
    springs[: N // 2] *= np.exp(generator.uniform(-0.3, 0.3))
    masses = np.ones(N) + np.eye(N)[-1] * generator.uniform(0, 20)
    return chain(springs), csr_array(np.diag(masses))


def frequencies(K: np.ndarray, M: np.ndarray) -> np.ndarray:
    found = np.sqrt(eigh(K, M, eigvals_only=True)) / (2 * np.pi)
    return found[found < HIGHEST]


def test_modes_of_points_that_were_not_searched_lie_in_the_basis() -> None:
    basis = snapshot_basis(point, 60, highest_frequency=1.1 * HIGHEST)
    assert basis.shape[1] < 25
    for i in range(100, 110):
        K, M = (matrix.toarray() for matrix in point(i))
        whole = frequencies(K, M)
        inside = frequencies(basis.T @ K @ basis, basis.T @ M @ basis)
        np.testing.assert_allclose(inside, whole, rtol=1e-7)


def test_a_basis_is_orthonormal_in_the_first_mass() -> None:
    basis = snapshot_basis(point, 30, highest_frequency=HIGHEST)
    np.testing.assert_allclose(basis.T @ (point(0)[1] @ basis), np.eye(basis.shape[1]), atol=1e-10)


def test_a_point_that_falls_over_is_left_out() -> None:
    def with_one_falling(i: int) -> tuple[csr_array, csr_array]:
        K, M = point(i)
        return (-K, M) if i == 3 else (K, M)

    basis = snapshot_basis(with_one_falling, 30, highest_frequency=HIGHEST)
    assert np.all(np.isfinite(basis))


@pytest.mark.parametrize("weights", [[1.0, 0.0, 2.0], [0.5, -3.0, 0.25]])
def test_a_stack_is_summed_and_projected_as_its_matrices(weights: list[float]) -> None:
    generator = np.random.default_rng(1)
    full = generator.standard_normal((3, 6, 6)) * (generator.uniform(size=(3, 6, 6)) < 0.3)
    basis = generator.standard_normal((6, 2))
    stack = SparseStack([csr_array(matrix) for matrix in full])
    expected = np.einsum("j,jkl->kl", weights, full)
    np.testing.assert_allclose(stack.summed(np.array(weights)).toarray(), expected)
    np.testing.assert_allclose(stack.congruent(basis), basis.T @ full @ basis, atol=1e-12)
    assert SparseStack([]).congruent(basis).shape == (0, 2, 2)


def test_matrices_without_an_entry_add_nothing() -> None:
    """Of the water, on land."""
    stack = SparseStack([csr_array((4, 4)), csr_array((4, 4))])
    assert stack.summed(np.ones(2)).nnz == 0
    np.testing.assert_array_equal(stack.congruent(np.eye(4)), np.zeros((2, 4, 4)))
