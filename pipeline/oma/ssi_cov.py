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
from scipy import linalg

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


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
    left: ComplexArray  # X, (order, n_modes): Xᵀ A = diag(λ_d) Xᵀ, Xᵀ Ψ = I
    all_poles: ComplexArray  # (order,), real and conjugate ones too
    all_right: ComplexArray  # (order, order)
    all_left: ComplexArray  # (order, order)
    shapes: ComplexArray  # φ = C Ψ, (n_channels, n_modes) [-]
    frequencies: FloatArray  # f, undamped [Hz]
    damping_ratios: FloatArray  # ζ [-]


RESIDUAL = 1e-9  # ‖H Hᵀ u − s² u‖ / s² of every singular vector that is used
_SMALL = 5  # a Hankel matrix less than this many times the order is decomposed in full


def signal_subspace(
    hankel: FloatArray,
    *,
    n_channels: int,
    highest_order: int,
    start: SignalSubspace | None = None,
) -> SignalSubspace:
    """Truncated singular value decomposition H ≈ U diag(s) Vᵀ to the highest order asked for.

    start   of an earlier, overlapping window: the iteration begins there

    The leading part is iterated to a residual of 1e-9; a small matrix, or one whose singular
    values fall so slowly that the iteration does not get there, is decomposed in full.
    """
    truncated = None
    if min(hankel.shape) >= _SMALL * highest_order:
        truncated = leading_singular_triplets(
            hankel, highest_order, start=None if start is None else start.left
        )
    left, singular_values, right = truncated or _all_singular_triplets(hankel)
    n = min(highest_order, int(np.sum(singular_values > 1e-12 * singular_values[0])))
    return SignalSubspace(left[:, :n], singular_values[:n], right[:, :n], n_channels)


def _all_singular_triplets(hankel: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    left, singular_values, right = linalg.svd(hankel, full_matrices=False, check_finite=False)
    return left, singular_values, right.T


def leading_singular_triplets(
    matrix: FloatArray, count: int, *, start: FloatArray | None = None, seed: int = 0
) -> tuple[FloatArray, FloatArray, FloatArray] | None:
    """The largest singular values and their vectors (U, s, V) by a block Krylov iteration.

    matrix   H, (m, n)
    count    how many triplets
    start    (m, any number) vectors near the wanted U; a fixed random block by default
    returns  None when the residual is not reached in a basis of 4 × count vectors

    An orthonormal basis B of the Krylov space of H Hᵀ grows block by block; with C = Hᵀ B the
    triplets come from the small matrix Cᵀ C = Bᵀ H Hᵀ B. What leaves the basis is the next block
    Q⁺ R, so that ‖H Hᵀ u − s² u‖ = ‖R x_last‖ costs nothing.
    Source: Golub and Van Loan, Matrix Computations, 4th ed., §10.4; Musco and Musco (2015),
    Randomized block Krylov methods, for the random start.
    """
    block_size = max(8, count // 3)
    if start is None:
        start = matrix @ np.random.default_rng(seed).standard_normal((matrix.shape[1], block_size))
    basis = np.linalg.qr(start)[0]
    images = matrix.T @ basis  # C
    newest = slice(0, basis.shape[1])
    while basis.shape[1] < 4 * count:
        following = matrix @ images[:, newest]
        for _ in range(2):  # twice is enough (Kahan, Parlett) for orthogonality to rounding
            following -= basis @ (basis.T @ following)
        following, leaving = np.linalg.qr(following)
        if basis.shape[1] >= count:
            squares, x = linalg.eigh(images.T @ images, check_finite=False)
            squares, x = squares[: -count - 1 : -1], x[:, : -count - 1 : -1]
            residual = np.linalg.norm(leaving @ x[newest], axis=0)
            if (residual <= RESIDUAL * squares).all():
                singular_values = np.sqrt(squares)
                return basis @ x, singular_values, (images @ x) / singular_values
        newest = slice(basis.shape[1], basis.shape[1] + following.shape[1])
        basis = np.hstack([basis, following])
        images = np.hstack([images, matrix.T @ following])
    return None


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
    chi = np.linalg.inv(psi).T
    kept = np.flatnonzero(poles_d.imag > 0)
    poles = np.log(poles_d[kept]) / dt  # λ [rad/s]
    return SystemModes(
        order=len(A),
        poles=poles_d[kept],
        right=psi[:, kept],
        left=chi[:, kept],
        all_poles=poles_d,
        all_right=psi,
        all_left=chi,
        shapes=C @ psi[:, kept],
        frequencies=np.abs(poles) / (2 * np.pi),
        damping_ratios=-poles.real / np.abs(poles),
    )
