"""The posterior as a function of the stiffness ratios, σ integrated out: a `LogDensity`; its peak
and the curvature there, where chains start, never the answer.
"""

import numpy as np

from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import ModalLikelihood
from pipeline.updating.likelihood.pairing import DIFFERENCE, STEP_LENGTHS
from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.prior import Prior, modal_where_supported
from pipeline.updating.samplers.interface import Peak, Target, log_prior_volume
from sensors.arrays import FloatArray

GAUSS_NEWTON_STEPS = 12  # at most
WIDEST = 1.0  # standard deviation of a ratio beyond which a Gaussian has no information [-]


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


def laplace_peak(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    start: FloatArray,
) -> Peak:
    """Gauss-Newton from start, (3,) ratios, at the σ that is most likely on the way.

    H = Jᵀ Σ(σ)⁻¹ J,   J = dη/dr by differences;   covariance = H⁻¹
    """
    ratios = start
    hessian = np.eye(3)
    for _ in range(GAUSS_NEWTON_STEPS):
        points = ratios + DIFFERENCE * np.vstack([np.zeros(3), np.eye(3)])
        modes = forward.modal(prior.stiffness(points))
        whitened = likelihood.whitened(modes)
        jacobian = (whitened[1:] - whitened[0]).T / DIFFERENCE
        weights = likelihood.weights(whitened[0] ** 2)
        gradient = jacobian.T @ (weights * whitened[0])
        hessian = (jacobian.T * weights) @ jacobian
        if not np.all(np.isfinite(hessian)):
            return Peak(ratios, np.eye(3) * WIDEST**2)
        step = -np.linalg.pinv(hessian, rcond=1e-12) @ gradient
        better = _best_on_line(likelihood, forward, prior, ratios, step)
        if better is None:
            break
        ratios = better
        if np.abs(jacobian @ step).max() < 0.02:
            break
    return Peak(ratios, bounded_inverse(hessian))


def _best_on_line(
    likelihood: ModalLikelihood,
    forward: ForwardModel,
    prior: Prior,
    ratios: FloatArray,
    step: FloatArray,
) -> FloatArray | None:
    """The most likely of a few points along the step; None where standing still is best."""
    trials = np.vstack([ratios, ratios + STEP_LENGTHS[:, None] * step])
    trials = trials[prior.supports(trials)]
    if not len(trials):
        return None
    values = likelihood.log_likelihood(forward.modal(prior.stiffness(trials))).max(axis=1)
    best = int(np.argmax(values))
    return None if np.array_equal(trials[best], ratios) else trials[best]


def bounded_inverse(hessian: FloatArray) -> FloatArray:
    """H⁻¹ with every direction's standard deviation at most WIDEST."""
    values, directions = np.linalg.eigh(hessian)
    variances = 1 / np.maximum(values, 1 / WIDEST**2)
    return (directions * variances) @ directions.T
