"""Covariance-driven stochastic subspace identification for every model order at once.

The outputs of a structure under ambient load are those of a linear system
    x_{k+1} = A_d x_k + w_k,   y_k = C x_k + v_k                                       (Eq. 1)
whose lag covariances factor as R_τ = C A_d^(τ−1) G. The block Hankel matrix of R therefore is
O·(…), O = [C; C A_d; C A_d²; …]: its column space gives A_d by shift invariance and C as its first
block row.
Source: [foundation-updating] Eqs. 1-4; Peeters and De Roeck (1999), Reference-based stochastic
subspace identification for output-only modal analysis, Mech. Syst. Signal Process. 13.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from pipeline.oma.ssi.covariance import block_hankel
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import ComplexArray, FloatArray

Triplets = tuple[FloatArray, FloatArray, FloatArray]  # U, s, V of U diag(s) Vᵀ, largest s first


@dataclass(frozen=True, slots=True, eq=False)
class SignalSubspace:
    """Leading singular vectors of the block Hankel matrix: a basis of O for every order.

    The model of order n uses the first n columns of each.
    """

    left: FloatArray  # U, ((p + 1)·n_channels, n_max)
    singular_values: FloatArray  # s, (n_max,), descending
    right: FloatArray  # V, (p·n_references, n_max)
    n_channels: int

    @property
    def upper(self) -> FloatArray:
        """O without its last block row."""
        return self.left[: -self.n_channels]

    @property
    def lower(self) -> FloatArray:
        """O without its first block row."""
        return self.left[self.n_channels :]


@dataclass(frozen=True, slots=True, eq=False)
class SystemModes:
    """Oscillating modes of the identified system of one order; one of each conjugate pair.

    All arrays have the modes along their last axis.
    """

    order: int
    poles: ComplexArray  # λ_d of A_d, (n_modes,), discrete time [-]
    right: ComplexArray  # Ψ, (order, n_modes): A Ψ = Ψ diag(λ_d)
    kept: NDArray[np.int64]  # their places among all eigenvectors, (n_modes,)
    all_poles: ComplexArray  # (order,), real and conjugate ones too
    all_right: ComplexArray  # (order, order)
    shapes: ComplexArray  # φ = C Ψ, (n_channels, n_modes) [-]
    frequencies: FloatArray  # f, undamped [Hz]
    damping_ratios: FloatArray  # ζ [-]


RESIDUAL = 1e-9  # ‖H Hᵀ u − s² u‖ / s² of every singular vector that is used
_SMALL = 3  # a Hankel matrix less than this many times the order is decomposed in full
_LARGEST_BASIS = 5  # times the order: a Krylov space beyond costs more than the whole
# Columns that a Krylov space grows by: narrow blocks reach a residual in the smallest space, but
# must hold the singular values that coincide (two a mode, four where two directions are alike).
_BLOCK_WIDTH = 8


class HankelOperator:
    """The block Hankel matrix of lag covariances, applied without being formed.

    (H x)_i = Σ_j R_{i+j+1} x_j is a convolution with x reversed: by FFT along the lags.
    """

    def __init__(self, covariances: FloatArray, block_rows: int):
        """covariances: R_τ, (n_lags = 2p, n_channels, n_references); block_rows: p"""
        self.covariances, self.block_rows = covariances, block_rows
        self._n_lags, n_channels, n_references = covariances.shape
        self.shape = ((block_rows + 1) * n_channels, block_rows * n_references)
        self._spectrum = fft.rfft(covariances, axis=0)
        self._transposed = np.ascontiguousarray(self._spectrum.transpose(0, 2, 1))

    def __matmul__(self, columns: FloatArray) -> FloatArray:
        """H x, x (p·n_references, n)"""
        return self._product(self._spectrum, columns)

    def transposed_times(self, columns: FloatArray) -> FloatArray:
        """Hᵀ x, x ((p + 1)·n_channels, n)"""
        return self._product(self._transposed, columns)

    def _product(self, spectrum: ComplexArray, columns: FloatArray) -> FloatArray:
        width = spectrum.shape[2]
        rows = len(columns) // width
        reversed_rows = columns.reshape(rows, width, -1)[::-1]
        product = spectrum @ fft.rfft(reversed_rows, self._n_lags, axis=0)
        valid = fft.irfft(product, self._n_lags, axis=0, overwrite_x=True)[rows - 1 :]
        return np.asarray(valid.reshape(-1, columns.shape[1]))


def signal_subspace(
    covariances: FloatArray, *, block_rows: int, highest_order: int
) -> SignalSubspace:
    """Truncated singular value decomposition H ≈ U diag(s) Vᵀ to the highest order asked for.

    covariances   R_τ, (n_lags = 2p, n_channels, n_references), τ = 1..n_lags
    block_rows    p

    The leading part is iterated to a residual of 1e-9; a small matrix, or one whose singular
    values fall so slowly that the iteration does not get there, is decomposed in full.
    """
    operator = HankelOperator(covariances, block_rows)
    truncated = None
    if min(operator.shape) >= _SMALL * highest_order:
        truncated = leading_singular_triplets(operator, highest_order)
    left, singular_values, right = truncated or _all_singular_triplets(operator)
    n = min(highest_order, int(np.sum(singular_values > 1e-12 * singular_values[0])))
    return SignalSubspace(left[:, :n], singular_values[:n], right[:, :n], covariances.shape[1])


def _all_singular_triplets(operator: HankelOperator) -> Triplets:
    left, singular_values, right = linalg.svd(
        block_hankel(operator.covariances, operator.block_rows),
        full_matrices=False,
        check_finite=False,
    )
    return left, singular_values, right.T


def _largest_eigenpairs(symmetric: FloatArray, count: int) -> tuple[FloatArray, FloatArray]:
    """In descending order. All are computed: the divide-and-conquer driver is the quickest."""
    eigenvalues, vectors = linalg.eigh(symmetric, check_finite=False, driver="evd")
    return eigenvalues[: -count - 1 : -1], vectors[:, : -count - 1 : -1]


def leading_singular_triplets(
    matrix: HankelOperator, count: int, *, seed: int = 0
) -> Triplets | None:
    """The largest singular values and their vectors (U, s, V) by a block Krylov iteration.

    matrix   H, (m, n)
    count    how many triplets
    returns  None when the residual is not reached in a basis of 5 × count vectors

    An orthonormal basis B of the Krylov space of H Hᵀ grows block by block; with C = Hᵀ B the
    triplets come from the small matrix Cᵀ C = Bᵀ H Hᵀ B. What leaves the basis is the next block
    Q⁺ R, so that ‖H Hᵀ u − s² u‖ = ‖R x_last‖ costs nothing.
    Source: Golub and Van Loan, Matrix Computations, 4th ed., §10.4; Musco and Musco (2015),
    Randomized block Krylov methods, for the random start.
    """
    width = _BLOCK_WIDTH
    generator = np.random.default_rng(seed)
    block = np.linalg.qr(matrix @ generator.standard_normal((matrix.shape[1], width)))[0]
    largest = min(_LARGEST_BASIS * count, min(matrix.shape) - width)
    bases = np.empty((matrix.shape[0], largest + width), order="F")  # B, grown in place
    images = np.empty((matrix.shape[1], largest + width), order="F")  # C
    next_check = 2 * count  # below, it is never enough; each costs as much as several blocks
    for size in range(width, largest + 1, width):
        checkpoint()
        newest = slice(size - width, size)
        bases[:, newest] = block
        images[:, newest] = matrix.transposed_times(block)
        following = matrix @ images[:, newest]
        block, leaving = _orthonormal_to(bases[:, :size], following)
        if size >= next_check:
            next_check = size + count // 2
            squares, x = _largest_eigenpairs(images[:, :size].T @ images[:, :size], count)
            residual = np.linalg.norm(leaving @ x[newest], axis=0)
            if (residual <= RESIDUAL * squares).all():
                singular_values = np.sqrt(squares)
                return bases[:, :size] @ x, singular_values, images[:, :size] @ x / singular_values
    return None


def _orthonormal_to(basis: FloatArray, block: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Q R of what of a block lies outside a basis."""
    for _ in range(2):  # twice is enough (Kahan, Parlett), even where only rounding is left over
        block = block - basis @ (basis.T @ block)
    q, r = np.linalg.qr(block)
    return q, r


def system_modes(
    subspace: SignalSubspace, *, orders: Sequence[int], sampling_interval: float
) -> Iterator[SystemModes]:
    """Modes of the system of every order, from one factorisation.

    sampling_interval   dt [s]

    With Q R = O_up, A_n = R_n⁻¹ (Qᵀ O_down)_n for the leading n × n parts: the least-squares
    solutions of O_up A = O_down of all orders are nested. With A_c = log(A_d)/dt,
        f = |λ| / 2π,   ζ = −Re λ / |λ|,   φ = C ψ                                (Eqs. 2-4)
    """
    q, r = linalg.qr(subspace.upper, mode="economic", check_finite=False)
    shifted = q.T @ subspace.lower
    for order in orders:
        if order > len(r):
            return
        checkpoint()
        state_matrix = linalg.solve_triangular(
            r[:order, :order], shifted[:order, :order], check_finite=False
        )
        yield _modes_of(
            state_matrix, subspace.left[: subspace.n_channels, :order], sampling_interval
        )


def _modes_of(A: FloatArray, C: FloatArray, dt: float) -> SystemModes:
    poles_d: Any
    poles_d, psi = np.linalg.eig(A)
    poles_d, psi = poles_d.astype(complex), psi.astype(complex)
    kept = np.flatnonzero(poles_d.imag > 0)
    poles = np.log(poles_d[kept]) / dt  # λ [rad/s]
    return SystemModes(
        order=len(A),
        poles=poles_d[kept],
        right=psi[:, kept],
        kept=kept,
        all_poles=poles_d,
        all_right=psi,
        shapes=C @ psi[:, kept],
        frequencies=np.abs(poles) / (2 * np.pi),
        damping_ratios=-poles.real / np.abs(poles),
    )
