"""The most likely modes of a narrow band, by Fisher scoring, and how sharply the lines know them.

Fourier lines of a stationary record are nearly independent and complex Gaussian (Whittle):

    J(θ) = −ln p(y | θ) = Σ_k ln|E_k| + y_kᴴ E_k⁻¹ y_k
    F_ab = Σ_k tr(E_k⁻¹ ∂_a E_k E_k⁻¹ ∂_b E_k)

F is the information that the lines carry, the curvature of J on the average over records. The
background moves with the modes: N = L (I + X) L with X symmetric and 0 at the present N = L L.
n_0 lines of a small N_0 beside the band's keep it positive where the modes explain some direction
wholly. F of the modes is what is left of it where the background is unknown.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from pipeline.messages import Mode
from pipeline.modal_assurance import normalised_with_deviations
from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import (
    CloseModes,
    along_symmetric,
    expected_matrices,
    information_along_symmetric,
    modal_spectra,
    n_inner,
    stepped,
    symmetric_of,
    with_derivatives,
)
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import ComplexArray, FloatArray

MOST_SCORING_STEPS = 25
CONVERGED = 0.2  # decrease of J of a step that ends the iteration [nats]
LARGEST_SHIFT = 2.0  # of a mode's position in a step [lines],
LARGEST_TURN = 0.5  # or half bandwidths, where these are more
LARGEST_FACTOR = 1.0  # of a logarithm or a shape's component in a step [-]
WARY = 0.1  # least damping after a step that failed [-]
NOISE_FACTORS = (0.2, 3.0)  # least and largest of the background's power in a step [-]
LEAST_WIDTH = 0.02  # of a mode [lines]: a narrower one is a harmonic
COLOUR, COLOUR_STD = 1.0, 2.0  # prior of the mean c: from displacements to
# accelerations under white force
MOST_COLOUR_OFF = 6.5  # of a mode's colour from the prior's mean; no background is steeper, and the
# modes do not describe the lines. Of 592 fits (`structures`, seeds 76001 to 76030 and 160001 to
# 160030, and the shipped record) none of 245 that were believed came further than 6.1, of 99 that
# did not converge most did [-]
PRIOR_LINES = 2.0  # n_0
PRIOR_SHARE = 0.05  # of N_0 in the lower quartile of a channel's lines
MOST_SKEW = 1.0  # s² of ln ζ: beyond, the window does not know ζ at all


@dataclass(frozen=True, slots=True, eq=False)
class WhittleFit:
    """The most likely modes of a band."""

    modes: CloseModes
    cost: float
    """J at the modes, less the background's prior [nats]."""
    information: FloatArray
    """F of the modes' parameters, in the order of `spectral_model.stepped`."""
    directions: FloatArray
    """Columns along which the parameters moved, (n_parameters, n_directions)."""
    converged: bool
    """Whether the last step brought next to nothing."""
    off_colour: bool = False
    """Whether the iteration was given up at a slope that no background has."""

    @property
    def covariance(self) -> FloatArray:
        """Of the modes' parameters as far as they moved, D (Dᵀ F D)⁻¹ Dᵀ."""
        along = self.directions
        inner = np.linalg.pinv(along.T @ self.information @ along, hermitian=True)
        return np.asarray(along @ inner @ along.T, dtype=np.float64)

    def bayes_cost(self, n_lines: float) -> float:
        """Schwarz's approximation of −ln of the evidence [nats]."""
        return self.cost + 0.5 * self.directions.shape[1] * float(np.log(2 * n_lines))


def prior_noise(band: NarrowBand) -> FloatArray:
    """Diagonal of N_0, (n_channels,)."""
    power = band.powers
    return np.asarray(PRIOR_SHARE * np.quantile(power, 0.25, axis=0) + 1e-9 * power.mean())


def cost_of_background(band: NarrowBand) -> float:
    """J of a band without any mode."""
    prior = np.diag(prior_noise(band))
    total = band.total.real + PRIOR_LINES * prior
    n = band.n_lines + PRIOR_LINES
    _, log_noise = np.linalg.slogdet(total / n)
    return float(n * (log_noise + len(prior)))


def fitted(
    start: CloseModes,
    band: NarrowBand,
    along: FloatArray,
    *,
    most_steps: int = MOST_SCORING_STEPS,
    most_colour_off: float = np.inf,
) -> WhittleFit:
    """The nearest minimum of J, by Levenberg and Marquardt's damping of Fisher scoring.

    Parameters
    ----------
    start : CloseModes
    band : NarrowBand
    along : ndarray, shape (n_parameters, n_directions)
        Directions D in which the parameters move, in the order of `spectral_model.stepped`.
    most_steps : int, optional
        Most steps, whether the iteration has converged or not.
    most_colour_off : float, optional
        Most that a mode's colour may be off the prior's mean before the iteration is given up [-].
    """
    prior = prior_noise(band)
    state = _State(start.normalised(), band, prior)
    curvature = state.curvature()
    damping, converged, off_colour = 1e-2, False, False
    for _ in range(most_steps):
        checkpoint()
        free = curvature.along(along)
        scale = damping * np.maximum(np.diag(free.information), 1e-9)
        damped = free.information + np.diag(scale)
        step = np.asarray(np.linalg.solve(damped, -free.gradient), dtype=np.float64)
        n_modal = along.shape[1]
        moved = _moved(state, along @ step[:n_modal], step[n_modal:])
        proposal = _State(moved, band, prior)
        decrease = state.cost - proposal.cost
        if decrease > 0:
            state, damping = proposal, max(1e-6, damping / 5)
            curvature = state.curvature()
        else:
            damping = max(8 * damping, WARY)
        converged = damping > 1e6 or (abs(decrease) < CONVERGED and damping < 1)
        off_colour = bool(np.abs(state.modes.colours - COLOUR).max() > most_colour_off)
        if converged or off_colour:
            break
    return WhittleFit(
        state.modes, state.cost, curvature.of_modes(), along, converged, off_colour=off_colour
    )


def _moved(state: "_State", step: FloatArray, by_noise: FloatArray) -> CloseModes:
    """The modes and their background a step further, or as far as the derivatives hold.

    step       of the modes' parameters
    by_noise   X, its components as `symmetric_of` takes them
    """
    modes = state.modes
    values, vectors = np.linalg.eigh(symmetric_of(by_noise, len(modes.noise)))
    root = state.noise_root @ vectors
    forces = slice(2 * modes.n_modes, 3 * modes.n_modes)
    step[forces] = np.clip(step[forces], -LARGEST_FACTOR, LARGEST_FACTOR)
    moved = stepped(modes, step / max(_excess(step, modes), 1.0))
    return replace(
        moved,
        half_widths=np.maximum(moved.half_widths, LEAST_WIDTH),
        noise=(root * np.clip(1 + values, *NOISE_FACTORS)) @ root.T,
    )


def _square_root(matrix: FloatArray) -> FloatArray:
    """The symmetric L with L L = the matrix: unlike Cholesky's it keeps the channels' order out of
    the iteration."""
    values, vectors = np.linalg.eigh(matrix)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 1e-300))) @ vectors.T)


def every_parameter(m: int, n_channels: int, *, one_colour: bool) -> FloatArray:
    """Directions in which every parameter of m modes moves; their colours together, where asked."""
    n = n_inner(m) + m * (n_channels - 1)
    along = np.eye(n)
    if one_colour:
        first = n_inner(m) - m
        along[:, first] += along[:, first + 1 : first + m].sum(axis=1)
        along = np.delete(along, range(first + 1, first + m), axis=1)
    return along


def _excess(step: FloatArray, modes: CloseModes) -> float:
    """By how much a step leaves what the derivatives describe."""
    m = modes.n_modes
    logs = np.concatenate([step[m : 2 * m], step[n_inner(m) - m : n_inner(m)]])
    shifts = step[:m] / np.maximum(LARGEST_SHIFT, LARGEST_TURN * modes.half_widths)
    return max(float(np.abs(shifts).max()), float(np.abs(logs).max()) / LARGEST_FACTOR)


@dataclass(frozen=True, slots=True, eq=False)
class Curvature:
    """Gradient of J and F, of the modes' parameters and then of the background's X."""

    gradient: FloatArray
    """(n_parameters,)"""
    information: FloatArray
    """(n_parameters, n_parameters)"""
    n_modal: int
    """Parameters of the modes."""

    def along(self, directions: FloatArray) -> "Curvature":
        """The same along directions of the modes' parameters."""
        n = self.n_modal
        across = directions.T @ self.information[:n, n:]
        inner = directions.T @ self.information[:n, :n] @ directions
        return Curvature(
            np.concatenate([directions.T @ self.gradient[:n], self.gradient[n:]]),
            _symmetric(inner, across, self.information[n:, n:]),
            directions.shape[1],
        )

    def of_modes(self) -> FloatArray:
        """F of the modes' parameters where the background is unknown, (n_modal, n_modal)."""
        n = self.n_modal
        across = self.information[:n, n:]
        return np.asarray(
            self.information[:n, :n] - across @ np.linalg.solve(self.information[n:, n:], across.T)
        )


class _State:
    """J at some modes, and what its derivatives need."""

    def __init__(self, modes: CloseModes, band: NarrowBand, prior: FloatArray) -> None:
        self.modes, self._band, self._prior = modes, band, prior
        self._precision = np.linalg.inv(modes.noise)
        self._loads = self._precision @ modes.shapes  # N⁻¹ Φ
        self._gram = modes.shapes.T @ self._loads
        self._q = modal_spectra(modes, band.numbers)
        system = np.eye(modes.n_modes) + self._gram @ self._q
        r = np.linalg.inv(system)
        self._k = r @ self._gram  # Φᵀ E⁻¹ Φ
        self._rows = r @ self._loads.T  # Φᵀ E⁻¹
        self._of_rows = self._q @ self._rows  # Q Φᵀ E⁻¹
        sign, log_noise = np.linalg.slogdet(modes.noise)
        log_rest = band.n_together @ np.linalg.slogdet(system)[1]
        seen = band.n_together[:, None, None] * (self._of_rows @ band.matrices)  # n Q Φᵀ E⁻¹ D
        left = np.vdot(self._precision, band.total) - np.vdot(
            seen.sum(axis=0).conj(), self._loads.T
        )
        self.cost = float("inf")
        if sign > 0 and np.isfinite(log_rest):
            prior_cost = PRIOR_LINES * (log_noise + prior @ np.diag(self._precision))
            prior_cost += 0.5 * float((((modes.colours - COLOUR) / COLOUR_STD) ** 2).mean())
            self.cost = float(band.n_lines * log_noise + log_rest + left.real + prior_cost)

    @cached_property
    def noise_root(self) -> FloatArray:
        """The symmetric L with L L = N, (n_channels, n_channels)."""
        return _square_root(self.modes.noise)

    def curvature(self) -> Curvature:
        """Gradient of J and F."""
        self._inverse = self._precision - self._loads @ self._of_rows  # E⁻¹
        self._dq = with_derivatives(self.modes, self._band.numbers).derivatives
        self._free = np.ones((self.modes.n_modes, len(self.modes.shapes)), dtype=bool)
        self._free[np.arange(self.modes.n_modes), self.modes.units] = False
        gradient, information = self._of_modes()
        root = self.noise_root
        by_noise, of_noise = self._of_noise(root)
        across = self._across(root)
        return Curvature(
            np.concatenate([gradient, by_noise]),
            _symmetric(information, across, of_noise),
            len(gradient),
        )

    def _of_modes(self) -> tuple[FloatArray, FloatArray]:
        """Gradient and F of the modes' parameters alone."""
        modes, band = self.modes, self._band
        m, n_channels = modes.n_modes, len(modes.shapes)
        counts = band.n_together[:, None, None]
        dq, rows, of_rows, k = self._dq, self._rows, self._of_rows, self._k
        counted = counts * self._inverse  # n E⁻¹
        w = rows @ band.matrices @ rows.conj().transpose(0, 2, 1)  # Φᵀ E⁻¹ D E⁻¹ Φ
        n_lines, n_inner_parameters = dq.shape[:2]
        tall = dq.reshape(n_lines, -1, m)  # parameters and rows side by side
        by_line = dq.transpose(1, 0, 3, 2).reshape(n_inner_parameters, -1)  # dQᵀ
        inner = (by_line @ (counts * (k - w)).ravel()).real
        # sums over the lines as products of matrices that hold lines and modes side by side
        seen = (of_rows @ band.matrices).transpose(1, 0, 2).reshape(m, -1)
        explained = seen @ counted.reshape(-1, n_channels)
        by_shape = 2 * (np.tensordot(band.n_together, of_rows, axes=1) - explained).real
        dq_k = (tall @ k).reshape(dq.shape)
        turned = dq_k.transpose(1, 0, 3, 2).reshape(n_inner_parameters, -1)
        flat = (counts[:, None] * dq_k).transpose(1, 0, 2, 3).reshape(n_inner_parameters, -1)
        by_inner = _real_product(flat, turned.T)
        q_k = self._q @ k
        # Q K dQ = (dQ (Q K)ᴴ)ᴴ, since dQ is Hermitian
        turned_back = (tall @ q_k.conj().transpose(0, 2, 1)).reshape(dq.shape).conj()
        before = turned_back.transpose(1, 3, 0, 2).reshape(n_inner_parameters * m, -1)
        across = 2 * _real_product(before, (counts * rows).reshape(-1, n_channels))
        left = of_rows.reshape(len(k), -1)
        crossed = _real_product(left.T, (counts * of_rows).reshape(len(k), -1))
        squares = (q_k @ self._q).reshape(len(k), -1)  # Q Φᵀ E⁻¹ Φ Q
        direct = _real_product(squares.T, counted.reshape(len(k), -1).conj())
        shapes = 2 * (
            crossed.reshape(m, n_channels, m, n_channels).transpose(0, 3, 2, 1)
            + direct.reshape(m, m, n_channels, n_channels).transpose(0, 2, 1, 3)
        )
        chosen = self._free.ravel()
        off = across.reshape(n_inner_parameters, -1)[:, chosen]
        both = shapes.reshape(m * n_channels, -1)[np.ix_(chosen, chosen)]
        gradient = np.concatenate([inner, by_shape.ravel()[chosen]])
        information = _symmetric(by_inner, off, both)
        at = np.arange(n_inner(m) - m, n_inner(m))
        gradient[at] += (modes.colours - COLOUR) / (m * COLOUR_STD**2)
        information[at, at] += 1 / (m * COLOUR_STD**2)
        return gradient, information

    def _of_noise(self, root: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Gradient and F of X alone: ∂E = L S Lᵀ for each S of `symmetric.py`."""
        band, n = self._band, len(root)
        turned = root.T @ self._inverse @ root
        into = np.linalg.inv(root)
        data = into @ band.matrices @ into.T
        unexplained = turned - turned @ data @ turned
        gradient = np.tensordot(band.n_together, unexplained, axes=1).real
        gradient += PRIOR_LINES * (np.eye(n) - (into * self._prior) @ into.T)
        information = information_along_symmetric(turned, band.n_together)
        information += PRIOR_LINES * np.eye(len(information))
        return along_symmetric(gradient.ravel(), n), information

    def _across(self, root: FloatArray) -> FloatArray:
        """F of the modes' parameters with X, (n_modal, n_noise)."""
        m, n = self.modes.n_modes, len(root)
        counts = self._band.n_together[:, None, None]
        rows = self._rows @ root  # Φᵀ E⁻¹ L
        moved = (self._dq @ rows[:, None]).transpose(1, 3, 0, 2)  # dQ Φᵀ E⁻¹ L
        of_inner = _real_product(
            moved.reshape(-1, rows[:, :, 0].size), (counts * rows.conj()).reshape(-1, n)
        )
        inner = along_symmetric(of_inner.reshape(self._dq.shape[1], -1), n)
        before = (self._of_rows @ root).reshape(len(rows), -1)  # Q Φᵀ E⁻¹ L
        after = (counts * (root.T @ self._inverse)).reshape(len(rows), -1)  # n Lᵀ E⁻¹
        both = 2 * _real_product(before.T, after).reshape(m, n, n, n).transpose(0, 3, 1, 2)
        shapes = along_symmetric(both.reshape(m * n, -1)[self._free.ravel()], n)
        return np.concatenate([inner, shapes])


def _symmetric(first: FloatArray, across: FloatArray, second: FloatArray) -> FloatArray:
    """The matrix of two diagonal blocks and what is across, (n + m, n + m)."""
    n = len(first)
    whole = np.empty((n + len(second), n + len(second)))
    whole[:n, :n], whole[:n, n:] = first, across
    whole[n:, :n], whole[n:, n:] = across.T, second
    return whole


def _real_product(one: ComplexArray, other: ComplexArray) -> FloatArray:
    """Real part of a matrix product, at half its cost."""
    return np.asarray(one.real @ other.real - one.imag @ other.imag)


def whitened(modes: CloseModes, band: NarrowBand) -> ComplexArray:
    """L⁻¹ D L⁻ᴴ of each bin with E = L Lᴴ: near I where the modes explain the lines,
    (n_bins, n_channels, n_channels)."""
    lower = np.linalg.inv(np.linalg.cholesky(expected_matrices(modes, band.numbers)))
    return np.asarray(lower @ band.matrices @ lower.conj().transpose(0, 2, 1))


def covariance_root(covariance: FloatArray) -> FloatArray:
    """B of a covariance B Bᵀ."""
    values, vectors = np.linalg.eigh(covariance)
    return np.asarray(vectors * np.sqrt(np.maximum(values, 0.0)))


def modes_of_fit(fit: WhittleFit, band: NarrowBand) -> list[Mode]:
    """Every mode of a fit with the covariance that the lines leave it, in the fit's order."""
    root = covariance_root(fit.covariance)
    return [_mode(fit, band, place, root) for place in range(fit.modes.n_modes)]


def _mode(fit: WhittleFit, band: NarrowBand, j: int, root: FloatArray) -> Mode:
    """root: of the covariance of all parameters, (n_parameters, n_parameters)

    Of a mode a few lines wide, ζ is known to a third or a half, and the likelihood is one of ln ζ:
    where it is found too small by chance, so is its own std and that of f, which goes with it. ζ is
    its mean, exp(s²/2) above the peak with s the std of ln ζ, and f's variance is (1 + s²) times
    that at the peak. Of 60 modes of ζ f T < 3 (`structures`, seeds 203000 to 203400) 90 % intervals
    of f held .82 without and .90 with it, those of ζ .88 and .93, all misses of ζ below the truth.
    """
    modes, m = fit.modes, fit.modes.n_modes
    n_channels = len(modes.shapes)
    position, half_width = float(modes.positions[j]), float(modes.half_widths[j])
    damping = half_width / float(np.hypot(position, half_width))
    frequency = float(np.hypot(position, half_width)) / band.duration
    first = len(root) - m * (n_channels - 1) + j * (n_channels - 1)
    scales = band.accelerations(frequency)
    moved = np.zeros((n_channels, root.shape[1]))
    moved[np.arange(n_channels) != modes.units[j]] = root[first : first + n_channels - 1]
    shape, shape_factor = normalised_with_deviations(
        (modes.shapes[:, j] * scales).astype(complex), (moved * scales[:, None]).astype(complex)
    )
    relative = root[m + j] - root[j] / position  # of ζ
    skew = min(float(relative @ relative), MOST_SKEW)
    rows = np.vstack(
        [root[j] / band.duration * np.sqrt(1 + skew), damping * relative, shape_factor]
    )
    return mode_of_rows(frequency, damping * float(np.exp(skew / 2)), shape, rows)


def mode_of_rows(
    frequency: float, damping_ratio: float, shape: FloatArray, rows: FloatArray, pair_id: str = ""
) -> Mode:
    """A mode with the covariance that rows B of (f, ζ, φ) give, B Bᵀ, (2 + n_channels, n)."""
    factor = compact(rows)
    frequency_std, damping_std = np.linalg.norm(factor[:2], axis=1)
    return Mode(
        name="",
        frequency=frequency,
        frequency_std=float(frequency_std),
        damping_ratio=damping_ratio,
        damping_ratio_std=float(damping_std),
        shape=shape,
        covariance_factor=factor,
        n_block_columns=0,
        pair_id=pair_id,
    )


def compact(rows: FloatArray) -> FloatArray:
    """A factor of the same covariance with no more columns than rows; zero rows stay zero."""
    left, values, _ = np.linalg.svd(rows, full_matrices=False)
    factor = left * values
    factor[~rows.any(axis=1)] = 0.0
    return np.asarray(factor)
