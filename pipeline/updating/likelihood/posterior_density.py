"""The posterior as a function of the stiffness ratios, σ integrated out: a `LogDensity`."""

import numpy as np

from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import ModalLikelihood
from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.prior import Prior, modal_where_supported
from pipeline.updating.samplers.interface import Peak, Target, log_prior_volume
from sensors.arrays import FloatArray


class StiffnessDensity:
    """log p(d | r) of ratios, (n, 3), with σ integrated out; a σ drawn for each as companion.

    With a population, p(d | r) p(r | population) V, V the volume of the uniform prior: what a
    sampler takes for a likelihood under the uniform prior is then the posterior under the
    population's, and its evidence is that of both.
    """

    def __init__(
        self,
        likelihood: ModalLikelihood,
        forward: ForwardModel,
        prior: Prior,
        generator: np.random.Generator,
        population: StiffnessPopulation | None = None,
    ) -> None:
        """forward: the modes that the likelihood compares, in its order. generator: for σ."""
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
        self._generator = generator
        self._population = population
        self.log_prior_volume = log_prior_volume(prior)

    def __call__(self, ratios: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) log densities, −inf outside the prior, and (n,) σ."""
        supported, modes = modal_where_supported(self._forward, self._prior, ratios)
        density = np.full(len(ratios), -np.inf)
        sigma = np.zeros(len(ratios))
        if modes is not None:
            density[supported], sigma[supported] = self._likelihood.marginal(modes, self._generator)
            density[supported] += self._prior.log_density(ratios[supported])
        if self._population is not None and supported.any():
            farm = self._population.log_density(ratios[supported, :3])
            density[supported] += farm + self.log_prior_volume
        return density, sigma

    def prior_draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, 3), what else is uncertain beside it"""
        return self._prior.draws(n, generator)

    def target(self, peak: Peak, ensemble: FloatArray | None = None) -> Target:
        """What a sampler is given. ensemble: (n, 3) draws of the posterior before."""
        return Target(self, self.prior_draws, self.log_prior_volume, peak, ensemble)
