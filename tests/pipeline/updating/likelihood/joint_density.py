"""The posterior with σ as a fourth parameter: the second route to what has σ integrated out."""

import numpy as np

from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import SMALLEST_SIGMA_STEP, ModalLikelihood
from pipeline.updating.prior import Prior, log_prior_volume, modal_where_supported
from pipeline.updating.samplers.interface import Peak, Target
from sensors.arrays import FloatArray


class JointDensity:
    """log p(d | r, σ) of points (r, σ), (n, 4), as [foundation-updating] samples it.

    Read off the likelihood's grid of σ by cubics through four nodes, so that it is the likelihood
    whatever distribution of errors that has, and its exponential's mean over σ is StiffnessDensity.
    """

    def __init__(self, likelihood: ModalLikelihood, forward: ForwardModel, prior: Prior) -> None:
        """forward: the modes that the likelihood compares, in its order."""
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
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
            density[rows] = self._read_off(self._likelihood.log_likelihood(modes), sigma[rows])
        return density, sigma

    def _read_off(self, values: FloatArray, sigma: FloatArray) -> FloatArray:
        """(n,) of values, (n, n_sigma), at sigma, (n,): Lagrange's cubic in the even steps of
        arcsinh σ that the grid has."""
        n_nodes = len(self._likelihood.sigma)
        steps = np.arcsinh(self._likelihood.sigma / SMALLEST_SIGMA_STEP)
        place = np.arcsinh(sigma / SMALLEST_SIGMA_STEP) / steps[-1] * (n_nodes - 1)
        first = np.clip(place.astype(int) - 1, 0, n_nodes - 4)
        nodes = np.take_along_axis(values, first[:, None] + np.arange(4), axis=1)
        known = np.isfinite(nodes).all(axis=1)  # else the structure cannot stand: −inf at every σ
        found = np.full(len(sigma), -np.inf)
        found[known] = (_cubic_shares(place - first)[known] * nodes[known]).sum(axis=1)
        return found

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


def _cubic_shares(place: FloatArray) -> FloatArray:
    """(n, 4) Lagrange's weights of the nodes 0, 1, 2, 3 for a value at place, (n,), among them."""
    shares = np.ones((len(place), 4))
    for node in range(4):
        for other in {0, 1, 2, 3} - {node}:
            shares[:, node] *= (place - other) / (node - other)
    return shares
