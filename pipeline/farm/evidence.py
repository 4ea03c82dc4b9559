"""What each turbine's own measurements say of its springs, small enough to be sent around.

posterior's draws ──÷ own prior──► likelihood as a mixture of Gaussians ──► [pooling]

No sample, no window and no mode leaves the turbine: a farm is pooled from some ten numbers a
component.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pipeline.messages import FoundationPosterior
from pipeline.updating.population import SpringCoordinates
from pipeline.updating.samplers.student_t import fitted_mixture
from sensors.arrays import FloatArray

NEARLY_GAUSSIAN = 1e6  # degrees of freedom at which Student's t is a Gaussian to six digits
MOST_COMPONENTS = 4
FEWEST_DRAWS = 50  # from which a covariance of three springs is worth anything


@dataclass(frozen=True, slots=True, eq=False)
class TurbineEvidence:
    """p(data of one turbine | x) ∝ Σ_k a_k N(x; m_k, C_k)

    x: `SpringCoordinates`, or any other d coordinates.
    """

    turbine: str
    shares: FloatArray  # a, (n_components,), sum 1
    means: FloatArray  # m, (n_components, d)
    covariances: FloatArray  # C, (n_components, d, d)


def evidence_of(
    posterior: FoundationPosterior, coordinates: SpringCoordinates, generator: np.random.Generator
) -> TurbineEvidence:
    """The likelihood that a posterior under the uniform prior of k stands for.

    Every draw x counts |∂x/∂k| = 1 / π(x): what the prior, uniform in k, gave to where it lies is
    taken away again. A mixture is then fitted, of as many components as AIC pays for.

    posterior   with FEWEST_DRAWS draws at least
    generator   for where the fit starts
    """
    ratios = posterior.draws[:, :3] / coordinates.nominal
    points = coordinates.of_ratios(ratios)
    log_weights = -coordinates.log_jacobian(points)
    weights = np.exp(log_weights - log_weights.max())
    fit = fitted_mixture(
        points, weights, generator, most_components=MOST_COMPONENTS, degrees=NEARLY_GAUSSIAN
    )
    covariances = fit.factors @ np.swapaxes(fit.factors, 1, 2)
    return TurbineEvidence(posterior.turbine, fit.shares, fit.means, covariances)


@dataclass(frozen=True, slots=True, eq=False)
class StackedEvidence:
    """All turbines' evidence in arrays; components that a turbine lacks have no share."""

    log_shares: FloatArray  # (n_turbines, n_components), −inf for none
    means: FloatArray  # (n_turbines, n_components, d)
    covariances: FloatArray  # (n_turbines, n_components, d, d)

    @classmethod
    def of(cls, evidence: Sequence[TurbineEvidence]) -> "StackedEvidence":
        """The evidence, turbines in their order."""
        most = max(len(each.shares) for each in evidence)
        d = evidence[0].means.shape[1]
        log_shares = np.full((len(evidence), most), -np.inf)
        means = np.zeros((len(evidence), most, d))
        covariances = np.tile(np.eye(d), (len(evidence), most, 1, 1))
        for row, each in enumerate(evidence):
            n = len(each.shares)
            log_shares[row, :n] = np.log(each.shares)
            means[row, :n], covariances[row, :n] = each.means, each.covariances
        return cls(log_shares, means, covariances)
