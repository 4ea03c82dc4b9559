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

from pipeline.oma.ssi.ssi_cov import SignalSubspace, SystemModes
from sensors.arrays import ComplexArray, FloatArray, RealArray


@dataclass(frozen=True, slots=True, eq=False)
class ProjectedDeviations:
    """The deviations of the block Hankel matrix, projected on the signal subspace.

    With Y^(b) = ΔH^(b) V S⁻¹ for each time block b, n the highest order, Y_up and Y_down without
    the last and the first block row, the models of every order need only
        D = O_upᵀ Y_down + Y_upᵀ O_down,   E = O_upᵀ Y_up + Y_upᵀ O_up,   W = Uᵀ Y
    or their leading parts. The column of each is the first axis: what an order uses is then one
    matrix in memory, ready to be multiplied.
    """

    subspace: SignalSubspace
    gram: FloatArray
    """G = O_upᵀ O_up, (n, n)."""
    shift: FloatArray
    """K = O_upᵀ O_down, (n, n)."""
    moving: FloatArray
    """D, E and Wᵀ side by side, (n columns, 3, n rows, n_blocks)."""
    inside: FloatArray
    """W, (n columns, n rows, n_blocks)."""
    first_row: FloatArray
    """Y's first block row, (n columns, n_channels, n_blocks)."""

    @property
    def n_blocks(self) -> int:
        """Time blocks of the window."""
        return self.inside.shape[2]


def projected_deviations(
    subspace: SignalSubspace, deviations: FloatArray, *, precision: type[np.floating] = np.float32
) -> ProjectedDeviations:
    """Project every block's deviation of the Hankel matrix.

    Parameters
    ----------
    subspace : SignalSubspace
        Of the mean lag covariances.
    deviations : ndarray, shape (n_blocks, n_lags, n_channels, n_references)
        ΔR of each time block.
    precision : type, optional
        Of the products with the Hankel matrix.

    Notes
    -----
    Why single precision: it is the costliest step, and what it changes in a std is a hundred times
    less than what the std scatters by anyway, having been estimated from n_blocks blocks.
    """
    l = subspace.n_channels  # noqa: E741  # the field's number of outputs
    y = _images(deviations, (subspace.right / subspace.singular_values).astype(precision))
    left = subspace.left.astype(precision)
    upper, lower = left[:-l], left[l:]
    n = left.shape[1]

    def projected(basis: RealArray, rows: RealArray) -> FloatArray:
        product = basis.T @ rows.reshape(len(rows), -1)  # one product for all blocks
        return _double(product.reshape(n, -1, n))

    up_up = projected(upper, y[:-l])
    inside = up_up + projected(left[-l:], y[-l:])
    there = projected(upper, y[l:]) + _transposed(projected(lower, y[:-l]))
    moving = np.stack([there, up_up + _transposed(up_up), _transposed(inside)], axis=1)
    last = subspace.left[-l:]
    return ProjectedDeviations(
        subspace,
        gram=np.eye(n) - last.T @ last,  # since UᵀU = I
        shift=subspace.upper.T @ subspace.lower,
        moving=moving,
        inside=inside,
        first_row=_double(y[:l]),
    )


def _images(deviations: FloatArray, right: RealArray) -> RealArray:
    """Y = ΔH V S⁻¹ of every block, ((p + 1)·n_channels, n_blocks, n).

    Block row i of ΔH is the run of lags i + 1 to i + p: in memory a slice of what it is made of, so
    that no Hankel matrix is formed.
    """
    n_blocks, n_lags, n_channels, n_references = deviations.shape
    by_channel = deviations.transpose(2, 0, 1, 3).astype(right.dtype, order="C")
    runs = by_channel.reshape(n_channels * n_blocks, n_lags * n_references)
    rows, width = n_lags // 2, len(right)
    images = np.empty((rows + 1, len(runs), right.shape[1]), dtype=right.dtype)
    for i, image in enumerate(images):
        np.matmul(runs[:, i * n_references : i * n_references + width], right, out=image)
    return images.reshape((rows + 1) * n_channels, n_blocks, -1)


def _double(single: RealArray) -> FloatArray:
    """(rows, n_blocks, columns) as (columns, rows, n_blocks), in double precision."""
    return np.ascontiguousarray(single.transpose(2, 0, 1), dtype=np.float64)


def _transposed(real: FloatArray) -> FloatArray:
    return real.transpose(1, 0, 2)


@dataclass(frozen=True, slots=True, eq=False)
class OrderDeviations:
    """How the time blocks move the state matrix of one order; its modes are `modes`.

    With P = I − U Uᵀ of this order and for a pole λ with eigenvector ψ:
        G ΔA ψ = O_upᵀ ((P Y)_down − λ (P Y)_up) ψ + ((O_down − λ O_up)ᵀ (P Y)_up)ᵀ ψ
               = (D − λ E) ψ − Wᵀ (K − λ G) ψ − (K − λ G) W ψ
    whose second part comes from the least-squares residual of O_up A = O_down.
    """

    modes: SystemModes
    gram: FloatArray
    """G, (n, n)."""
    shift: FloatArray
    """K, (n, n)."""
    dual: ComplexArray
    """G⁻¹ X, (n, n), with Xᵀ A = diag(λ_d) Xᵀ, Xᵀ Ψ = I."""
    projected: ProjectedDeviations


def order_deviations(projected: ProjectedDeviations, modes: SystemModes) -> OrderDeviations:
    """What the model of one order takes of the projections."""
    n = modes.order
    gram = projected.gram[:n, :n]
    return OrderDeviations(
        modes=modes,
        gram=gram,
        shift=projected.shift[:n, :n],
        dual=np.linalg.inv(modes.all_right.T @ gram).astype(np.complex128, copy=False),
        projected=projected,
    )


@dataclass(frozen=True, slots=True, eq=False)
class StateDeviations:
    """G ΔA ψ of chosen modes of one order by time block, in two parts:

    G ΔA ψ = direct − (K − λ G) inside,   inside = W ψ
    """

    order: OrderDeviations
    chosen: NDArray[np.int64]
    """Places among the order's modes, (n_chosen,)."""
    direct: ComplexArray
    """(n_chosen, n, n_blocks)."""
    inside: ComplexArray
    """(n_chosen, n, n_blocks)."""

    def seen_by(
        self, functionals: ComplexArray, of_inside: FloatArray | float = 0.0
    ) -> ComplexArray:
        """Linear functions of G ΔA ψ, less others of W ψ, (n_chosen, n_functions, n_blocks).

        Parameters
        ----------
        functionals : ndarray, shape (n_chosen, n_functions, n)
            Of G ΔA ψ.
        of_inside : ndarray, shape (n_functions, n), optional
            Of W ψ; none by default.
        """
        poles = self.order.modes.poles[self.chosen, None, None]
        through = functionals @ self.order.shift - poles * (functionals @ self.order.gram)
        return np.asarray(functionals @ self.direct - (through + of_inside) @ self.inside)


def state_deviations(order: OrderDeviations, chosen: NDArray[np.int64]) -> StateDeviations:
    """How the time blocks move the state matrix, as far as chosen modes feel it."""
    psi, poles = order.modes.right[:, chosen], order.modes.poles[chosen]
    turned = order.shift @ psi - poles * (order.gram @ psi)
    coefficients = np.stack([psi, -poles * psi, -turned], axis=1)  # of D, E and Wᵀ, as in `moving`
    return StateDeviations(
        order,
        chosen,
        direct=_combined(order.projected.moving, coefficients),
        inside=_combined(order.projected.inside[:, None], psi[:, None]),
    )


def _combined(stacked: FloatArray, coefficients: ComplexArray) -> ComplexArray:
    """Σ_jk stacked[j, k, i, b] coefficients[j, k, m], (n_modes, n, n_blocks), in real arithmetic.

    coefficients (n, n_kinds, n_modes) of an order n no higher than the stack's
    """
    n, n_kinds, n_modes = coefficients.shape
    n_blocks = stacked.shape[3]
    columns = stacked[:n].reshape(n * n_kinds, -1)[:, : n * n_blocks]  # rows i < n of each
    by_mode = coefficients.reshape(n * n_kinds, n_modes).T
    parts = np.concatenate([by_mode.real, by_mode.imag]) @ columns
    combined = np.empty((n_modes, n * n_blocks), dtype=np.complex128)
    combined.real, combined.imag = parts[:n_modes], parts[n_modes:]
    return combined.reshape(n_modes, n, n_blocks)


def pole_deviations(moved: StateDeviations) -> ComplexArray:
    """Δλ_d of the chosen modes by time block, (n_chosen, n_blocks).

    Δλ = χᵀ ΔA ψ = dᵀ (G ΔA ψ),  d = G⁻¹ χ
    """
    dual = moved.order.dual[:, moved.order.modes.kept[moved.chosen]]
    return moved.seen_by(dual.T[:, None, :])[:, 0]


def shape_deviations(moved: StateDeviations) -> ComplexArray:
    """Δφ of the chosen modes by time block, (n_chosen, n_channels, n_blocks), complex.

    Δφ = ΔC ψ + C Δψ, with ΔC the first block row of P Y, that of Y less C W
    """
    order, chosen = moved.order, moved.chosen
    modes, subspace = order.modes, order.projected.subspace
    output = subspace.left[: subspace.n_channels, : modes.order]  # C
    distance = modes.poles[chosen] - modes.all_poles[:, None]
    distance[modes.kept[chosen], np.arange(len(chosen))] = np.inf  # ψ itself keeps its scale
    # each mode's map from G ΔA ψ to C Δψ, (n_chosen, n_channels, n)
    to_shape = (output @ modes.all_right / distance.T[:, None, :]) @ order.dual.T
    return _first_row(order.projected, modes.right[:, chosen]) + moved.seen_by(to_shape, output)


def _first_row(projected: ProjectedDeviations, psi: ComplexArray) -> ComplexArray:
    """Y's first block row times ψ, (n_modes, n_channels, n_blocks)."""
    n, n_modes = psi.shape
    columns = projected.first_row[:n].reshape(n, -1)
    product = psi.T.real @ columns + 1j * (psi.T.imag @ columns)
    return np.asarray(product.reshape(n_modes, *projected.first_row.shape[1:]))


@dataclass(frozen=True, slots=True, eq=False)
class FrequencyDamping:
    """Deviations of frequency and damping by time block, each (n_modes, n_blocks)."""

    frequency: FloatArray
    """Δf [Hz]."""
    damping_ratio: FloatArray
    """Δζ [-]."""

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
