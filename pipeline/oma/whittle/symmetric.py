"""Symmetric matrices by their upper triangle, along orthonormal directions S.

S is e_a e_aᵀ, or (e_a e_bᵀ + e_b e_aᵀ) / √2. Of n channels there are n (n + 1) / 2; components are
picked, since products with a matrix of all S would cost n times as much.
"""

from functools import cache

import numpy as np

from sensors.arrays import ComplexArray, FloatArray, IntArray


def symmetric_of(components: FloatArray, n: int) -> FloatArray:
    """The matrix Σ x_S S, (n, n)."""
    rows, columns, sizes = _triangle(n)
    matrix = np.zeros((n, n))
    matrix[rows, columns] = np.sqrt(0.5) * sizes * components
    return np.asarray(matrix + matrix.T)


def along_symmetric(matrices: FloatArray, n: int) -> FloatArray:
    """trace(M S) of flattened matrices and each S, (..., n²) → (..., n (n + 1) / 2)."""
    rows, columns, sizes = _triangle(n)
    both = matrices[..., rows * n + columns] + matrices[..., columns * n + rows]
    return np.asarray(np.sqrt(0.5) * sizes * both)


def information_along_symmetric(matrices: ComplexArray, counts: IntArray) -> FloatArray:
    """Σ n Re trace(E S E S') of each two.

    matrices   E, Hermitian, (n_bins, n, n);  counts: n of each bin

    trace(E e_a e_bᵀ E e_c e_dᵀ) = E_da E_bc; of (a, b) and (b, a), (c, d) and (d, c) the real parts
    of two are those of the other two.
    """
    rows, columns, sizes = _triangle(matrices.shape[-1])
    upper = matrices[:, rows, columns]
    real, imaginary = (
        (counts[:, None] * part).T @ part for part in (upper.real.copy(), upper.imag.copy())
    )
    found = np.zeros_like(real)
    for one, other, sign in _crossings(matrices.shape[-1]):
        found += real[one, other] - sign * imaginary[one, other]
    return np.asarray(sizes[:, None] * sizes * found)


@cache
def _triangle(n: int) -> tuple[IntArray, IntArray, FloatArray]:
    """Rows and columns of the upper triangle, and √½ on the diagonal, 1 elsewhere."""
    rows, columns = np.triu_indices(n)
    return rows, columns, np.where(rows == columns, np.sqrt(0.5), 1.0)


@cache
def _crossings(n: int) -> tuple[tuple[IntArray, IntArray, FloatArray], ...]:
    """Where in the triangle E_da E_bc and E_ca E_bd stand, with the sign of the product of their
    imaginary parts."""
    a, b, _ = _triangle(n)
    place = np.zeros((n, n), dtype=np.intp)
    place[a, b] = place[b, a] = np.arange(len(a))

    def picked(c: IntArray, d: IntArray) -> tuple[IntArray, IntArray, FloatArray]:
        left, right = (d[None, :], a[:, None]), (b[:, None], c[None, :])
        signs = np.sign(left[1] - left[0]) * np.sign(right[1] - right[0])
        return place[left], place[right], signs.astype(float)

    return picked(a, b), picked(b, a)
