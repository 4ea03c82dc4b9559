"""Mixtures of multivariate Student-t distributions: proposals whose tails cover the posterior's."""

from dataclasses import dataclass

import numpy as np
from scipy.special import gammaln

from sensors.arrays import FloatArray

DEGREES_OF_FREEDOM = 5.0  # ν: heavier tails than a posterior of σ integrated out has
EM_STEPS = 60
EM_TOLERANCE = 1e-4  # of the mean log density between two steps, where fitting stops
MOST_FITTED = 3000  # points that a fit looks at
SMALLEST_SCALE = 1e-12  # of a direction without spread, relative to the largest one
SURELY_DEFINITE = 1e-9  # determinant above which no eigenvalue is that small, rounding included


@dataclass(frozen=True, slots=True, eq=False)
class StudentMixture:
    """q(x) = Σ_k α_k t_ν(x; μ_k, S_k),   S_k = L_k L_kᵀ

        log t_ν = log Γ((ν+d)/2) − log Γ(ν/2) − d/2 log(νπ) − ½ log det S
                  − (ν+d)/2 log(1 + (x−μ)ᵀ S⁻¹ (x−μ) / ν)

    S is the scale matrix; the covariance of a component is S ν/(ν−2).
    """

    shares: FloatArray
    """α, (n_components,), sum 1."""
    means: FloatArray
    """μ, (n_components, n_dim)."""
    factors: FloatArray
    """L, (n_components, n_dim, n_dim), lower."""
    degrees: float = DEGREES_OF_FREEDOM
    """ν."""

    @classmethod
    def single(cls, mean: FloatArray, scale: FloatArray) -> "StudentMixture":
        """One component about mean, (n_dim,), with scale matrix S, (n_dim, n_dim)."""
        return cls(np.ones(1), mean[None], _factors(scale[None]))

    def draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, n_dim) independent draws, the components' numbers stratified, in random order."""
        n_dim = self.means.shape[1]
        edges = np.cumsum(self.shares)
        strata = (generator.permutation(n) + generator.random(n)) / n
        which = np.minimum(np.searchsorted(edges, strata), len(edges) - 1)
        radial = np.sqrt(self.degrees / generator.chisquare(self.degrees, size=n))
        normal = generator.standard_normal((n, n_dim)) * radial[:, None]
        return self.means[which] + np.einsum("nij,nj->ni", self.factors[which], normal)

    def log_density(self, points: FloatArray) -> FloatArray:
        """(n,) log q at points, (n, n_dim)."""
        return _log_sums(self.log_shares(points)[0])

    def log_shares(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """log α_k t_k(x) and the squared Mahalanobis distances, (n, n_components) each."""
        n_dim, nu = self.means.shape[1], self.degrees
        constant = gammaln((nu + n_dim) / 2) - gammaln(nu / 2) - n_dim / 2 * np.log(nu * np.pi)
        # sums over the points' few dimensions are quick with the points along the last axis
        offsets = points.T - self.means[:, :, None]  # (n_components, n_dim, n)
        squares = ((np.linalg.inv(self.factors) @ offsets) ** 2).sum(axis=1).T
        log_determinants = np.log(np.diagonal(self.factors, axis1=1, axis2=2)).sum(axis=1)
        logs = constant - log_determinants - (nu + n_dim) / 2 * np.log1p(squares / nu)
        return logs + np.log(self.shares), squares

    def widened(self, times: float) -> "StudentMixture":
        """The same components with standard deviations multiplied."""
        return StudentMixture(self.shares, self.means, self.factors * times, self.degrees)


def mixed(*parts: tuple[float, StudentMixture]) -> StudentMixture:
    """One mixture of several (share, mixture); shares are made to sum to 1."""
    total = sum(share for share, _ in parts)
    return StudentMixture(
        shares=np.concatenate([share / total * each.shares for share, each in parts]),
        means=np.concatenate([each.means for _, each in parts]),
        factors=np.concatenate([each.factors for _, each in parts]),
        degrees=parts[0][1].degrees,
    )


def weighted_moments(points: FloatArray, weights: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean (n_dim,) and covariance (n_dim, n_dim) of weighted points; weights sum to 1."""
    mean = weights @ points
    offsets = points - mean
    return mean, (offsets * weights[:, None]).T @ offsets


def kish_size(weights: FloatArray) -> float:
    """Kish's effective sample size (Σ w)² / Σ w²; 0 where all weights are zero."""
    squares = float((weights**2).sum())
    return float(weights.sum() ** 2 / squares) if squares > 0 else 0.0


def fitted_mixture(
    points: FloatArray,
    weights: FloatArray,
    generator: np.random.Generator,
    *,
    most_components: int = 8,
    degrees: float = DEGREES_OF_FREEDOM,
) -> StudentMixture:
    """The mixture of 1, 2, 4, … components that explains weighted points best by AIC.

    Parameters
    ----------
    points : ndarray, shape (n, n_dim)
        Draws.
    weights : ndarray, shape (n,)
        Of any sum [-].
    generator : numpy.random.Generator
        That thins the points and starts the fit.
    most_components : int, optional
        Of the mixture.
    degrees : float, optional
        ν of every component [-].

    Raises
    ------
    ValueError
        If the weights are not finite, or all zero.

    Notes
    -----
    The sample size is Kish's, since a point of great weight is still one point. AIC, not BIC: a
    proposal with a component too many costs nothing, one too few loses a bent posterior's arms.
    """
    points, weights = _thinned(points, weights / weights.sum(), generator)
    size = kish_size(weights)
    n_dim = points.shape[1]
    best, least, number = None, np.inf, 1
    while number <= most_components and number * (n_dim + 2) <= max(size, n_dim + 2):
        fit, mean_log = _expectation_maximisation(points, weights, number, degrees, generator)
        n_free = len(fit.shares) * (1 + n_dim + n_dim * (n_dim + 1) / 2) - 1
        aic = -2 * size * mean_log + 2 * n_free
        if aic >= least:
            break
        best, least, number = fit, aic, 2 * number
    if best is None:
        raise ValueError("weights must be finite and not all zero")
    return best


def _thinned(
    points: FloatArray, weights: FloatArray, generator: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """At most MOST_FITTED of the points, each with its weight's share of chances to be one."""
    if len(points) <= MOST_FITTED:
        return points, weights
    counts = generator.multinomial(MOST_FITTED, weights)
    kept = counts > 0
    return points[kept], counts[kept] / MOST_FITTED


def _expectation_maximisation(
    points: FloatArray,
    weights: FloatArray,
    n_components: int,
    degrees: float,
    generator: np.random.Generator,
) -> tuple[StudentMixture, float]:
    """EM for a Student-t mixture on weighted points; the mixture and its mean log density.

    With responsibilities r and u = (ν+d)/(ν+δ²), δ² the squared Mahalanobis distance,
        α = Σ w r,   μ = Σ w r u x / Σ w r u,   S = Σ w r u (x−μ)(x−μ)ᵀ / Σ w r

    S is drawn towards the whole sample's covariance by as much as n_dim + 2 points would, so that
    a component cannot collapse onto one heavy point.
    Source: Peel and McLachlan (2000), Statistics and Computing 10; the weights as in Cappé et al.
    (2008), Statistics and Computing 18; the prior on S as in Fraley and Raftery (2007).
    """
    mean, covariance = weighted_moments(points, weights)
    size = kish_size(weights)
    prior_scale = covariance * n_components ** (-2 / points.shape[1])
    centres = _spread_centres(points, weights, covariance, n_components, generator)
    mixture = StudentMixture(
        np.full(len(centres), 1 / len(centres)),
        centres if n_components > 1 else mean[None],
        np.repeat(_factors(prior_scale[None]), len(centres), axis=0),
        degrees,
    )
    last = -np.inf
    for _ in range(EM_STEPS):
        logs, squares = mixture.log_shares(points)
        totals = _log_sums(logs)
        mean_log = float(weights @ totals)
        if mean_log - last < EM_TOLERANCE:
            break
        last = mean_log
        responsibilities = np.exp(logs - totals[:, None]) * weights[:, None]
        mixture = _maximised(mixture, points, responsibilities, squares, prior_scale, size)
    return mixture, mean_log


def _maximised(
    mixture: StudentMixture,
    points: FloatArray,
    responsibilities: FloatArray,
    squares: FloatArray,
    prior_scale: FloatArray,
    size: float,
) -> StudentMixture:
    """M step. responsibilities: (n, n_components) times the points' weights."""
    n_dim = points.shape[1]
    shares = responsibilities.sum(axis=0)
    kept = shares * size >= 1.0  # a component with less than one effective point is dropped
    kept[np.argmax(shares)] = True
    damped = responsibilities * (mixture.degrees + n_dim) / (mixture.degrees + squares)
    damped, shares, pseudo = damped[:, kept].T, shares[kept], n_dim + 2
    means = damped @ points / damped.sum(axis=1)[:, None]
    offsets = points.T - means[:, :, None]  # (n_components, n_dim, n)
    scatter = size * (offsets * damped[:, None]) @ np.swapaxes(offsets, 1, 2)
    scales = (scatter + pseudo * prior_scale) / (size * shares + pseudo)[:, None, None]
    return StudentMixture(shares / shares.sum(), means, _factors(scales), mixture.degrees)


def _spread_centres(
    points: FloatArray,
    weights: FloatArray,
    covariance: FloatArray,
    n_centres: int,
    generator: np.random.Generator,
) -> FloatArray:
    """(n_centres, n_dim) of the points, far apart in the sample's own metric (k-means++)."""
    white = np.linalg.solve(_factors(covariance[None])[0], points.T).T
    chosen = [int(generator.choice(len(points), p=weights))]
    distances = ((white - white[chosen[0]]) ** 2).sum(axis=1)
    for _ in range(n_centres - 1):
        chances = weights * distances
        if not chances.sum() > 0:
            break
        chosen.append(int(generator.choice(len(points), p=chances / chances.sum())))
        distances = np.minimum(distances, ((white - white[chosen[-1]]) ** 2).sum(axis=1))
    return points[chosen]


def _log_sums(logs: FloatArray) -> FloatArray:
    """log Σ_k exp, (n,), of (n, n_components); −inf where all are."""
    highest = logs.max(axis=1)
    highest = np.where(np.isfinite(highest), highest, 0.0)
    with np.errstate(divide="ignore"):  # log(0) = −inf is meant
        return np.asarray(highest + np.log(np.exp(logs - highest[:, None]).sum(axis=1)))


def _factors(scales: FloatArray) -> FloatArray:
    """Lower Cholesky factors of (n, n_dim, n_dim) scale matrices, directions without spread given
    a trace of it."""
    deviations = np.sqrt(np.maximum(np.diagonal(scales, axis1=1, axis2=2), 0.0))
    largest = np.maximum(deviations.max(axis=1, keepdims=True), 1.0)
    deviations = np.maximum(deviations, SMALLEST_SCALE * largest)
    correlations = scales / (deviations[:, :, None] * deviations[:, None])
    factors = _surely_definite(correlations)
    if factors is None:
        values, vectors = np.linalg.eigh(correlations)
        flat = (values < SMALLEST_SCALE).any(axis=1)
        floored = np.maximum(values[flat], SMALLEST_SCALE)
        vectors = vectors[flat]
        correlations[flat] = (vectors * floored[:, None]) @ np.swapaxes(vectors, 1, 2)
        factors = np.linalg.cholesky(correlations)
    return np.asarray(deviations[:, :, None] * factors)


def _surely_definite(correlations: FloatArray) -> FloatArray | None:
    """Cholesky factors of (n, n_dim, n_dim) correlations, or None where an eigenvalue may be small.

    Of n_dim eigenvalues that sum to n_dim, the others' product is at most e: the smallest is at
    least the determinant over e. That spares most fits the eigenvalues, which take far longer.
    """
    try:
        factors = np.linalg.cholesky(correlations)
    except np.linalg.LinAlgError:
        return None
    determinants = np.diagonal(factors, axis1=1, axis2=2).prod(axis=1) ** 2
    return np.asarray(factors, np.float64) if np.all(determinants > SURELY_DEFINITE) else None
