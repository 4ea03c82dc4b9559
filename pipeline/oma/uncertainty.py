"""First-order uncertainty of poles and mode shapes, without a Kronecker product.

The covariance of everything identified comes from how the lag covariances scatter over the time
blocks (`LagCovariances.deviations`): to first order a deviation ΔH moves the column space by
    ΔO = (I − U Uᵀ) ΔH V S⁻¹ + (a change of basis, which moves no pole and no shape),
the state matrix by
    ΔA = O_up⁺ (ΔO_down − ΔO_up A) + (O_upᵀ O_up)⁻¹ ΔO_upᵀ (O_down − O_up A),
a pole by Δλ = χᵀ ΔA ψ and an eigenvector by Δψ_i = Σ_{j≠i} ψ_j χ_jᵀ ΔA ψ_i / (λ_i − λ_j).
The first leaves out the singular values beyond the order. Why: kept, they put
1/(s_n² − s_{n+1}²) into the derivative, which is far larger than the true scatter wherever an
order cuts through the nearly equal singular values of the noise.

Each block's ΔH gives one column; the columns F of a mode satisfy cov = F Fᵀ, and the same columns
serve all modes, so covariances between modes come for free.

Why it is cheap: w = V S⁻¹ ψ lies in the span of V S⁻¹ and everything ΔH w is multiplied with in
that of U and of its shifts, for every pole of every order. So each block's ΔH is projected once, to
a few matrices no larger than the highest order squared; the models of lower order use their leading
parts, and neither a pole nor a shape ever meets the Hankel matrix again.
Source: Reynders, Pintelon, De Roeck (2008), Mech. Syst. Signal Process. 22; Döhler and Mevel
(2013), Efficient multi-order uncertainty computation for stochastic subspace identification,
Mech. Syst. Signal Process. 38.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pipeline.oma.covariance import block_hankel
from pipeline.oma.ssi_cov import SignalSubspace, SystemModes

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating]


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedDeviations:
    """The deviations of the block Hankel matrix, projected on the signal subspace.

    With Y^(b) = ΔH^(b) V S⁻¹ for each time block b, n the highest order, and Y_up, Y_down without
    the last and the first block row:
    """

    subspace: SignalSubspace
    first_row: FloatArray  # Y's first block row, (n_blocks, n_channels, n)
    whole: FloatArray  # Uᵀ Y, (n_blocks, n, n)
    up_up: FloatArray  # O_upᵀ Y_up, (n_blocks, n, n)
    up_down: FloatArray  # O_upᵀ Y_down, (n_blocks, n, n)
    down_up: FloatArray  # O_downᵀ Y_up, (n_blocks, n, n)

    @property
    def n_blocks(self) -> int:
        return len(self.whole)


def projected_deviations(subspace: SignalSubspace, deviations: FloatArray) -> ProjectedDeviations:
    """Project every block's deviation of the Hankel matrix.

    deviations   ΔR, (n_blocks, n_lags, n_channels, n_references)

    Why in single precision: it is the costliest step, and a std needs no more than five digits.
    """
    l = subspace.n_channels  # noqa: E741  # the field's number of outputs
    block_rows = deviations.shape[1] // 2
    right = (subspace.right / subspace.singular_values).astype(np.float32)  # V S⁻¹
    single = deviations.astype(np.float32)
    left = subspace.left.astype(np.float32)
    upper, lower = left[:-l], left[l:]
    projected: list[list[NDArray[np.floating]]] = []
    for block in single:
        y = block_hankel(block, block_rows) @ right
        projected.append(
            [y[:l].copy(), left.T @ y, upper.T @ y[:-l], upper.T @ y[l:], lower.T @ y[:-l]]
        )
    return ProjectedDeviations(
        subspace,
        *(np.stack(matrices).astype(np.float64) for matrices in zip(*projected, strict=True)),
    )


@dataclass(frozen=True, slots=True, eq=False)
class OrderDeviations:
    """How the time blocks move the state matrix of one order; its modes are `modes`.

    With P = I − U Uᵀ of this order, (n_blocks, n, n) each:
        D₁ = O_upᵀ (P Y)_down,  D₂ = O_upᵀ (P Y)_up,  D₃ = O_downᵀ (P Y)_up
    and for a pole λ with eigenvector ψ, G = O_upᵀ O_up,
        G ΔA ψ = (D₁ − λ D₂) ψ + (D₃ − λ D₂)ᵀ ψ
    whose second part comes from the least-squares residual of O_up A = O_down.
    """

    modes: SystemModes
    gram: FloatArray  # G, (n, n)
    left_vectors: ComplexArray  # X, (n, n): Xᵀ A = diag(λ_d) Xᵀ, Xᵀ Ψ = I
    d_1: FloatArray
    d_2: FloatArray
    d_3: FloatArray
    first_row: FloatArray  # first block row of P Y, (n_blocks, n_channels, n)
    output: FloatArray  # C, (n_channels, n)


def order_deviations(projected: ProjectedDeviations, modes: SystemModes) -> OrderDeviations:
    """The leading parts of the projections, for the model of one order."""
    n, subspace = modes.order, projected.subspace
    upper, lower = subspace.upper[:, :n], subspace.lower[:, :n]
    output = subspace.left[: subspace.n_channels, :n]
    last = subspace.left[-subspace.n_channels :, :n]
    gram = np.eye(n) - last.T @ last  # O_upᵀ O_up, since UᵀU = I
    shifted = upper.T @ lower
    inside = projected.whole[:, :n, :n]  # Uᵀ Y: what P takes off
    return OrderDeviations(
        modes=modes,
        gram=gram,
        left_vectors=modes.left_eigenvectors(),
        d_1=projected.up_down[:, :n, :n] - shifted @ inside,
        d_2=projected.up_up[:, :n, :n] - gram @ inside,
        d_3=projected.down_up[:, :n, :n] - shifted.T @ inside,
        first_row=projected.first_row[:, :, :n] - output @ inside,
        output=output,
    )


def pole_deviations(order: OrderDeviations, chosen: NDArray[np.int64]) -> ComplexArray:
    """Δλ_d of chosen modes of one order by time block, (n_chosen, n_blocks).

    Δλ = χᵀ ΔA ψ = dᵀ (D₁ − λ D₂) ψ + ψᵀ (D₃ − λ D₂) d,   d = G⁻¹ χ

    As one product of D, (n_blocks, n²), with the outer products of d and ψ.
    """
    modes = order.modes
    psi = modes.right[:, chosen]
    dual = np.linalg.solve(order.gram, order.left_vectors[:, modes.kept[chosen]])
    forth = dual[:, None, :] * psi[None, :, :]
    back = forth.transpose(1, 0, 2)
    moved = _contracted(order.d_1, forth) + _contracted(order.d_3, back)
    moved -= modes.poles[chosen] * _contracted(order.d_2, forth + back)
    return np.asarray(moved.T)


def _contracted(real: FloatArray, columns: ComplexArray) -> ComplexArray:
    """Σ_ij real[b, i, j] columns[i, j, m], (n_blocks, n_modes), in real arithmetic."""
    n_modes = columns.shape[2]
    pairs = np.ascontiguousarray(columns).view(np.float64).reshape(-1, 2 * n_modes)
    return np.asarray((real.reshape(len(real), -1) @ pairs).view(np.complex128))


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyDamping:
    """Deviations of frequency and damping by time block, each (n_modes, n_blocks)."""

    frequency: FloatArray  # Δf [Hz]
    damping_ratio: FloatArray  # Δζ [-]

    @property
    def frequency_std(self) -> FloatArray:
        """(n_modes,) [Hz]"""
        return np.linalg.norm(self.frequency, axis=1)


def frequency_damping_deviations(
    poles: ComplexArray, deviations: ComplexArray, sampling_interval: float
) -> FrequencyDamping:
    """Δf and Δζ from Δλ_d.

    λ = log(λ_d)/dt,  Δλ = Δλ_d/(λ_d dt),
    Δf = Re(λ* Δλ) / (2π |λ|),   Δζ = (Re λ · Δ|λ| − |λ| · Re Δλ) / |λ|²
    """
    continuous = (np.log(poles) / sampling_interval)[:, None]
    change = deviations / (poles[:, None] * sampling_interval)
    magnitude = np.abs(continuous)
    magnitude_change = (continuous.conj() * change).real / magnitude
    return FrequencyDamping(
        frequency=magnitude_change / (2 * np.pi),
        damping_ratio=(continuous.real * magnitude_change - magnitude * change.real) / magnitude**2,
    )


def shape_deviations(order: OrderDeviations, chosen: NDArray[np.int64]) -> ComplexArray:
    """Δφ of chosen modes of one order by time block, (n_chosen, n_channels, n_blocks), complex.

    Δφ = ΔC ψ + C Δψ, with ΔC the first block row of P Y
    """
    modes = order.modes
    psi, poles = modes.right[:, chosen], modes.poles[chosen]
    # G ΔA ψ, (n_blocks, n, n_chosen)
    change = _applied(order.d_1, psi) + _applied(order.d_3.transpose(0, 2, 1), psi)
    change -= poles * _applied(order.d_2 + order.d_2.transpose(0, 2, 1), psi)
    distance = poles - modes.all_poles[:, None]
    distance[modes.kept[chosen], np.arange(len(chosen))] = np.inf  # ψ itself keeps its scale
    left = np.linalg.solve(order.gram, order.left_vectors).T  # Xᵀ G⁻¹
    shapes = order.output @ modes.all_right  # C Ψ
    # each mode's map from G ΔA ψ to C Δψ, (n_chosen, n_channels, n)
    to_shape = (shapes / distance.T[:, None, :]) @ left
    turned = to_shape @ change.transpose(2, 1, 0)
    return np.asarray(_applied(order.first_row, psi).transpose(2, 1, 0) + turned)


def _applied(real: FloatArray, columns: ComplexArray) -> ComplexArray:
    """real[b] @ columns for every block, (n_blocks, rows, n_columns), in real arithmetic."""
    pairs = np.ascontiguousarray(columns).view(np.float64)
    return np.asarray((real @ pairs).view(np.complex128))
