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

Why it is cheap: Δλ = bᵀ ΔH w + b₂ᵀ ΔH w₂ with four vectors a pole, and bᵀ ΔH w = Σ_τ ⟨g_τ, ΔR_τ⟩
with g the convolution of b and w. All poles of an order then take one matrix product.
Source: Reynders, Pintelon, De Roeck (2008), Mech. Syst. Signal Process. 22; Döhler and Mevel
(2013), Efficient multi-order uncertainty computation for stochastic subspace identification,
Mech. Syst. Signal Process. 38.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from pipeline.oma.ssi_cov import SignalSubspace, SystemModes

FloatArray = NDArray[np.float64]
ComplexArray = NDArray[np.complexfloating]


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
    poles, right = modes.poles[chosen], modes.right[:, chosen]
    last = subspace.left[-l:, :n]
    gram = np.eye(n) - last.T @ last  # O_upᵀ O_up, since UᵀU = I
    dual = np.linalg.solve(gram, modes.left_eigenvectors()[:, modes.kept[chosen]])
    a, up_right = _times(upper, dual), _times(upper, right)
    b = np.zeros((len(U), len(poles)), dtype=complex)
    b[l:] = a
    b[:-l] -= poles * a
    b_residual = np.zeros_like(b)
    b_residual[:-l] = _times(lower, right) - up_right * poles
    s = subspace.singular_values[:n, None]
    return PoleSensitivity(
        b=_outside(U, b),
        w=_times(subspace.right[:, :n], right / s),
        b_residual=_outside(U, b_residual),
        w_residual=_times(subspace.right[:, :n], dual / s),
    )


def _times(real: FloatArray, columns: ComplexArray) -> ComplexArray:
    """Real matrix times complex columns, without making the matrix complex."""
    pairs = np.ascontiguousarray(columns).view(np.float64)
    return np.asarray((real @ pairs).view(np.complex128))


def _outside(U: FloatArray, vectors: ComplexArray) -> ComplexArray:
    """(I − U Uᵀ) vectors: the part that leaves the column space."""
    return np.asarray(vectors - _times(U, _times(U.T, vectors)))


def pole_deviations(sensitivity: PoleSensitivity, deviations: "BlockDeviations") -> ComplexArray:
    """Δλ_d of every mode by time block, (n_modes, n_blocks).

        Δλ_d = Σ_τ ⟨g_τ, ΔR_τ⟩,   g_τ = Σ_{i+j+1=τ} b_i w_jᵀ + (the same of b₂, w₂)

    Why single precision: this is the costliest step, and a std needs no more than six digits.
    """
    n_lags, n_channels, n_references = deviations.lag_shape

    def convolved(b: ComplexArray, w: ComplexArray) -> NDArray[np.complex64]:
        left, right = _spectra(b, n_channels, n_lags), _spectra(w, n_references, n_lags)
        return left[:, :, None] * right[:, None]

    spectrum = convolved(sensitivity.b, sensitivity.w)
    spectrum += convolved(sensitivity.b_residual, sensitivity.w_residual)
    gradient = fft.ifft(spectrum, axis=-1, overwrite_x=True)
    flat = gradient.reshape(len(gradient), n_lags * n_channels * n_references)
    return np.asarray(
        (flat.real @ deviations.by_entry + 1j * (flat.imag @ deviations.by_entry)),
        dtype=np.complex128,
    )


def _spectra(vectors: ComplexArray, width: int, length: int) -> NDArray[np.complex64]:
    """Spectra along the block rows, (n_modes, width, length)."""
    rows = vectors.T.reshape(vectors.shape[1], len(vectors) // width, width)
    return np.asarray(fft.fft(rows.transpose(0, 2, 1).astype(np.complex64), length, axis=-1))


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
    deviations: "BlockDeviations",
    chosen: NDArray[np.int64],
) -> ComplexArray:
    """Δφ of chosen modes of one order by time block, (n_chosen, n_channels, n_blocks), complex.

    sensitivity   of the chosen modes
    chosen        their indices among the order's modes

        Δφ = ΔC ψ + C Δψ, with ΔO ψ = P ΔH V S⁻¹ ψ and ΔC its first block row
    """
    n, l = modes.order, subspace.n_channels  # noqa: E741
    U, upper = subspace.left[:, :n], subspace.upper[:, :n]
    gram, all_left = upper.T @ upper, modes.left_eigenvectors()
    moved_all = deviations.hankel_products(sensitivity.w)
    turned_all = deviations.transposed_hankel_products(sensitivity.b_residual)
    changes = []
    for place, mode in enumerate(chosen):
        pole = modes.poles[mode]
        moved = _outside(U, moved_all[place])  # ΔO ψ
        through_residual = _times(subspace.right[:, :n].T, turned_all[place])
        through_residual /= subspace.singular_values[:n, None]
        state_change = np.linalg.solve(  # ΔA ψ
            gram, _times(upper.T, moved[l:] - pole * moved[:-l]) + through_residual
        )
        distance = pole - modes.all_poles
        distance[np.argmin(np.abs(distance))] = np.inf  # ψ itself keeps its scale
        vector_change = modes.all_right @ ((all_left.T @ state_change) / distance[:, None])
        changes.append(moved[:l] + subspace.left[:l, :n] @ vector_change)
    return np.array(changes)


class BlockDeviations:
    """What the deviations of the time blocks do to poles and vectors.

    The Hankel matrices of the blocks are never formed: (ΔH w)_i = Σ_j ΔR_{i+j+1} w_j is a
    convolution with w reversed, done by FFT along the lags.
    """

    def __init__(self, deviations: FloatArray):
        """deviations: ΔR, (n_blocks, n_lags, n_channels, n_references)"""
        n_blocks, n_lags, n_channels, n_references = deviations.shape
        self.lag_shape = (n_lags, n_channels, n_references)
        entries = deviations.transpose(2, 3, 1, 0).reshape(-1, n_blocks)
        self.by_entry = entries.astype(np.float32)  # (n_channels·n_references·n_lags, n_blocks)
        self._n_lags = n_lags
        self._spectrum = fft.rfft(deviations, axis=1).transpose(1, 0, 2, 3)

    def hankel_products(self, vectors: ComplexArray) -> ComplexArray:
        """ΔH^(b) w of every block; vectors (p·n_ref, n), (n, (p + 1)·n_ch, n_blocks)."""
        return self._products(self._spectrum, vectors)

    def transposed_hankel_products(self, vectors: ComplexArray) -> ComplexArray:
        """ΔH^(b)ᵀ b of every block; vectors ((p + 1)·n_ch, n), (n, p·n_ref, n_blocks)."""
        return self._products(self._spectrum.transpose(0, 1, 3, 2), vectors)

    def _products(self, spectrum: ComplexArray, vectors: ComplexArray) -> ComplexArray:
        n_freq, n_blocks, n_out, n_in = spectrum.shape
        rows, n_vectors = len(vectors) // n_in, vectors.shape[1]
        pairs = np.ascontiguousarray(vectors).view(np.float64).reshape(rows, n_in, -1)
        turned = fft.rfft(pairs[::-1], self._n_lags, axis=0)
        product = np.ascontiguousarray(spectrum).reshape(n_freq, n_blocks * n_out, n_in) @ turned
        valid = fft.irfft(product, self._n_lags, axis=0, overwrite_x=True)[rows - 1 :]
        by_block = valid.reshape(len(valid), n_blocks, n_out, 2 * n_vectors).view(np.complex128)
        return np.asarray(
            by_block.transpose(3, 0, 2, 1).reshape(n_vectors, len(valid) * n_out, n_blocks)
        )
