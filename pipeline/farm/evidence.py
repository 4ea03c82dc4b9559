"""What each turbine's own measurements say of its springs, small enough to be sent around.

posterior's draws ──÷ own prior──► likelihood as a mixture of Gaussians ──► [pooling]

No sample, no window and no mode leaves the turbine: a farm is pooled from some ten numbers a
component.

What the description has wrong moves all turbines alike. With L_i what its errors ξ ~ N(0, I) make
of turbine i (`FoundationPosterior.figure_errors`), the likelihood is one of x_i − L_iᵀ ξ, the
springs as the nominal description reads them, with the covariance C_i − L_iᵀ L_i: what turbine i's
own measurements leave open.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import UNCERTAIN_STRUCTURE, FoundationPosterior
from pipeline.updating.population import SpringCoordinates
from pipeline.updating.samplers.student_t import fitted_mixture
from sensors.arrays import FloatArray

NEARLY_GAUSSIAN = 1e6  # degrees of freedom at which Student's t is a Gaussian to six digits
MOST_COMPONENTS = 4
FEWEST_DRAWS = 50  # from which a covariance of three springs is worth anything
LEAST_OWN = 0.01  # share of the variance in any direction that is a turbine's own [-]


@dataclass(frozen=True, slots=True, eq=False)
class TurbineEvidence:
    """p(data of one turbine | x) ∝ Σ_k a_k N(x; m_k, C_k)

    x: `SpringCoordinates`, or any other d coordinates.
    """

    turbine: str
    shares: FloatArray
    """a, (n_components,), sum 1."""
    means: FloatArray
    """m, (n_components, d)."""
    covariances: FloatArray
    """C, (n_components, d, d)."""
    figures: tuple[str, ...] = ()
    """Of the description that are uncertain."""
    common: FloatArray | None = None
    """L, (n_figures, d), what their errors make; None: exact."""
    change: tuple[FloatArray, FloatArray] | None = None
    """ĉ (d,), V (d, d); None: none was seen."""

    def of_the_description(self) -> "TurbineEvidence":
        """Return the evidence of x − Lᵀ ξ: its own measurements' part of the covariances."""
        if self.common is None:
            return self
        shared = self.common.T @ self.common
        own = np.array([_remainder(each, shared) for each in self.covariances])
        return replace(self, covariances=own)


def _remainder(covariance: FloatArray, part: FloatArray) -> FloatArray:
    """(d, d) covariance − part, at least LEAST_OWN of the covariance in every direction: the part
    is the one about a peak, the covariance one of draws."""
    factor = np.linalg.cholesky(covariance)
    inner = np.linalg.solve(factor, np.linalg.solve(factor, part).T)
    shares, vectors = np.linalg.eigh(inner)
    turned = factor @ vectors
    return np.asarray((turned * np.maximum(1 - shares, LEAST_OWN)) @ turned.T)


def evidence_of(
    posterior: FoundationPosterior, coordinates: SpringCoordinates, generator: np.random.Generator
) -> TurbineEvidence:
    """Return the likelihood that a posterior stands for.

    Parameters
    ----------
    posterior : FoundationPosterior
        With FEWEST_DRAWS draws at least.
    coordinates : SpringCoordinates
        In which the likelihood is described.
    generator : numpy.random.Generator
        For where the fit starts.

    Notes
    -----
    Every draw x counts 1 / π(x): what its prior gave to where it lies is taken away again. That is
    |∂x/∂k| of a prior uniform in k, and ρ of an uncertain structure's, which is flat in ln k11,
    ln k22 and logit ρ². A mixture is then fitted, of as many components as AIC pays for.
    """
    ratios = posterior.draws[:, :3] / coordinates.nominal
    points = coordinates.of_ratios(ratios)
    if posterior.structure == UNCERTAIN_STRUCTURE:
        log_weights = 0.5 * np.log(ratios[:, 2] ** 2 / (ratios[:, 0] * ratios[:, 1]))
    else:
        log_weights = -coordinates.log_jacobian(points)
    weights = np.exp(log_weights - log_weights.max())
    fit = fitted_mixture(
        points, weights, generator, most_components=MOST_COMPONENTS, degrees=NEARLY_GAUSSIAN
    )
    covariances = fit.factors @ np.swapaxes(fit.factors, 1, 2)
    return TurbineEvidence(
        posterior.turbine,
        fit.shares,
        fit.means,
        covariances,
        figures=tuple(each.name for each in posterior.figure_errors),
        common=_common(posterior, coordinates),
    )


def _common(posterior: FoundationPosterior, coordinates: SpringCoordinates) -> FloatArray | None:
    if not posterior.figure_errors:
        return None
    logs = np.array([[each.k11, each.k22, each.k12] for each in posterior.figure_errors])
    medians = [each.median / each.nominal for each in posterior.parameters[:3]]
    return coordinates.steps(logs, np.array(medians))


def common_errors(evidence: Sequence[TurbineEvidence]) -> tuple[tuple[str, ...], FloatArray]:
    """Names of all figures, and (n_turbines, n_figures, d) what their errors make of each turbine;
    nothing where a turbine's structure has them as exact."""
    names = tuple(dict.fromkeys(name for each in evidence for name in each.figures))
    found = np.zeros((len(evidence), len(names), evidence[0].means.shape[1]))
    for row, each in enumerate(evidence):
        if each.common is not None:
            found[row, [names.index(name) for name in each.figures]] = each.common
    return names, found


@dataclass(frozen=True, slots=True, eq=False)
class StackedEvidence:
    """All turbines' evidence in arrays; components that a turbine lacks have no share."""

    log_shares: FloatArray
    """(n_turbines, n_components), −inf for none."""
    means: FloatArray
    """(n_turbines, n_components, d)."""
    covariances: FloatArray
    """(n_turbines, n_components, d, d)."""
    changes: tuple[tuple[FloatArray, FloatArray] | None, ...] = ()
    """Of each turbine; (): none."""

    @classmethod
    def of(cls, evidence: Sequence[TurbineEvidence]) -> "StackedEvidence":
        """Return the evidence, turbines in their order."""
        most = max(len(each.shares) for each in evidence)
        d = evidence[0].means.shape[1]
        log_shares = np.full((len(evidence), most), -np.inf)
        means = np.zeros((len(evidence), most, d))
        covariances = np.tile(np.eye(d), (len(evidence), most, 1, 1))
        for row, each in enumerate(evidence):
            n = len(each.shares)
            log_shares[row, :n] = np.log(each.shares)
            means[row, :n], covariances[row, :n] = each.means, each.covariances
        return cls(log_shares, means, covariances, tuple(each.change for each in evidence))
