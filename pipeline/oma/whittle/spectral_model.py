"""Spectral matrix of a few close modes in a narrow band, with its derivatives.

Each mode is one complex coordinate q' = λ q + w with w white, E[w wᴴ] = S over the modes. Beside
the modes a band holds a flat background N: the channels' noise, and what modes of other frequencies
add quasi-statically. Of a window of duration T the expected periodogram at line k is

    E_k = Φ Q_k Φᵀ + N,   Q_k = K_k (U_k P + P U_kᴴ) K_k,   P_jl = S_jl / (−λ_j − λ_l*)
    U_k = diag(u(σ)),  u = −1/σ + (e^σ − 1)/σ²,  σ = (λ_j − 2πi k/T) T
    K_k = diag((k/k̄)^((c_j + 1)/2) (ν_j + k̄)/(ν_j + k))

whose u holds what the finite window leaks: 1/(iω − λ) would broaden a mode that decays as slowly as
the window lasts. K holds the response's other pole, near −ν, which tells at damping of 4 % and
more, and the colour c: near the resonance power goes with k^c, of the force and of what is
measured; accelerations under a white force have 3, displacements −1. Left out, the tails of a mode
would pull its frequency by a share of its std. One colour for two modes pulls both: a tower's
fore-aft mode stands on the steep side of a sea's spectrum that its side-side mode hardly feels.
With R = (I + Φᵀ N⁻¹ Φ Q)⁻¹,

    E⁻¹ = N⁻¹ − N⁻¹ Φ Q R Φᵀ N⁻¹,   Φᵀ E⁻¹ = R Φᵀ N⁻¹

so that all is done in matrices as small as the number of modes.
Source: Au (2012), Fast Bayesian ambient modal identification in the frequency domain, Mech. Syst.
Signal Process. 26; the expected periodogram after Sykulski et al. (2019), The debiased Whittle
likelihood, Biometrika 106.
"""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from sensors.arrays import ComplexArray, FloatArray, IntArray


@dataclass(frozen=True, slots=True, eq=False)
class CloseModes:
    """Parameters of the modes of a band. Frequencies and half bandwidths in lines 1/T."""

    positions: FloatArray
    """ν, damped natural frequency × T, (n_modes,) [-]."""
    half_widths: FloatArray
    """b = ζ f T, (n_modes,) [-]."""
    shapes: FloatArray
    """φ of the scaled channels, (n_channels, n_modes), largest component 1 [-]."""
    forces: ComplexArray
    """C, lower triangular with real positive diagonal, S = C Cᴴ, (n_modes, n_modes)."""
    colours: FloatArray
    """c of each mode's power, (n_modes,) [-]."""
    noise: FloatArray
    """N, (n_channels, n_channels), symmetric, positive definite."""

    @property
    def n_modes(self) -> int:
        """Modes of the band."""
        return len(self.positions)

    @property
    def units(self) -> IntArray:
        """Component of each shape that is held at 1, (n_modes,)."""
        return np.argmax(np.abs(self.shapes), axis=0)

    def normalised(self) -> "CloseModes":
        """The same modes with the largest component of each shape 1."""
        largest = self.shapes[self.units, np.arange(self.n_modes)]
        forces = self.forces * largest[:, None]
        forces = forces * np.where(np.diag(forces).real < 0, -1.0, 1.0)[None, :]
        return replace(self, shapes=self.shapes / largest, forces=forces)


@dataclass(frozen=True, slots=True, eq=False)
class ModalSpectra:
    """Q_k of the modal coordinates at each line."""

    values: ComplexArray
    """Q, (n_lines, n_modes, n_modes)."""
    derivatives: ComplexArray
    """By ν and ln b of each mode, C's parameters and each c, (n_lines, n_inner, n_modes,
    n_modes)."""


def leaked(sigma: ComplexArray) -> tuple[ComplexArray, ComplexArray]:
    """u(σ) and its derivative."""
    e = np.exp(sigma)
    u = -1 / sigma + (e - 1) / sigma**2
    return u, (1 + e) / sigma**2 - 2 * (e - 1) / sigma**3


def modal_spectra(modes: CloseModes, numbers: FloatArray) -> ComplexArray:
    """Q_k alone, (n_lines, n_modes, n_modes)."""
    lam = 2 * np.pi * (-modes.half_widths + 1j * modes.positions)
    u, _ = leaked(lam[None, :] - 2j * np.pi * numbers[:, None])
    p = modes.forces @ modes.forces.conj().T / -(lam[:, None] + lam[None, :].conj())
    return np.asarray(tints(modes, numbers) * (u[:, :, None] * p + p * u[:, None, :].conj()))


def tints(modes: CloseModes, numbers: FloatArray) -> FloatArray:
    """K_j K_l of each line and two modes, (n_lines, n_modes, n_modes)."""
    root = np.exp(0.5 * log_numbers(numbers)[:, None] * (modes.colours + 1))
    root *= (modes.positions + numbers.mean()) / (modes.positions + numbers[:, None])
    return np.asarray(root[:, :, None] * root[:, None, :])


def log_numbers(numbers: FloatArray) -> FloatArray:
    """ln(k/k̄), (n_bins,)."""
    return np.asarray(np.log(numbers / numbers.mean()))


def expected_matrices(modes: CloseModes, numbers: FloatArray) -> ComplexArray:
    """E_k, (n_lines, n_channels, n_channels)."""
    return np.asarray(modes.shapes @ modal_spectra(modes, numbers) @ modes.shapes.T + modes.noise)


def with_derivatives(modes: CloseModes, numbers: FloatArray) -> ModalSpectra:
    """Q_k and its derivatives by ν and ln b of each mode; ln of C's diagonal; real and imaginary
    part of each of C's components below it, row by row; c of each mode."""
    m, each = modes.n_modes, np.arange(modes.n_modes)
    lam = 2 * np.pi * (-modes.half_widths + 1j * modes.positions)
    u, du = leaked(lam[None, :] - 2j * np.pi * numbers[:, None])
    left, right = u[:, :, None], u[:, None, :].conj()
    decay = -(lam[:, None] + lam[None, :].conj())
    p = modes.forces @ modes.forces.conj().T / decay
    poles = np.concatenate([np.full(m, 2j * np.pi), -2 * np.pi * modes.half_widths])
    dp = np.concatenate([_by_poles(p / decay, poles), _by_forces(modes.forces) / decay])
    by_each = np.zeros((len(numbers), n_inner(m), m, m), dtype=complex)
    found, coloured = by_each[:, :-m], by_each[:, -m:]
    np.multiply(left[:, None], dp, out=found)
    found += dp * right[:, None]
    moved = du[:, :, None] * p
    for first in (0, m):
        step = poles[first : first + m, None]
        found[:, first + each, each, :] += step * moved
        found[:, first + each, :, each] += (step * moved).conj().transpose(1, 0, 2)
    plain = left * p + p * right
    mirrored = 1 / (modes.positions + numbers.mean()) - 1 / (modes.positions + numbers[:, None])
    found[:, each, each, :] += mirrored[:, :, None] * plain
    found[:, each, :, each] += (mirrored[:, None, :] * plain).transpose(2, 0, 1)
    half = 0.5 * log_numbers(numbers)[:, None, None] * plain
    coloured[:, each, each, :] += half
    coloured[:, each, :, each] += half.transpose(2, 0, 1)
    tint = tints(modes, numbers)
    by_each *= tint[:, None]
    return ModalSpectra(tint * plain, by_each)


def _by_poles(relative: ComplexArray, steps: ComplexArray) -> ComplexArray:
    """Derivatives of P by each pole times its step, (2 n_modes, n_modes, n_modes).

    relative   P_jl over the decay of the two modes
    """
    m = len(relative)
    places = np.arange(2 * m)
    dp = np.zeros((2 * m, m, m), dtype=complex)
    dp[places, places % m, :] += steps[:, None] * relative[places % m, :]
    dp[places, :, places % m] += steps.conj()[:, None] * relative[:, places % m].T
    return dp


def _by_forces(forces: ComplexArray) -> ComplexArray:
    """Derivatives of S by the parameters of C, (n_modes², n_modes, n_modes)."""
    m = len(forces)
    found = np.zeros((m * m, m, m), dtype=complex)
    for place, (i, j, factor) in enumerate(force_parameters(m)):
        step = forces[i, i] if factor is None else factor
        found[place, i, :] += step * forces[:, j].conj()
        found[place, :, i] += np.conj(step) * forces[:, j]
    return found


def force_parameters(m: int) -> list[tuple[int, int, complex | None]]:
    """Row, column and direction in C of its parameters; None: the logarithm of a diagonal."""
    below = [(i, j) for i in range(m) for j in range(i)]
    return [(j, j, None) for j in range(m)] + [(i, j, d) for i, j in below for d in (1.0, 1j)]


def stepped(modes: CloseModes, step: FloatArray) -> CloseModes:
    """The modes a step further: of ν and ln b, of C's parameters, of each c, then of the shapes'
    components but those held at 1, mode by mode."""
    m, n_channels = modes.n_modes, len(modes.shapes)
    inner = n_inner(m)
    forces = modes.forces.copy()
    for (i, j, factor), by in zip(force_parameters(m), step[2 * m : inner - m], strict=True):
        forces[i, j] = forces[i, j] * np.exp(by) if factor is None else forces[i, j] + by * factor
    shapes = modes.shapes.copy()
    for j, part in enumerate(step[inner:].reshape(m, n_channels - 1)):
        shapes[np.arange(n_channels) != modes.units[j], j] += part
    return replace(
        modes,
        positions=modes.positions + step[:m],
        half_widths=modes.half_widths * np.exp(step[m : 2 * m]),
        shapes=shapes,
        forces=forces,
        colours=modes.colours + step[inner - m : inner],
    ).normalised()


def n_inner(m: int) -> int:
    """Parameters of m modes beside their shapes."""
    return 3 * m + m * m


# ---- symmetric matrices by their upper triangle, along orthonormal directions S ----------------
#
# S is e_a e_aᵀ, or (e_a e_bᵀ + e_b e_aᵀ) / √2. Of n channels there are n (n + 1) / 2: components
# are picked, since products with a matrix of all S would cost n times as much.


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


def information_along_symmetric(matrices: ComplexArray, counts: FloatArray) -> FloatArray:
    """Σ n Re trace(E S E S') of each two.

    Parameters
    ----------
    matrices : ndarray of complex, shape (n_bins, n, n)
        E, Hermitian.
    counts : ndarray, shape (n_bins,)
        n of each bin.

    Notes
    -----
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
