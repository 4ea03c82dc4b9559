"""First-order uncertainty of poles and mode shapes, without a Kronecker product.

The covariance of everything identified comes from how the lag covariances scatter over the time
blocks (`LagCovariances.deviations`): to first order a deviation ΔH moves the column space by
    ΔO = (I − U Uᵀ) ΔH V S⁻¹ + (a change of basis, which moves no pole and no shape),
the state matrix by
    ΔA = O_up⁺ (ΔO_down − ΔO_up A) + (O_upᵀ O_up)⁻¹ ΔO_upᵀ (O_down − O_up A),
a pole by Δλ = χᵀ ΔA ψ and an eigenvector by Δψ_i = Σ_{j≠i} ψ_j χ_jᵀ ΔA ψ_i / (λ_i − λ_j).
Each block's ΔH gives one column; the columns F of a mode satisfy cov = F Fᵀ, and the same columns
serve all modes, so covariances between modes come for free.

Why it is cheap: Δλ = bᵀ ΔH w + b₂ᵀ ΔH w₂ with four vectors a pole, and bᵀ ΔH w = Σ_τ ⟨g_τ, ΔR_τ⟩
with g the convolution of b and w. All poles of an order then take one matrix product.
Source: Reynders, Pintelon, De Roeck (2008), Mech. Syst. Signal Process. 22; Döhler and Mevel
(2013), Efficient multi-order uncertainty computation for stochastic subspace identification,
Mech. Syst. Signal Process. 38.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from pipeline.oma.ssi_cov import SignalSubspace, SystemModes

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complex128]


@dataclass(frozen=True, slots=True, eq=False)
class PoleSensitivity:
    """The four vectors by which deviations of the Hankel matrix move each pole of one order.

    Δλ_d = bᵀ ΔH w + b₂ᵀ ΔH w₂; all arrays have the modes along their last axis.
    """

    b: ComplexArray  # ((p + 1)·n_channels, n_modes)
    w: ComplexArray  # (p·n_references, n_modes)
    b_residual: ComplexArray  # b₂, like b: from the least-squares residual of O_up A = O_down
    w_residual: ComplexArray  # w₂, like w


def pole_sensitivity(
    subspace: SignalSubspace, modes: SystemModes, chosen: NDArray[np.bool_] | NDArray[np.int64]
) -> PoleSensitivity:
    """Sensitivities of the chosen poles (mask or indices) of one order.

    With a = O_up (O_upᵀ O_up)⁻¹ χ, r = (O_down − O_up A) ψ and P = I − U Uᵀ:
        b = P ([0; a] − λ [a; 0]),  w = V S⁻¹ ψ,  b₂ = P [r; 0],  w₂ = V S⁻¹ (O_upᵀ O_up)⁻¹ χ
    """
    n, l = modes.order, subspace.n_channels  # noqa: E741  # l: the field's number of outputs
    U, upper, lower = subspace.left[:, :n], subspace.upper[:, :n], subspace.lower[:, :n]
    weighted_right = subspace.right[:, :n] / subspace.singular_values[:n]  # V S⁻¹
    gram = linalg.cho_factor(upper.T @ upper, check_finite=False)
    poles, right = modes.poles[chosen], modes.right[:, chosen]
    dual = linalg.cho_solve(gram, modes.left[:, chosen], check_finite=False)
    a = upper @ dual
    zeros = np.zeros((l, a.shape[1]))
    residual = lower @ right - (upper @ right) * poles
    return PoleSensitivity(
        b=_outside(U, np.vstack([zeros, a]) - poles * np.vstack([a, zeros])),
        w=weighted_right @ right,
        b_residual=_outside(U, np.vstack([residual, zeros])),
        w_residual=weighted_right @ dual,
    )


def _outside(U: FloatArray, vectors: ComplexArray) -> ComplexArray:
    """(I − U Uᵀ) vectors: the part that leaves the column space."""
    return np.asarray(vectors - U @ (U.T @ vectors))


def pole_deviations(
    sensitivity: PoleSensitivity, deviations: FloatArray, n_channels: int
) -> ComplexArray:
    """Δλ_d of every mode by time block, (n_modes, n_blocks).

    deviations   ΔR, (n_blocks, n_lags, n_channels, n_references)
    """
    n_blocks, n_lags, _, n_references = deviations.shape
    gradient = _convolved(sensitivity.b, sensitivity.w, n_lags, n_channels, n_references)
    gradient += _convolved(
        sensitivity.b_residual, sensitivity.w_residual, n_lags, n_channels, n_references
    )
    flat = deviations.reshape(n_blocks, -1).T
    gradient = gradient.reshape(len(gradient), n_lags * n_channels * n_references)
    return np.asarray(gradient.real @ flat + 1j * (gradient.imag @ flat))


def _convolved(
    b: ComplexArray, w: ComplexArray, n_lags: int, n_channels: int, n_references: int
) -> ComplexArray:
    """g_τ = Σ_{i+j+1=τ} b_i w_jᵀ, (n_modes, n_lags, n_channels, n_references)."""
    n_modes = b.shape[1]
    b_spectrum = fft.fft(b.T.reshape(n_modes, len(b) // n_channels, n_channels), n_lags, axis=1)
    w_spectrum = fft.fft(w.T.reshape(n_modes, len(w) // n_references, n_references), n_lags, axis=1)
    product = b_spectrum[:, :, :, None] * w_spectrum[:, :, None, :]
    return np.asarray(fft.ifft(product, axis=1, overwrite_x=True))


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


def shape_deviations(
    subspace: SignalSubspace,
    modes: SystemModes,
    sensitivity: PoleSensitivity,
    deviations: FloatArray,
    mode: int,
) -> ComplexArray:
    """Δφ of one mode of one order by time block, (n_channels, n_blocks), complex.

    sensitivity   of this mode alone
    deviations    ΔR, (n_blocks, n_lags, n_channels, n_references)
    mode          its index among the order's modes

        Δφ = ΔC ψ + C Δψ, with ΔO ψ = P ΔH V S⁻¹ ψ and ΔC its first block row
    """
    n, l = modes.order, subspace.n_channels  # noqa: E741
    U, upper = subspace.left[:, :n], subspace.upper[:, :n]
    pole = modes.poles[mode]
    moved = _outside(U, hankel_products(deviations, sensitivity.w[:, 0]))  # ΔO ψ
    turned = transposed_hankel_products(deviations, sensitivity.b_residual[:, 0])
    through_residual = (subspace.right[:, :n].T @ turned) / subspace.singular_values[:n, None]
    state_change = linalg.solve(  # ΔA ψ
        upper.T @ upper,
        upper.T @ (moved[l:] - pole * moved[:-l]) + through_residual,
        assume_a="pos",
        check_finite=False,
    )
    distance = pole - modes.all_poles
    distance[np.argmin(np.abs(distance))] = np.inf  # ψ itself keeps its scale
    vector_change = modes.all_right @ ((modes.all_left.T @ state_change) / distance[:, None])
    return np.asarray(moved[:l] + subspace.left[:l, :n] @ vector_change)


def hankel_products(covariances: FloatArray, vector: ComplexArray) -> ComplexArray:
    """H^(b) w for the Hankel matrix of every time block, ((p + 1)·n_channels, n_blocks).

    covariances   (n_blocks, n_lags = 2p, n_channels, n_references)
    vector        w, (p·n_references,)

    By FFT along the lags: (H w)_i = Σ_j R_{i+j+1} w_j.
    """
    n_blocks, n_lags, _, n_references = covariances.shape
    rows = len(vector) // n_references
    reversed_blocks = vector.reshape(rows, n_references)[::-1]
    product = np.einsum(
        "blij,lj->bli",
        fft.fft(covariances, axis=1),
        fft.fft(reversed_blocks, n_lags, axis=0),
        optimize=True,
    )
    valid = fft.ifft(product, axis=1)[:, rows - 1 :]
    return np.asarray(valid.reshape(n_blocks, -1).T)


def transposed_hankel_products(covariances: FloatArray, vector: ComplexArray) -> ComplexArray:
    """H^(b)ᵀ b for the Hankel matrix of every time block, (p·n_references, n_blocks)."""
    return hankel_products(covariances.transpose(0, 1, 3, 2), vector)
