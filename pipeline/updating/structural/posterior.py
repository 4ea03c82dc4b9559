"""The joint posterior at its peak: a mixture of Gaussians over the model's discrepancy σ.

With the errors linear about the peak, η(u) = η₀ + J (u − u₁), every σ has a Gaussian posterior

    H(σ) = Jᵀ D⁻¹ J + P,   D = S + F + σ² R,   δ(σ) = −H⁻¹ (Jᵀ D⁻¹ η₀ + P (u₁ − u₀)),

and its weight is p(d | σ) ∝ |H|^(−1/2) p(η(u₁ + δ) | σ) exp(−½ prior cost): Laplace's method in u,
exact in σ; shares of neighbours (`likelihood.mixtures`) are integrated out beside each σ. Source:
Rue, Martino and Chopin, JRSS B 71 (2009) 319, with one hyperparameter.

Where many modes are off by more than they report, the model is off, which is σ; where few are, they
were identified wrongly. Student's t, which keeps the peak off gross errors, takes both for gross
errors. So σ is judged by a normal density beside which a small share may lie anywhere:

    p(η_g | σ) = (1 − ε) N(η_g; 0, D_g(σ)) + ε / (2 κ)ⁿ |D_g(0)|^(−1/2)

for each frequency and each shape g of n components. Source: Box and Tiao, Biometrika 55 (1968) 119.

The error budget: the variance of ln k that a figure brings is what would vanish if it were known,

    share_i = C_ki² / (C_ii C_kk),

the squared correlation of the joint posterior. Shares of correlated figures overlap and are scaled
to the part that figures make together, 1 − var(ln k | all figures) / var(ln k).

Errors of the figures stay in the springs: with H⁻¹ = C and P_f the precision of the figures' prior,
true figures f miss the prior's mean f₀ and the peak the true springs by

    u − û = C_uf P_f (f − f₀) + what the windows' own errors make,   f − f₀ = P_f^(−1/2) ξ,

so that the columns of C_uf P_f^(1/2) are what ξ, independent and standard normal, makes of them.
Systematic errors of identification and mesh stay as well: with the gain G = C Jᵀ D⁻¹ they have the
covariance G (F + σ² R) Gᵀ.
Source: Rodgers, "Inverse Methods for Atmospheric Sounding" (2000), chapter 3, where the first is
the smoothing error, the second the forward model's.
"""

from dataclasses import dataclass, replace

import numpy as np

from pipeline.updating.likelihood.likelihood import sigma_grid
from pipeline.updating.likelihood.mode_errors import ModeErrors
from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.prior import N_SPRINGS, JointCoordinates
from sensors.arrays import FloatArray

GROSS_SHARE = 0.05  # ε, of frequencies and shapes that were identified wrongly [-]
GROSS_REACH = 20.0  # κ, of their own standard deviations within which they may lie [-]


@dataclass(frozen=True, slots=True, eq=False)
class JointPosterior:
    """Gaussians in u for each σ of a grid."""

    sigma: FloatArray
    """(n_sigma,) [-]"""
    weights: FloatArray
    """(n_sigma,) probabilities"""
    means: FloatArray
    """(n_sigma, n_dim)"""
    covariances: FloatArray
    """(n_sigma, n_dim, n_dim)"""

    @property
    def mean(self) -> FloatArray:
        """(n_dim,)"""
        return self.weights @ self.means

    @property
    def covariance(self) -> FloatArray:
        """(n_dim, n_dim)"""
        off = self.means - self.mean
        within = np.tensordot(self.weights, self.covariances, axes=1)
        return np.asarray(within + (off.T * self.weights) @ off)

    @property
    def likeliest_sigma(self) -> float:
        """Of largest density; 0 where the floors explain all errors [-]."""
        density = self.weights / np.gradient(self.sigma)
        density[0] = self.weights[0] / (self.sigma[1] / 2)
        density[-1] = 2 * density[-1]
        return float(self.sigma[int(np.argmax(density))])

    def draws(
        self, n: int, generator: np.random.Generator, *, widening: float = 1.0
    ) -> tuple[FloatArray, FloatArray]:
        """(n, n_dim) points and (n,) σ. widening: factor on standard deviations."""
        chosen = generator.choice(len(self.sigma), size=n, p=self.weights)
        noise = generator.standard_normal((n, self.means.shape[1]))
        found = np.empty_like(noise)
        for number in np.unique(chosen):
            rows = chosen == number
            factor = np.linalg.cholesky(self.covariances[number])
            found[rows] = self.means[number] + widening * noise[rows] @ factor.T
        return found, self.sigma[chosen]


def joint_posterior(
    peak: JointPeak,
    coordinates: JointCoordinates,
    *,
    highest_sigma: float,
    n_sigma: int,
    common: float = 1.0,
) -> JointPosterior:
    """The posterior about a peak, σ uniform up to its highest.

    Parameters
    ----------
    peak : JointPeak
        Of the joint fit.
    coordinates : JointCoordinates
        With the prior of springs and figures.
    highest_sigma : float
        Of the uniform prior [-].
    n_sigma : int
        Nodes of σ.
    common : float, optional
        Factor on the variances where errors of a rough model are common to so many modes [-].
    """
    sigma, widths = sigma_grid(highest_sigma, n_sigma)
    prior, off = coordinates.prior_precision, peak.u - coordinates.origin
    logs, means, covariances = [], [], []
    for value in sigma:
        found, mixing = peak.comparison.at_discrepancy(float(value))
        J, eta = found.jacobian, found.errors
        D = found.variances + found.floors + value**2 * found.reference
        D = D / found.robust_weights(D)
        hessian = (J.T / D) @ J + prior
        gradient = J.T @ (eta / D) + prior @ off
        covariance = np.linalg.inv(hessian)
        wide = covariance if common == 1.0 else np.linalg.inv((J.T / (common * D)) @ J + prior)
        step = -covariance @ gradient
        there = replace(found, errors=eta + J @ step)
        cost = float((off + step) @ prior @ (off + step) + np.linalg.slogdet(hessian)[1])
        logs.append(_log_density(there, float(value)) - 0.5 * (cost + mixing))
        means.append(peak.u + step)
        covariances.append(wide)
    log_weights = np.array(logs) + np.log(np.maximum(widths, 1e-300))
    weights = np.exp(log_weights - log_weights.max())
    return JointPosterior(sigma, weights / weights.sum(), np.array(means), np.array(covariances))


def _log_density(found: ModeErrors, sigma: float) -> float:
    """ln p(η | σ) of errors of which some are gross, constants left out."""
    own = found.variances + found.floors
    variances = own + sigma**2 * found.reference
    squares, members, counts = found.squares(variances)
    wider = np.bincount(members, np.log(variances / own))  # ln |D(σ)| − ln |D(0)|
    gross = np.log(GROSS_SHARE) + counts * np.log(np.sqrt(2 * np.pi) / (2 * GROSS_REACH))
    logs = np.logaddexp(np.log(1 - GROSS_SHARE) - (squares + wider) / 2, gross)
    return float(logs.sum())


def figure_errors(
    u: FloatArray, covariance: FloatArray, coordinates: JointCoordinates
) -> FloatArray:
    """ln (true / estimated spring) by an error of one prior std of each figure and of the level.

    Parameters
    ----------
    u : ndarray, shape (n_dim,)
        Peak.
    covariance : ndarray, shape (n_dim, n_dim)
        Of the joint posterior.
    coordinates : JointCoordinates
        With the priors of the description's figures and of the level.

    Returns
    -------
    ndarray, shape (q + 1, 3)
        Rows: the q figures, then the level; columns: the springs [-].
    """
    places = np.arange(N_SPRINGS, N_SPRINGS + len(coordinates.figures) + 1)
    values, vectors = np.linalg.eigh(coordinates.prior_precision[np.ix_(places, places)])
    root = (vectors * np.sqrt(values)) @ vectors.T  # symmetric: a figure keeps its name
    return np.asarray((_log_rows(u, coordinates) @ covariance[:, places] @ root).T)


def systematic_errors(
    peak: JointPeak, posterior: JointPosterior, coordinates: JointCoordinates
) -> FloatArray:
    """(3, 3) symmetric root of the covariance that systematic errors of the modes, the floors and
    the discrepancy, give ln k11, ln k22, ln k12."""
    found = peak.comparison
    lasting = found.floors + posterior.likeliest_sigma**2 * found.reference
    D = found.variances + lasting
    weights = found.robust_weights(D)
    gain = (
        _log_rows(peak.u, coordinates) @ posterior.covariance @ (found.jacobian.T * (weights / D))
    )
    values, vectors = np.linalg.eigh((gain * (lasting / weights)) @ gain.T)
    return np.asarray((vectors * np.sqrt(np.maximum(values, 0.0))) @ vectors.T)


def _log_rows(u: FloatArray, coordinates: JointCoordinates) -> FloatArray:
    """(3, n_dim) d ln θ / d u."""
    rows = np.zeros((N_SPRINGS, len(u)))
    slopes = coordinates.slopes(u)[:N_SPRINGS, :N_SPRINGS]
    rows[:, :N_SPRINGS] = slopes / coordinates.springs(u)[:, None]
    return rows


@dataclass(frozen=True, slots=True, eq=False)
class ErrorBudget:
    """Shares and slopes by figure."""

    names: tuple[str, ...]
    """(n,) of the figures, the level and the sensors' figures; last "measurement": the rest"""
    shares: FloatArray
    """(n, 3) of the variance of ln k11, ln k22, ln k12, of sum 1 over n [-]"""
    slopes: FloatArray
    """(n, 3) change of ln k by one posterior standard deviation of the figure [-]"""


def error_budget(
    u: FloatArray, covariance: FloatArray, coordinates: JointCoordinates
) -> ErrorBudget:
    """The budget about a peak u with the joint covariance."""
    rows = _log_rows(u, coordinates)
    total = np.einsum("ki,ij,kj->k", rows, covariance, rows)
    cross = rows @ covariance  # (3, n_dim)
    figures = np.arange(N_SPRINGS, len(u))
    stds = np.sqrt(np.diag(covariance)[figures])
    slopes = (cross[:, figures] / stds).T
    alone = (slopes**2 / total).clip(0.0, 1.0)
    inner = covariance[np.ix_(figures, figures)]
    explained = np.einsum("ki,ki->k", cross[:, figures] @ np.linalg.inv(inner), cross[:, figures])
    explained = np.clip(explained / total, 0.0, 1.0)
    shares = alone / np.maximum(alone.sum(axis=0), 1e-300) * explained
    return ErrorBudget(
        names=(*coordinates.names[N_SPRINGS:], "measurement"),
        shares=np.vstack([shares, 1 - explained]),
        slopes=np.vstack([slopes, np.sqrt((1 - explained) * total)]),
    )
