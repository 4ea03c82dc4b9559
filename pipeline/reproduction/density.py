"""Eqs. 8 to 10 as published, at points (k11, k22, k12 over nominal, σ).

    log p(d | θ) = −½ Σ_i [η_i² / s_i² + log s_i²],   s_i² = var_i + σ² ref_i

with η the differences of frequencies and shape components, var their variances by SSI-cov (Σ_D) and
σ² ref those of the model's discrepancy (Σ_G). Eq. 9 prints ηᵀ Σ η where the inverse is meant.
Independent of `updating.exact_inference.StiffnessDensity`, which takes the density on a grid of σ.
"""

import numpy as np

from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import ModalLikelihood
from pipeline.updating.prior import Prior, modal_where_supported
from pipeline.updating.samplers.interface import Peak, Target, log_prior_volume
from sensors.arrays import FloatArray


class PublishedDensity:
    """log p(d | r, σ) under a uniform prior, for any sampler."""

    def __init__(self, likelihood: ModalLikelihood, forward: ForwardModel, prior: Prior) -> None:
        """Keep the likelihood, the model and the prior.

        Parameters
        ----------
        likelihood : ModalLikelihood
            Errors η, their variances and the reference of σ.
        forward : ForwardModel
            Model of the compared modes, in the order of the likelihood.
        """
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
        self._variances = np.diag(likelihood.measurement_covariance)
        self._log_volume = log_prior_volume(prior) + float(np.log(prior.settings.highest_sigma))

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return log densities, −inf outside the prior, and σ at points of shape (n, 4)."""
        sigma = points[:, 3]
        inside = np.flatnonzero((sigma >= 0) & (sigma <= self._prior.settings.highest_sigma))
        supported, modes = modal_where_supported(self._forward, self._prior, points[inside, :3])
        density = np.full(len(points), -np.inf)
        if modes is not None:
            rows = inside[supported]
            variances = self._variances + np.outer(sigma[rows] ** 2, self._likelihood.reference)
            errors = self._likelihood.errors(modes)
            values = -0.5 * (errors**2 / variances + np.log(variances)).sum(axis=1)
            density[rows] = np.where(np.isfinite(values), values, -np.inf)
        return density, sigma

    def prior_draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """Draw from the prior, shape (n, 4)."""
        sigma = generator.uniform(0.0, self._prior.settings.highest_sigma, size=n)
        return np.column_stack([self._prior.draws(n, generator), sigma])

    def target(self, peak: Peak) -> Target:
        """Return the target of a sampler.

        Parameters
        ----------
        peak : Peak
            Peak of the density in the three ratios.
        """
        start = self._prior.settings.highest_sigma / 4
        covariance = np.zeros((4, 4))
        covariance[:3, :3], covariance[3, 3] = peak.covariance, start**2
        joint = Peak(np.append(peak.ratios, start), covariance)
        return Target(self, self.prior_draws, self._log_volume, joint)
