"""The most likely modes of a narrow band, by Fisher scoring, and how sharply the lines know them.

Fourier lines of a stationary record are nearly independent and complex Gaussian (Whittle):

    J(θ) = −ln p(y | θ) = Σ_k ln|E_k| + y_kᴴ E_k⁻¹ y_k
    F_ab = Σ_k tr(E_k⁻¹ ∂_a E_k E_k⁻¹ ∂_b E_k)

F is the information that the lines carry, the curvature of J on the average over records. The
background N follows by expectation and maximisation between the steps: with q̂_k and V_k the modal
coordinates' mean and covariance given the lines,

    N = (Σ_k Re[(y_k − Φ q̂_k)(y_k − Φ q̂_k)ᴴ + Φ V_k Φᵀ] + n_0 N_0) / (n_lines + n_0)

whose n_0 lines of a small N_0 keep it positive where the modes explain some direction wholly.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.oma.whittle.narrow_band import NarrowBand
from pipeline.oma.whittle.spectral_model import (
    CloseModes,
    expected_matrices,
    modal_spectra,
    n_inner,
    stepped,
    with_derivatives,
)
from pipeline.oma.work_limit import checkpoint
from sensors.arrays import ComplexArray, FloatArray

MOST_SCORING_STEPS = 60
CONVERGED = 0.05  # decrease of J of a step that ends the iteration [nats]
LARGEST_SHIFT = 2.0  # of a mode's position in a step [lines]
LARGEST_FACTOR = 1.0  # of a logarithm or a shape's component in a step [-]
LEAST_WIDTH = 0.02  # of a mode [lines]: a narrower one is a harmonic
LONGEST_REACH = 16.0  # of a step of the background, in plain ones [-]
COLOUR, COLOUR_STD = 1.0, 2.0  # prior of the mean c: from displacements to
# accelerations under white force
PRIOR_LINES = 2.0  # n_0
PRIOR_SHARE = 0.05  # of N_0 in the lower quartile of a channel's lines


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

    @property
    def covariance(self) -> FloatArray:
        """Of the modes' parameters as far as they moved, D (Dᵀ F D)⁻¹ Dᵀ."""
        along = self.directions
        inner = np.linalg.pinv(along.T @ self.information @ along, hermitian=True)
        return np.asarray(along @ inner @ along.T, dtype=np.float64)

    def bayes_cost(self, n_lines: int) -> float:
        """Schwarz's approximation of −ln of the evidence [nats]."""
        return self.cost + 0.5 * self.directions.shape[1] * float(np.log(2 * n_lines))


def prior_noise(band: NarrowBand) -> FloatArray:
    """Diagonal of N_0, (n_channels,)."""
    power = band.powers
    return np.asarray(PRIOR_SHARE * np.quantile(power, 0.25, axis=0) + 1e-9 * power.mean())


def cost_of_background(band: NarrowBand) -> float:
    """J of a band without any mode."""
    prior = np.diag(prior_noise(band))
    total = band.n_together * band.matrices.sum(axis=0).real + PRIOR_LINES * prior
    n = band.n_lines + PRIOR_LINES
    _, log_noise = np.linalg.slogdet(total / n)
    return float(n * (log_noise + len(prior)))


def fitted(start: CloseModes, band: NarrowBand, along: FloatArray) -> WhittleFit:
    """The nearest minimum of J, by Levenberg and Marquardt's damping of Fisher scoring.

    along   directions D in which the parameters move, in the order of `spectral_model.stepped`,
            (n_parameters, n_directions)
    """
    prior = prior_noise(band)
    modes = start.normalised()
    damping, reach = 1e-2, 1.0
    state = _State(modes, band, prior)
    for _ in range(MOST_SCORING_STEPS):
        checkpoint()
        before = state.cost
        gradient, information = state.curvature()
        gradient, information = along.T @ gradient, along.T @ information @ along
        scale = np.maximum(np.diag(information), 1e-9)
        step: FloatArray = along @ np.linalg.solve(
            information + damping * np.diag(scale), -gradient
        )
        moved = stepped(state.modes, _limited(step, modes.n_modes))
        moved = replace(moved, half_widths=np.maximum(moved.half_widths, LEAST_WIDTH))
        proposal = _State(moved, band, prior)
        if proposal.cost < state.cost:
            state, damping = proposal, max(1e-6, damping / 5)
        else:
            damping *= 8
        state, reach = _with_next_noise(state, band, prior, reach)
        if before - state.cost < CONVERGED and (damping < 1.0 or damping > 1e6):
            break
    return WhittleFit(state.modes, state.cost, state.curvature()[1], along)


def _with_next_noise(
    state: "_State", band: NarrowBand, prior: FloatArray, reach: float
) -> tuple["_State", float]:
    """The background follows, farther than by expectation and maximisation as long as that helps.

    reach   of the step, in those of the plain algorithm
    """
    now = state.modes.noise
    step = state.noise_given_lines() - now
    if reach > 1:
        bold = _State(replace(state.modes, noise=now + reach * step), band, prior)
        if bold.cost < state.cost:
            return bold, min(2 * reach, LONGEST_REACH)
    plain = _State(replace(state.modes, noise=now + step), band, prior)
    return plain, 2.0


def every_parameter(m: int, n_channels: int, *, one_colour: bool) -> FloatArray:
    """Directions in which every parameter of m modes moves; their colours together, where asked."""
    n = n_inner(m) + m * (n_channels - 1)
    along = np.eye(n)
    if one_colour:
        first = n_inner(m) - m
        along[:, first] += along[:, first + 1 : first + m].sum(axis=1)
        along = np.delete(along, range(first + 1, first + m), axis=1)
    return along


def _limited(step: FloatArray, m: int) -> FloatArray:
    """A step shortened where it would leave what the derivatives describe."""
    logs = np.concatenate([step[m : 3 * m], step[n_inner(m) - m :]])
    ratio = max(
        float(np.abs(step[:m]).max()) / LARGEST_SHIFT,
        float(np.abs(logs).max()) / LARGEST_FACTOR,
        1.0,
    )
    return np.asarray(step / ratio)


class _State:
    """J at some modes, and what its derivatives and the next background need."""

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
        self._rows_of_lines = self._rows @ band.matrices  # Φᵀ E⁻¹ D
        self._seen = self._q @ self._rows_of_lines  # Q Φᵀ E⁻¹ D
        self._spread = self._q @ r  # V
        sign, log_noise = np.linalg.slogdet(modes.noise)
        log_rest = np.linalg.slogdet(system)[1].sum()
        white = np.vdot(self._precision, band.matrices.sum(axis=0)).real
        explained = np.einsum("kji,ij->", self._seen, self._loads).real
        self.cost = float("inf")
        if sign > 0 and np.isfinite(log_rest):
            total = len(band.numbers) * log_noise + log_rest + white - explained
            prior_cost = PRIOR_LINES * (log_noise + prior @ np.diag(self._precision))
            prior_cost += 0.5 * float((((modes.colours - COLOUR) / COLOUR_STD) ** 2).mean())
            self.cost = float(band.n_together * total + prior_cost)

    def noise_given_lines(self) -> FloatArray:
        """N of the next iteration."""
        phi, band = self.modes.shapes, self._band
        seen = phi @ self._seen.sum(axis=0)
        total = band.matrices.sum(axis=0) - seen - seen.conj().T
        middle = (self._seen @ self._of_rows.conj().transpose(0, 2, 1) + self._spread).sum(axis=0)
        real = (total + phi @ middle @ phi.T).real * band.n_together
        real = 0.5 * (real + real.T) + PRIOR_LINES * np.diag(self._prior)
        return np.asarray(real / (band.n_lines + PRIOR_LINES))

    def curvature(self) -> tuple[FloatArray, FloatArray]:
        """Gradient of J and F."""
        modes, band = self.modes, self._band
        m, n_channels = modes.n_modes, len(modes.shapes)
        dq = with_derivatives(modes, band.numbers).derivatives
        rows, of_rows, k = self._rows, self._of_rows, self._k
        inverse = self._precision - self._loads @ of_rows  # E⁻¹
        w = self._rows_of_lines @ rows.conj().transpose(0, 2, 1)  # Φᵀ E⁻¹ D E⁻¹ Φ
        n_lines, n_inner_parameters = dq.shape[:2]
        tall = dq.reshape(n_lines, -1, m)  # parameters and rows side by side
        by_line = dq.transpose(1, 0, 3, 2).reshape(n_inner_parameters, -1)  # dQᵀ
        inner = (by_line @ (k - w).ravel()).real
        # sums over the lines as products of matrices that hold lines and modes side by side
        explained = self._seen.transpose(1, 0, 2).reshape(m, -1) @ inverse.reshape(-1, n_channels)
        by_shape = 2 * (of_rows.sum(axis=0) - explained).real  # (m, n_channels)
        dq_k = (tall @ k).reshape(dq.shape)
        turned = dq_k.transpose(1, 0, 3, 2).reshape(n_inner_parameters, -1)
        flat = dq_k.transpose(1, 0, 2, 3).reshape(n_inner_parameters, -1)
        by_inner = (flat @ turned.T).real
        q_k = self._q @ k
        # Q K dQ = (dQ (Q K)ᴴ)ᴴ, since dQ is Hermitian
        turned_back = (tall @ q_k.conj().transpose(0, 2, 1)).reshape(dq.shape).conj()
        before = turned_back.transpose(1, 3, 0, 2).reshape(n_inner_parameters * m, -1)
        across = 2 * (before @ rows.reshape(-1, n_channels)).real  # (n_inner × m, n_channels)
        left = of_rows.reshape(len(k), -1)
        crossed = (left.T @ left).real.reshape(m, n_channels, m, n_channels)
        squares = (q_k @ self._q).reshape(len(k), -1)  # Q Φᵀ E⁻¹ Φ Q
        direct = (squares.T @ inverse.reshape(len(k), -1).conj()).real
        shapes = 2 * (
            crossed.transpose(0, 3, 2, 1)
            + direct.reshape(m, m, n_channels, n_channels).transpose(0, 2, 1, 3)
        )
        free = np.ones((m, n_channels), dtype=bool)
        free[np.arange(m), modes.units] = False
        chosen = free.ravel()
        off = across.reshape(n_inner_parameters, -1)[:, chosen]
        both = shapes.reshape(m * n_channels, -1)[np.ix_(chosen, chosen)]
        gradient = np.concatenate([inner, by_shape.ravel()[chosen]])
        information = np.block([[by_inner, off], [off.T, both]])
        gradient, information = band.n_together * gradient, band.n_together * information
        at = np.arange(n_inner(m) - m, n_inner(m))
        gradient[at] += (modes.colours - COLOUR) / (m * COLOUR_STD**2)
        information[at, at] += 1 / (m * COLOUR_STD**2)
        return gradient, information


def whitened(modes: CloseModes, band: NarrowBand) -> ComplexArray:
    """L⁻¹ D L⁻ᴴ of each bin with E = L Lᴴ: near I where the modes explain the lines,
    (n_bins, n_channels, n_channels)."""
    lower = np.linalg.inv(np.linalg.cholesky(expected_matrices(modes, band.numbers)))
    return np.asarray(lower @ band.matrices @ lower.conj().transpose(0, 2, 1))
