"""How a farm is drawn: the full conditionals of the model of `pooling`, in its symbols.

Gibbs sampling, b_i integrated out where that can be done: first each z_i with its component of the
likelihood, then μ, then Σ and τ by a walk, then b_i, x_i, Σ and τ once more, ε. Where turbines are
known no better than they differ, Σ given b crawls and the walk does not; where they are known well,
the other way round. Chains run side by side in the leading axis of every array.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pipeline.farm.evidence import StackedEvidence
from pipeline.farm.settings import PopulationPrior
from pipeline.updating.population import log_gaussian
from sensors.arrays import FloatArray

WALK_STEPS = (0.2, 0.4, 0.8)  # of the walk, in ln Σ
SCALE_STEP = 1.5  # of one standard deviation, in its logarithm
JOINT_STEPS = 2  # of all standard deviations with τ, and of τ alone


@dataclass(slots=True, eq=False)
class State:
    """State of all chains, which are the leading axis of every array."""

    mean: FloatArray
    """μ, (n_chains, d)."""
    covariance: FloatArray
    """Σ, (n_chains, d, d)."""
    spread: FloatArray
    """τ, (n_chains,)."""
    outlier_share: FloatArray
    """ε, (n_chains,)."""


@dataclass(frozen=True, slots=True, eq=False)
class OutlierPriors:
    """What is thought of o_i after the turbine's own change ĉ_i was seen, and nothing else.

    ĉ ~ N(r + z o, V),  r ~ N(0, U),  o ~ N(0, W):  with K = W (W + U + V)⁻¹

        o | ĉ, z = 1 ~ N(ô = K ĉ, Ô = W − K W),    b = N(ĉ; 0, W + U + V) / N(ĉ; 0, U + V)

    A share q of recorded changes has other causes and says nothing of z: its own record then says
    at most 1 / q for an outlier; the rest must come from where its springs are:

        B = b / (1 − q + q b)
    """

    means: FloatArray
    """ô, (n_turbines, d); 0 where no change was seen."""
    covariances: FloatArray
    """Ô, (n_turbines, d, d); W where no change was seen."""
    precisions: FloatArray
    """Ô⁻¹."""
    log_factors: FloatArray
    """Ln B, (n_turbines,)."""

    @classmethod
    def of(
        cls, evidence: StackedEvidence, prior: PopulationPrior, shape: FloatArray
    ) -> "OutlierPriors":
        """Of all turbines; U = `regular_change`² S."""
        n_turbines, d = len(evidence.means), evidence.means.shape[2]
        wide = prior.outlier_std**2 * np.eye(d)
        means, factors = np.zeros((n_turbines, d)), np.zeros(n_turbines)
        covariances = np.tile(wide, (n_turbines, 1, 1))
        for row, change in enumerate(evidence.changes):
            if change is None:
                continue
            seen, covariance = change
            regular = covariance + prior.regular_change**2 * shape
            gain = np.linalg.solve(wide + regular, wide).T
            means[row], covariances[row] = gain @ seen, wide - gain @ wide
            log_b = log_gaussian(seen, wide + regular) - log_gaussian(seen, regular)
            factors[row] = log_b - np.logaddexp(
                np.log1p(-prior.other_causes), np.log(prior.other_causes) + log_b
            )
        return cls(means, covariances, _inverse(covariances), factors)


class Gibbs:
    """The full conditionals, for all chains at once.

    Parameters
    ----------
    evidence : StackedEvidence
        Of all turbines.
    prior : PopulationPrior
        Of the population's mean and covariance.
    generator : numpy.random.Generator
        That the chains are drawn with.
    shape : ndarray, shape (d, d), optional
        S of `pooling`; None: the unit matrix.
    """

    def __init__(
        self,
        evidence: StackedEvidence,
        prior: PopulationPrior,
        generator: np.random.Generator,
        shape: FloatArray | None = None,
    ) -> None:
        self._evidence = evidence
        self._prior = prior
        self._generator = generator
        self._d = evidence.means.shape[2]
        self._degrees = self._d + 1 + prior.alike  # κ
        S = np.eye(self._d) if shape is None else shape
        self._shape = prior.alike * S  # (κ − d − 1) S
        self._outliers = OutlierPriors.of(evidence, prior, S)

    def start(self, n_chains: int) -> State:
        """Chains apart from each other: about one turbine each, with spreads from narrow to
        wide."""
        turbines = self._generator.integers(len(self._evidence.means), size=n_chains)
        spreads = self._prior.spread_scale * np.geomspace(0.1, 2.0, n_chains)
        return State(
            mean=self._evidence.means[turbines, 0],
            covariance=spreads[:, None, None] ** 2 * self._shape / self._prior.alike,
            spread=spreads,
            outlier_share=self._generator.beta(
                self._prior.outliers, self._prior.regular, size=n_chains
            ),
        )

    def sweep(self, state: State) -> tuple[FloatArray, FloatArray]:
        """Every unknown drawn once, the state's in place.

        Returns
        -------
        x : ndarray, shape (n_chains, n_turbines, d)
            Of the turbines.
        outlier_probabilities : ndarray, shape (n_chains, n_turbines)
            Probability of an outlier given the rest.
        """
        component, outlying, chances = self._allocations(state)
        rows = np.arange(len(self._evidence.means))
        seen, seen_covariance = (
            self._evidence.means[rows, component],
            self._evidence.covariances[rows, component],
        )
        noise = seen_covariance + outlying[..., None, None] * self._outliers.covariances
        seen = seen - outlying[..., None] * self._outliers.means
        state.mean = self._mean(seen, noise + state.covariance[:, None])
        self._random_walk(state, seen, noise)
        self._random_walk_of_spread(state)
        regular = self._between(
            state.mean[:, None], _inverse(state.covariance)[:, None], seen, noise
        )
        different = self._between(regular, self._outliers.precisions, seen, seen_covariance)
        different = different + self._outliers.means
        points = np.where(outlying[..., None], different, regular)
        state.covariance = self._covariance(regular - state.mean[:, None], state.spread)
        self._random_walk_of_spread(state)
        count, n_turbines = outlying.sum(axis=1), outlying.shape[1]
        state.outlier_share = self._generator.beta(
            self._prior.outliers + count, self._prior.regular + n_turbines - count
        )
        return points, chances

    def _allocations(self, state: State) -> tuple[NDArray[np.int64], NDArray[np.bool_], FloatArray]:
        """Component and z of each turbine, (n_chains, n_turbines) each, b integrated out; and the
        probability of z = 1, from

            p(component k, z | μ, Σ, ε) ∝ a_k (B ε)^z (1 − ε)^(1−z) N(m_k; μ + z ô, C_k + Σ + z Ô)

        with ô, Ô, B of `OutlierPriors`.
        """
        evidence, outliers = self._evidence, self._outliers
        offsets = evidence.means - state.mean[:, None, None]
        covariance = evidence.covariances + state.covariance[:, None, None]
        logs = np.stack(
            [
                log_gaussian(offsets, covariance) + np.log1p(-state.outlier_share)[:, None, None],
                log_gaussian(
                    offsets - outliers.means[:, None], covariance + outliers.covariances[:, None]
                )
                + outliers.log_factors[:, None]
                + np.log(state.outlier_share)[:, None, None],
            ],
            axis=-1,
        )
        logs = (logs + evidence.log_shares[..., None]).reshape(*offsets.shape[:2], -1)
        chances = np.exp(logs - logsumexp(logs, axis=-1, keepdims=True))
        edges = np.cumsum(chances, axis=-1)
        drawn = self._generator.random((*edges.shape[:2], 1)) * edges[..., -1:]
        chosen = np.minimum((edges <= drawn).sum(axis=-1), edges.shape[-1] - 1)
        return chosen // 2, chosen % 2 == 1, chances[..., 1::2].sum(axis=-1)

    def _mean(self, seen: FloatArray, covariance: FloatArray) -> FloatArray:
        """μ, (n_chains, d), of turbines seen at m with covariance C + zW + Σ."""
        precision = _inverse(covariance)
        total = precision.sum(axis=1) + np.eye(self._d) / self._prior.mean_std**2
        weighted = (precision @ seen[..., None]).sum(axis=1)[..., 0]
        return self._gaussian(weighted, total)

    def _between(
        self, centre: FloatArray, precision: FloatArray, seen: FloatArray, noise: FloatArray
    ) -> FloatArray:
        """Draws, (n_chains, n_turbines, d), of N(x; centre, precision⁻¹) N(seen; x, noise)."""
        seen_precision = _inverse(noise)
        weighted = (precision @ centre[..., None] + seen_precision @ seen[..., None])[..., 0]
        return self._gaussian(weighted, precision + seen_precision)

    def _random_walk(self, state: State, seen: FloatArray, noise: FloatArray) -> None:
        """Σ and τ by Metropolis steps with b integrated out, the state's in place.

        Steps A of the linear group, Σ → A Σ Aᵀ, as often A as A⁻¹: a walk that looks the same from
        everywhere on the cone of positive definite matrices, reversible with respect to
        |Σ|^−(d+1)/2 dΣ. Small ones in every direction; long ones of one standard deviation alone,
        which may be near zero while the others are well known; and long ones of all of them and τ.
        """
        offsets = seen - state.mean[:, None]

        def log_density(covariance: FloatArray, spread: FloatArray) -> FloatArray:
            data = log_gaussian(offsets, noise + covariance[:, None]).sum(axis=1)
            return np.asarray(data + self._log_prior(covariance, spread))

        here = log_density(state.covariance, state.spread)
        for step in self._steps(len(here)):
            trial, spread = step(state.covariance), state.spread
            here = self._accept(state, trial, spread, here, log_density(trial, spread))
        for _ in range(JOINT_STEPS):
            factor = np.exp(SCALE_STEP / 2 * self._generator.standard_normal(len(here)))
            trial, spread = factor[:, None, None] ** 2 * state.covariance, factor * state.spread
            here = self._accept(state, trial, spread, here, log_density(trial, spread))

    def _random_walk_of_spread(self, state: State) -> None:
        """τ given Σ, the state's in place; as often up as down in ln τ."""
        here = self._log_prior(state.covariance, state.spread)
        for _ in range(JOINT_STEPS):
            spread = state.spread * np.exp(
                WALK_STEPS[1] * self._generator.standard_normal(len(here))
            )
            there = self._log_prior(state.covariance, spread)
            here = self._accept(state, state.covariance, spread, here, there)

    def _accept(
        self,
        state: State,
        covariance: FloatArray,
        spread: FloatArray,
        here: FloatArray,
        there: FloatArray,
    ) -> FloatArray:
        """Take a trial in the chains where Metropolis takes it; the log densities then."""
        taken = np.log(self._generator.random(len(here))) < there - here
        state.covariance = np.where(taken[:, None, None], covariance, state.covariance)
        state.spread = np.where(taken, spread, state.spread)
        return np.where(taken, there, here)

    def _steps(self, n_chains: int) -> Iterator[Callable[[FloatArray], FloatArray]]:
        for length in WALK_STEPS:
            yield partial(self._turned, length)
        for axis in range(self._d):
            stretch = np.ones((n_chains, self._d))
            stretch[:, axis] = np.exp(SCALE_STEP * self._generator.standard_normal(n_chains))
            yield partial(np.multiply, stretch[:, :, None] * stretch[:, None, :])

    def _turned(self, length: float, covariance: FloatArray) -> FloatArray:
        """L exp(S) Lᵀ of Σ = L Lᵀ, S symmetric, its entries normal with that deviation."""
        factor = np.linalg.cholesky(covariance)
        normal = length * self._generator.standard_normal(covariance.shape)
        values, vectors = np.linalg.eigh((normal + np.swapaxes(normal, 1, 2)) / 2)
        root = factor @ vectors * np.exp(values / 2)[:, None]
        return root @ np.swapaxes(root, 1, 2)

    def _log_prior(self, covariance: FloatArray, spread: FloatArray) -> FloatArray:
        """Return the log prior of Σ and τ, with respect to |Σ|^−(d+1)/2 dΣ d ln τ."""
        nu, d, degrees = self._prior.spread_degrees, self._d, self._degrees
        factor = np.linalg.cholesky(covariance)
        log_determinant = 2 * np.log(np.diagonal(factor, axis1=1, axis2=2)).sum(axis=1)
        trace = np.trace(self._shape @ _inverse(covariance), axis1=1, axis2=2)
        of_covariance = (
            degrees * d * np.log(spread) - degrees / 2 * log_determinant - spread**2 * trace / 2
        )
        tail = np.log1p((spread / self._prior.spread_scale) ** 2 / nu)
        return np.asarray(of_covariance + np.log(spread) - (nu + 1) / 2 * tail)

    def _gaussian(self, weighted: FloatArray, precision: FloatArray) -> FloatArray:
        """Draws of N(P⁻¹ w, P⁻¹), (..., d), w (..., d), P (..., d, d)."""
        factor = np.swapaxes(np.linalg.cholesky(precision), -1, -2)  # Lᵀ of P = L Lᵀ
        normal = self._generator.standard_normal(weighted.shape)
        mean = np.linalg.solve(precision, weighted[..., None])
        return (mean + np.linalg.solve(factor, normal[..., None]))[..., 0]

    def _covariance(self, offsets: FloatArray, spread: FloatArray) -> FloatArray:
        """Σ, (n_chains, d, d), given b − μ, (n_chains, n_turbines, d), and τ, (n_chains,)."""
        scatter = np.swapaxes(offsets, 1, 2) @ offsets + spread[:, None, None] ** 2 * self._shape
        return inverse_wishart(self._degrees + offsets.shape[1], scatter, self._generator)


def inverse_wishart(
    degrees: float, scale: FloatArray, generator: np.random.Generator
) -> FloatArray:
    """(n, d, d) draws Σ with density ∝ |Σ|^−(degrees + d + 1)/2 exp(−½ tr(scale Σ⁻¹)).

    Parameters
    ----------
    degrees : float
        Degrees of freedom [-].
    scale : ndarray, shape (n, d, d)
        Positive definite, one for each draw.
    generator : numpy.random.Generator
        That they are drawn with.

    Notes
    -----
    With scale = L Lᵀ and Bartlett's A, lower triangular with A_jj² ~ χ²(degrees − j) and standard
    normal entries below, Σ = (L A⁻ᵀ)(L A⁻ᵀ)ᵀ.

    References
    ----------
    Bartlett (1933), Proceedings of the Royal Society of Edinburgh 53, 260.
    """
    n, d = scale.shape[:2]
    bartlett = np.tril(generator.standard_normal((n, d, d)), -1)
    diagonal = np.sqrt(generator.chisquare(degrees - np.arange(d), size=(n, d)))
    bartlett[:, np.arange(d), np.arange(d)] = diagonal
    factor = np.linalg.solve(bartlett, np.swapaxes(np.linalg.cholesky(scale), 1, 2))  # A⁻¹ Lᵀ
    return np.swapaxes(factor, 1, 2) @ factor


def _inverse(matrices: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.inv(matrices), dtype=np.float64)
