"""A few coordinates that hold the modes of a structure at many points of its parameters.

The modes at the first point span a basis. At each further point K(x), M(x) its modes within the
basis are improved by inverse iteration on the whole sparse matrices,

    φ ← ω² K⁻¹ M φ,

and what of them lies outside joins the basis, until many points in turn bring nothing new. In the
end only those directions stay that some modes need. Source: Parlett, The Symmetric Eigenvalue
Problem (1980), section 4.2, of the iteration; Benner, Gugercin and Willcox, SIAM Review 57 (2015)
483, of bases by snapshots.
"""

from collections.abc import Callable, Sequence

import numpy as np
from scipy.linalg import LinAlgError, eigh
from scipy.sparse import csr_array
from scipy.sparse.linalg import splu

from sensors.arrays import FloatArray

SNAPSHOT_TOLERANCE = 5e-6  # share of a mode that the basis leaves out [-]
SLOW = 2.0  # below, modes are held the more closely the slower they are [Hz]
REACH = 1.4  # multiple of the highest frequency up to which the first point's modes are taken [-]
IMPROVEMENTS = 2  # of the improvement
QUIET_POINTS = 25  # that bring nothing new, one after the other, end the search

Matrices = Callable[[int], tuple[csr_array, csr_array]]


class SparseStack:
    """Sparse matrices of one size, of which weighted sums are taken."""

    def __init__(self, matrices: Sequence[csr_array]) -> None:
        self._matrices = tuple(matrices)
        self._shape = matrices[0].shape if matrices else (0, 0)
        pattern = csr_array(self._shape)
        for matrix in matrices:
            pattern = pattern + abs(matrix)
        pattern.sort_indices()
        self._indices, self._starts = pattern.indices, pattern.indptr
        rows = np.repeat(np.arange(self._shape[0]), np.diff(self._starts))
        self._entries = np.zeros((len(self._matrices), len(rows)))
        if len(rows):  # of no place, an index gives a sparse array
            entries = [np.asarray(matrix[rows, self._indices]).ravel() for matrix in matrices]
            self._entries = np.array(entries).reshape(self._entries.shape)

    def __len__(self) -> int:
        return len(self._matrices)

    def summed(self, weights: FloatArray) -> csr_array:
        """Σ_j w_j A_j: of the entries that any of them has, one matrix after the other."""
        entries = np.zeros(len(self._indices))
        for weight, more in zip(weights.tolist(), self._entries, strict=True):
            entries += weight * more
        total = csr_array((entries, self._indices.copy(), self._starts.copy()), shape=self._shape)
        total.eliminate_zeros()
        return total

    def congruent(self, basis: FloatArray) -> FloatArray:
        """Vᵀ A_j V of each, (n_matrices, m, m)."""
        if not self._matrices:
            return np.zeros((0, basis.shape[1], basis.shape[1]))
        return np.array([basis.T @ (matrix @ basis) for matrix in self._matrices])


def snapshot_basis(matrices: Matrices, n_points: int, *, highest_frequency: float) -> FloatArray:
    """Return a basis of the modes up to a frequency at all points.

    Parameters
    ----------
    matrices : callable
        K and M at point i = 0, 1, …, n_points − 1, (n, n) each, symmetric; K is positive definite
        at the first point.
    n_points : int
        Number of points; one whose K is not positive definite is left out.
    highest_frequency : float
        Of the modes that are held [Hz].

    Returns
    -------
    ndarray, shape (n, m)
        Columns, orthonormal in the mass at the first point.
    """
    return _Search(matrices, highest_frequency).basis(n_points)


class _Search:
    """The basis while it grows."""

    def __init__(self, matrices: Matrices, highest_frequency: float) -> None:
        self._matrices = matrices
        self._lowest_flexibility = (2 * np.pi * highest_frequency) ** -2
        K, self._mass = matrices(0)
        flexibilities, vectors = eigh(
            self._mass.toarray(),
            K.toarray(),
            subset_by_value=(self._lowest_flexibility / REACH**2, np.inf),
        )
        self._basis = vectors / np.sqrt(flexibilities)
        held = flexibilities > self._lowest_flexibility
        self._found = [np.eye(len(held))[:, held] * _slowness(flexibilities[held])]

    def basis(self, n_points: int) -> FloatArray:
        quiet = 0
        for point in range(1, n_points):
            n_before = self._basis.shape[1]
            self._add_point(point)
            quiet = quiet + 1 if self._basis.shape[1] == n_before else 0
            if quiet == QUIET_POINTS:
                break
        return self._needed()

    def _add_point(self, point: int) -> None:
        K, M = self._matrices(point)
        V = self._basis
        try:
            flexibilities, z = eigh(
                V.T @ (M @ V),
                V.T @ (K @ V),
                subset_by_value=(self._lowest_flexibility, np.inf),
            )
        except LinAlgError:
            return
        vectors = V @ z / np.sqrt(flexibilities)
        factor = splu(K.tocsc())
        for _ in range(IMPROVEMENTS):
            vectors = factor.solve(M @ vectors) / flexibilities
        vectors *= _slowness(flexibilities)
        inside = V.T @ (self._mass @ vectors)
        outside = vectors - V @ inside
        outside -= V @ (V.T @ (self._mass @ outside))
        squares, turn = eigh(outside.T @ (self._mass @ outside))
        new = squares > SNAPSHOT_TOLERANCE**2
        more = outside @ turn[:, new] / np.sqrt(squares[new])
        self._basis = np.hstack([V, more])
        self._found.append(np.vstack([inside, more.T @ (self._mass @ outside)]))

    def _needed(self) -> FloatArray:
        """The directions of the modes that were found, weakest left out."""
        size = self._basis.shape[1]
        moment = np.zeros((size, size))
        for found in self._found:
            n = len(found)
            moment[:n, :n] += found @ found.T
        squares, turn = eigh(moment / len(self._found))
        return np.asarray(self._basis @ turn[:, squares > SNAPSHOT_TOLERANCE**2][:, ::-1])


def _slowness(flexibilities: FloatArray) -> FloatArray:
    """Weight of a mode: a slow one's ω² is the small rest of what springs and weight do, so that it
    needs more digits."""
    return np.maximum(1.0, 2 * np.pi * SLOW * np.sqrt(flexibilities))
