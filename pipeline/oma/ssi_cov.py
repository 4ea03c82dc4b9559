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


def signal_subspace(hankel: FloatArray, *, n_channels: int, highest_order: int) -> SignalSubspace:
    """Truncated singular value decomposition H ≈ U diag(s) Vᵀ to the highest order asked for."""
    left, singular_values, right = linalg.svd(
        hankel, full_matrices=False, check_finite=False, lapack_driver="gesdd"
    )
    n = min(highest_order, int(np.sum(singular_values > 1e-12 * singular_values[0])))
    return SignalSubspace(left[:, :n], singular_values[:n], right[:n].T, n_channels)


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
