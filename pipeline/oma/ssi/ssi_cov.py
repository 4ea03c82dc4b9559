"""Covariance-driven stochastic subspace identification for every model order at once.

The outputs of a structure under ambient load are those of a linear system
    x_{k+1} = A_d x_k + w_k,   y_k = C x_k + v_k                                       (Eq. 1)
whose lag covariances factor as R_τ = C A_d^(τ−1) G. The block Hankel matrix of R therefore is
O·(…), O = [C; C A_d; C A_d²; …]: its column space gives A_d by shift invariance and C as its first
block row.

References are the channels that lag covariances are taken with. With all n channels every pair is
used. A few good ones (where every mode moves, with little noise) make the Hankel matrix narrower
and everything after it cheaper, and leave the noise of poor sensors out of half of each product. A
mode that no reference sees is lost. Of more than 32 channels not all can be references: the
covariances of a hundred would take gigabytes. Those are taken that together explain most of the
others.
Source: [foundation-updating] Eqs. 1-4; Peeters and De Roeck (1999), Reference-based stochastic
subspace identification for output-only modal analysis, Mech. Syst. Signal Process. 13.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import fft, linalg

from pipeline.oma.settings import OmaSettings, OmaSettingsError
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import ComplexArray, FloatArray

References = slice | NDArray[np.intp]  # the channels that y_t runs over, by index
ALL = slice(None)
MOST_PAIRS = 1024  # channels × references that are chosen by themselves
FEWEST_REFERENCES = 4
EXPLAINED = 1e-6  # of a channel's variance: less is left where the others know it [-]


@dataclass(frozen=True, slots=True, eq=False)
class LagCovariances:
    """Lag covariances of a window, and what each of its time blocks says.

    `blocks` R_τ^(b), (n_blocks, n_lags, n_channels, n_references), lags τ = 1..n_lags, of samples
    divided by `scales`, (n_channels,). Blocks are equally long, so their mean is the window's
    covariance.
    """

    blocks: FloatArray
    scales: FloatArray

    @property
    def mean(self) -> FloatArray:
        """R_τ, (n_lags, n_channels, n_references)."""
        return self.blocks.mean(axis=0)

    @property
    def deviations(self) -> FloatArray:
        """ΔR^(b), like `blocks`: Σ_b vec(ΔR^(b)) vec(ΔR^(b))ᵀ is the covariance of the mean.

            ΔR^(b) = (R^(b) − R) / sqrt(n_b (n_b − 1))

        Source: Reynders, Pintelon, De Roeck (2008), Uncertainty bounds on modal parameters
        obtained from stochastic subspace identification, Mech. Syst. Signal Process. 22.
        """
        n_blocks = len(self.blocks)
        return (self.blocks - self.mean) / np.sqrt(n_blocks * (n_blocks - 1))


def lag_covariances(
    samples: FloatArray,
    *,
    n_lags: int,
    block_length: int,
    references: References = ALL,
) -> LagCovariances:
    """Lag covariances of a record in consecutive time blocks, channels scaled to unit rms.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        y, free of offset, each channel in its own unit.
    n_lags : int
        L: lags 1..L [samples].
    block_length : int
        m [samples]; the record holds (n − L) // m blocks, what is left over is unused.
    references : References, optional
        Channels that y_t runs over; all by default.

    Raises
    ------
    ValueError
        For a record shorter than two blocks.

    Notes
    -----
        R_τ^(b) = 1/m Σ_{t in block b} y_{t+τ} y_tᵀ

    y_{t+τ} may lie in a later block, so that no lag is cut short and the blocks' mean is the
    covariance of the whole record.
    """
    n_blocks = (len(samples) - n_lags) // block_length
    if n_blocks < 2:
        raise ValueError(f"{n_blocks} time blocks are too few for a covariance; 2 are needed")
    starts = range(0, n_blocks * block_length, block_length)
    products = np.stack(
        [
            lagged_products(samples[start : start + block_length + n_lags], n_lags, references)[1:]
            / block_length
            for start in starts
        ]
    )
    squares = np.mean(
        [np.mean(samples[start : start + block_length] ** 2, axis=0) for start in starts], axis=0
    )
    scales = np.where(squares > 0, np.sqrt(np.abs(squares)), 1.0)
    products /= np.outer(scales, scales[references])
    return LagCovariances(products, scales)


def lagged_products(samples: FloatArray, n_lags: int, references: References = ALL) -> FloatArray:
    """Σ_t y_{t+τ} y_tᵀ over all samples t but the last n_lags, (n_lags + 1, channels, references).

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        y, each channel in its own unit.
    n_lags : int
        Largest τ [samples].
    references : References, optional
        Channels that y_t runs over; all by default.

    Notes
    -----
    By segments as long as the lags, whose cross spectra are added before one inverse transform:
    a transform of the whole block would spend itself on lags that are not used. The cost is that
    of the samples, not of samples × lags.
    """
    length, n_channels = len(samples) - n_lags, samples.shape[1]
    step = min(length, n_lags)
    n_segments = -(-length // step)
    n_fft = fft.next_fast_len(step + n_lags, real=True)
    padded = np.zeros((n_segments * step + n_lags, n_channels))
    padded[: len(samples)] = samples
    starts = range(0, n_segments * step, step)
    reaching = np.stack([padded[start : start + step + n_lags] for start in starts], axis=2)
    ahead = fft.rfft(reaching, n_fft, axis=0)  # (n_fft/2, n_channels, n_segments)
    padded[length:] = 0.0
    starting = padded[: n_segments * step, references].reshape(n_segments, step, -1)
    here = fft.rfft(starting.transpose(1, 0, 2), n_fft, axis=0)
    cross_spectra = ahead @ here.conj()
    return np.asarray(fft.irfft(cross_spectra, n_fft, axis=0, overwrite_x=True)[: n_lags + 1])


def block_hankel(covariances: FloatArray, block_rows: int) -> FloatArray:
    """Block Hankel matrix of lag covariances.

    Parameters
    ----------
    covariances : ndarray, shape (n_lags, n_channels, n_references)
        R_τ, τ = 1..n_lags, n_lags = 2p [-].
    block_rows : int
        p.

    Returns
    -------
    ndarray, shape ((p + 1)·n_channels, p·n_references)
        H, block (i, j) = R_{i+j+1} from i, j = 0 [-].
    """
    _, n_channels, n_references = covariances.shape
    windows = np.lib.stride_tricks.sliding_window_view(covariances, block_rows, axis=0)
    # windows: (p + 1, n_channels, n_references, p), the last axis running over j
    return np.ascontiguousarray(windows.transpose(0, 1, 3, 2)).reshape(
        (block_rows + 1) * n_channels, block_rows * n_references
    )


def references_among(channel_names: Sequence[str], settings: OmaSettings) -> References:
    """Indices of the reference channels among a record's channels.

    Raises OmaSettingsError where a name is no channel's.
    """
    wanted = settings.reference_channels
    if wanted is None:
        return ALL
    for name in wanted:
        if name not in channel_names:
            raise OmaSettingsError(
                f"[oma] reference_channels has {name!r}; the channels are "
                f"{', '.join(channel_names)}"
            )
    return np.array([list(channel_names).index(name) for name in wanted], dtype=np.intp)


def settings_for_channels(settings: OmaSettings, channel_names: Sequence[str]) -> OmaSettings:
    """The settings for a window that lacks some channels, those of a silent unit for example.

    Its references are those that are left; all channels, where none is.
    """
    if settings.reference_channels is None:
        return settings
    left = tuple(name for name in settings.reference_channels if name in channel_names)
    return replace(settings, reference_channels=left or None)


def with_bounded_references(
    samples: FloatArray, channel_names: Sequence[str], settings: OmaSettings
) -> OmaSettings:
    """The settings with as many references as the channels of a window, (n, n_channels), can have.

    Parameters
    ----------
    samples : ndarray, shape (n, n_channels)
        Of the window, each channel in its own unit.
    channel_names : sequence of str
        One a channel; the references are named by them.
    settings : OmaSettings
        Returned as they are where they name references, or all channels may be references.

    Notes
    -----
    The references are chosen one after the other, each so that it explains most of what the
    correlations R of all channels still hold: Σ_j R_ij² / R_ii is largest, and R_i R_iᵀ / R_ii
    is taken off. What only one channel feels, its noise, is chosen last.
    """
    n_channels = samples.shape[1]
    if settings.reference_channels is not None or n_channels**2 <= MOST_PAIRS:
        return settings  # all of them, or those that somebody has named
    scales = samples.std(axis=0)
    scaled = (samples - samples.mean(axis=0)) / np.where(scales > 0, scales, 1.0)
    left = scaled.T @ scaled / len(scaled)
    chosen: list[int] = []
    for _ in range(max(FEWEST_REFERENCES, MOST_PAIRS // n_channels)):
        power = np.diag(left)
        known = power <= EXPLAINED
        gained = np.where(known, 0.0, (left**2).sum(axis=0) / np.where(known, 1.0, power))
        best = int(np.argmax(gained))
        if not gained[best] > 0:
            break
        chosen.append(best)
        left = left - np.outer(left[best], left[best]) / power[best]
    names = tuple(channel_names[index] for index in sorted(chosen))
    return replace(settings, reference_channels=names or None)


Triplets = tuple[FloatArray, FloatArray, FloatArray]  # U, s, V of U diag(s) Vᵀ, largest s first


@dataclass(frozen=True, slots=True, eq=False)
class SignalSubspace:
    """Leading singular vectors of the block Hankel matrix: a basis of O for every order.

    The model of order n uses the first n columns of each.
    """

    left: FloatArray
    """U, ((p + 1)·n_channels, n_max)."""
    singular_values: FloatArray
    """s, (n_max,), descending."""
    right: FloatArray
    """V, (p·n_references, n_max)."""
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
    poles: ComplexArray
    """λ_d of A_d, (n_modes,), discrete time [-]."""
    right: ComplexArray
    """Ψ, (order, n_modes): A Ψ = Ψ diag(λ_d)."""
    kept: NDArray[np.int64]
    """Their places among all eigenvectors, (n_modes,)."""
    all_poles: ComplexArray
    """(order,), real and conjugate ones too."""
    all_right: ComplexArray
    """(order, order)."""
    shapes: ComplexArray
    """φ = C Ψ, (n_channels, n_modes) [-]."""
    frequencies: FloatArray
    """f, undamped [Hz]."""
    damping_ratios: FloatArray
    """ζ [-]."""


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

    Parameters
    ----------
    covariances : ndarray, shape (n_lags, n_channels, n_references)
        R_τ, τ = 1..n_lags, n_lags = 2p [-].
    block_rows : int
        p.
    highest_order : int
        Most singular values that are kept.

    Notes
    -----
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


def leading_singular_triplets(matrix: HankelOperator, count: int) -> Triplets | None:
    """The largest singular values and their vectors (U, s, V) by a block Krylov iteration.

    Parameters
    ----------
    matrix : HankelOperator, shape (m, n)
        H.
    count : int
        How many triplets.

    Returns
    -------
    Triplets or None
        None when the residual is not reached in a basis of 5 × count vectors.

    Notes
    -----
    An orthonormal basis B of the Krylov space of H Hᵀ grows block by block; with C = Hᵀ B the
    triplets come from the small matrix Cᵀ C = Bᵀ H Hᵀ B. What leaves the basis is the next block
    Q⁺ R, so that ‖H Hᵀ u − s² u‖ = ‖R x_last‖ costs nothing.

    References
    ----------
    Golub and Van Loan, Matrix Computations, 4th ed., §10.4; Musco and Musco (2015), Randomized
    block Krylov methods, for the random start.
    """
    width = _BLOCK_WIDTH
    generator = np.random.default_rng(0)
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

    Parameters
    ----------
    subspace : SignalSubspace
        Of the band's Hankel matrix.
    orders : sequence of int
        Ascending; those beyond the subspace's give nothing.
    sampling_interval : float
        dt [s].

    Notes
    -----
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
