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
    right = _lags_last(subspace.right / subspace.singular_values, block_rows)  # V S⁻¹
    # (n_blocks, n_channels, n_references, n_lags): rows of the Hankel matrix are then copied as
    # runs of lags, several times as fast as one lag at a time
    single = np.ascontiguousarray(deviations.transpose(0, 2, 3, 1), dtype=np.float32)
    left = subspace.left.astype(np.float32)
    upper, lower = left[:-l], left[l:]
    projected: list[list[NDArray[np.floating]]] = []
    for block in single:
        y = _hankel_rows(block, block_rows) @ right
        projected.append(
            [y[:l].copy(), left.T @ y, upper.T @ y[:-l], upper.T @ y[l:], lower.T @ y[:-l]]
        )
    return ProjectedDeviations(
        subspace,
        *(np.stack(matrices).astype(np.float64) for matrices in zip(*projected, strict=True)),
    )


def _lags_last(rows: FloatArray, block_rows: int) -> NDArray[np.float32]:
    """Rows (lag, reference) reordered to (reference, lag), (p·n_references, n)."""
    by_lag = rows.reshape(block_rows, -1, rows.shape[1])
    return np.ascontiguousarray(by_lag.transpose(1, 0, 2), dtype=np.float32).reshape(rows.shape)


def _hankel_rows(block: NDArray[np.float32], block_rows: int) -> NDArray[np.float32]:
    """The block Hankel matrix of one block's ΔR, (n_channels, n_references, n_lags), with its
    columns in the order (reference, lag)."""
    n_channels, n_references, _ = block.shape
    windows = np.lib.stride_tricks.sliding_window_view(block, block_rows, axis=2)
    return np.ascontiguousarray(windows.transpose(2, 0, 1, 3)).reshape(
        (block_rows + 1) * n_channels, n_references * block_rows
    )


@dataclass(frozen=True, slots=True, eq=False)
class OrderDeviations:
    """How the time blocks move the state matrix of one order; its modes are `modes`.

    With P = I − U Uᵀ of this order, K = O_upᵀ O_down, G = O_upᵀ O_up and for a pole λ with
    eigenvector ψ:
        G ΔA ψ = O_upᵀ ((P Y)_down − λ (P Y)_up) ψ + ((O_down − λ O_up)ᵀ (P Y)_up)ᵀ ψ
    whose second part comes from the least-squares residual of O_up A = O_down. What P takes off
    is (K − λ G) Uᵀ Y ψ of the first part and (Uᵀ Y)ᵀ (K − λ G) ψ of the second.
    """

    modes: SystemModes
    gram: FloatArray  # G, (n, n)
    shift: FloatArray  # K, (n, n)
    left_vectors: ComplexArray  # X, (n, n): Xᵀ A = diag(λ_d) Xᵀ, Xᵀ Ψ = I
    projected: ProjectedDeviations

    def part(self, name: str) -> FloatArray:
        """The leading part of a projection that this order uses, (n_blocks, n, n)."""
        n = self.modes.order
        return np.asarray(getattr(self.projected, name)[:, :n, :n])


def order_deviations(projected: ProjectedDeviations, modes: SystemModes) -> OrderDeviations:
    """What the model of one order takes of the projections."""
    n, subspace = modes.order, projected.subspace
    last = subspace.left[-subspace.n_channels :, :n]
    return OrderDeviations(
        modes=modes,
        gram=np.eye(n) - last.T @ last,  # O_upᵀ O_up, since UᵀU = I
        shift=subspace.upper[:, :n].T @ subspace.lower[:, :n],
        left_vectors=modes.left_eigenvectors(),
        projected=projected,
    )


def pole_deviations(order: OrderDeviations, chosen: NDArray[np.int64]) -> ComplexArray:
    """Δλ_d of chosen modes of one order by time block, (n_chosen, n_blocks).

    Δλ = χᵀ ΔA ψ = dᵀ (G ΔA ψ),  d = G⁻¹ χ: products of the projections, (n_blocks, n²), with the
    outer products of d and ψ.
    """
    modes = order.modes
    psi, poles = modes.right[:, chosen], modes.poles[chosen]
    dual = np.linalg.solve(order.gram, order.left_vectors[:, modes.kept[chosen]])
    left = order.shift.T @ dual - poles * (order.gram @ dual)
    right = order.shift @ psi - poles * (order.gram @ psi)
    forth = _outer(dual, psi)
    back = forth.transpose(1, 0, 2)
    moved = (
        _contracted(order.part("up_down"), forth)
        + _contracted(order.part("down_up"), back)
        - poles * _contracted(order.part("up_up"), forth + back)
        - _contracted(order.part("whole"), _outer(left, psi) + _outer(right, dual))
    )
    return np.asarray(moved.T)


def _outer(left: ComplexArray, right: ComplexArray) -> ComplexArray:
    """left[i, m] right[j, m], (n, n, n_modes)"""
    return np.asarray(left[:, None, :] * right[None, :, :])


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
    output = order.projected.subspace.left[: len(modes.shapes), : modes.order]  # C
    up_up, whole = order.part("up_up"), order.part("whole")
    inside = _applied(whole, psi)  # Uᵀ Y ψ
    right = order.shift @ psi - poles * (order.gram @ psi)
    change = (  # G ΔA ψ, (n_blocks, n, n_chosen)
        _applied(order.part("up_down"), psi)
        + _applied(order.part("down_up").transpose(0, 2, 1), psi)
        - poles * (_applied(up_up, psi) + _applied(up_up.transpose(0, 2, 1), psi))
        - (order.shift @ inside - poles * (order.gram @ inside))
        - _applied(whole.transpose(0, 2, 1), right)
    )
    distance = poles - modes.all_poles[:, None]
    distance[modes.kept[chosen], np.arange(len(chosen))] = np.inf  # ψ itself keeps its scale
    left = np.linalg.solve(order.gram, order.left_vectors).T  # Xᵀ G⁻¹
    shapes = output @ modes.all_right  # C Ψ
    # each mode's map from G ΔA ψ to C Δψ, (n_chosen, n_channels, n)
    to_shape = (shapes / distance.T[:, None, :]) @ left
    turned = to_shape @ change.transpose(2, 1, 0)
    output_change = _applied(order.projected.first_row[:, :, : modes.order], psi) - output @ inside
    return np.asarray(output_change.transpose(2, 1, 0) + turned)


def _applied(real: FloatArray, columns: ComplexArray) -> ComplexArray:
    """real[b] @ columns for every block, (n_blocks, rows, n_columns), in real arithmetic."""
    pairs = np.ascontiguousarray(columns).view(np.float64)
    return np.asarray((real @ pairs).view(np.complex128))
