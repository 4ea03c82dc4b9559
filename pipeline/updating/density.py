"""The posterior as a function of its parameters: with σ integrated out, or with σ as a fourth one.

Both are `LogDensity`s, for any sampler.
"""

import numpy as np
from scipy.linalg import eigh

from pipeline.updating.forward_model import FloatArray, ForwardModel
from pipeline.updating.laplace import Peak
from pipeline.updating.likelihood import ModalLikelihood
from pipeline.updating.prior import Prior, modal_where_supported
from pipeline.updating.sampling import Target, log_prior_volume


class StiffnessDensity:
    """log p(d | r) of ratios, (n, 3), with σ integrated out; a σ drawn for each as companion."""

    def __init__(
        self,
        likelihood: ModalLikelihood,
        forward: ForwardModel,
        prior: Prior,
        generator: np.random.Generator,
    ) -> None:
        """forward: the modes that the likelihood compares, in its order. generator: for σ."""
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
        self._generator = generator
        self.log_prior_volume = log_prior_volume(prior)

    def __call__(self, ratios: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) log densities, −inf outside the prior, and (n,) σ."""
        supported, modes = modal_where_supported(self._forward, self._prior, ratios)
        density = np.full(len(ratios), -np.inf)
        sigma = np.zeros(len(ratios))
        if modes is not None:
            density[supported], sigma[supported] = self._likelihood.marginal(modes, self._generator)
        return density, sigma

    def prior_draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3)"""
        return self._prior.draws(n, generator)

    def target(self, peak: Peak, ensemble: FloatArray | None = None) -> Target:
        """What a sampler is given. ensemble: (n, 3) draws of the posterior before."""
        return Target(self, self.prior_draws, self.log_prior_volume, peak, ensemble)


class JointDensity:
    """log p(d | r, σ) of points (r, σ), (n, 4), as [foundation-updating] samples it.

    With W and λ such that Wᵀ Σ_D W = 1 and Wᵀ R W = diag(λ),
        log p = −½ Σ_j (Wᵀη)_j² / (1 + σ² λ_j) − ½ Σ_j log(1 + σ² λ_j) + constant,
    the same constant as in StiffnessDensity, whose exponential is the mean of this one's over σ.
    """

    def __init__(self, likelihood: ModalLikelihood, forward: ForwardModel, prior: Prior) -> None:
        """forward: the modes that the likelihood compares, in its order."""
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
        self._ratios, self._whitening = eigh(
            np.diag(likelihood.reference), likelihood.measurement_covariance
        )
        self.log_prior_volume = log_prior_volume(prior) + float(
            np.log(prior.settings.highest_sigma)
        )

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) log densities, −inf outside the prior, and σ again as the companion, (n,)."""
        ratios, sigma = points[:, :3], points[:, 3]
        density = np.full(len(points), -np.inf)
        inside = np.flatnonzero((sigma >= 0) & (sigma <= self._prior.settings.highest_sigma))
        supported, modes = modal_where_supported(self._forward, self._prior, ratios[inside])
        if modes is not None:
            rows = inside[supported]
            density[rows] = self._values(self._likelihood.errors(modes), sigma[rows])
        return density, sigma

    def _values(self, errors: FloatArray, sigma: FloatArray) -> FloatArray:
        growth = sigma[:, None] ** 2 * np.maximum(self._ratios, 0.0)
        squares = (errors @ self._whitening) ** 2
        values = -0.5 * (squares / (1 + growth) + np.log1p(growth)).sum(axis=1)
        return np.where(np.isfinite(values), values, -np.inf)

    def prior_draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 4)"""
        sigma = generator.uniform(0.0, self._prior.settings.highest_sigma, size=n)
        return np.column_stack([self._prior.draws(n, generator), sigma])

    def target(self, peak: Peak) -> Target:
        """What a sampler is given. peak: of the three ratios; σ starts in its lowest half."""
        highest = self._prior.settings.highest_sigma
        covariance = np.zeros((4, 4))
        covariance[:3, :3], covariance[3, 3] = peak.covariance, (highest / 4) ** 2
        joint = Peak(np.append(peak.ratios, highest / 4), covariance)
        return Target(self, self.prior_draws, self.log_prior_volume, joint)
