"""What every sampler is given and gives back, so that one can stand in for another.

A sampler is a function of a Target and a random generator that answers with PosteriorDraws;
`samplers.sampler_of` makes each of them from its name.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Protocol

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.updating.prior import Prior
from sensors.arrays import FloatArray

POINTS_AT_ONCE = (
    2048  # points evaluated at once: the model's arrays stay within the processor's cache
)
VOLUME_NODES = 1000  # a side, of the midpoint rule for the prior's volume

LogDensity = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""(n, n_dim) points → (n,) log density, −inf outside, and (n,) a companion drawn given the point
(here σ) that stays with the walker that takes the point."""


@dataclass(frozen=True, slots=True, eq=False)
class Peak:
    """Gaussian approximation of the posterior in the ratios k / nominal."""

    ratios: FloatArray  # (3,); what else is uncertain follows (`uncertain`)
    covariance: FloatArray  # (3, 3)


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A posterior under a uniform prior, and what is known of it beforehand.

    The last two only determine where to look first. They never enter the answer.
    """

    log_density: LogDensity  # log likelihood, −inf where the prior is zero
    prior_draws: Callable[[int, np.random.Generator], FloatArray]  # n → (n, n_dim)
    log_prior_volume: float  # log of the volume on which the prior is uniform
    peak: Peak  # Gaussian approximation of the posterior
    ensemble: FloatArray | None = None  # (n, n_dim) draws of an earlier posterior


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorDraws:
    """Draws from a posterior, all of equal weight, with what a reader needs to trust them."""

    flat: FloatArray  # (n_draws, n_dim + 1) points with their companion
    ensemble: FloatArray  # (n, n_dim) of the points: where the next posterior may start
    sampler: str  # "importance", "emcee", …
    evaluations: int  # of the likelihood, adaptation included
    ess: float  # independent draws with as much information
    rhat: float = float("nan")  # largest R̂ over chains or independent batches
    autocorrelation_time: float = float("nan")  # [steps]; NaN where there is no chain
    efficiency: float = float("nan")  # Kish ESS / draws of an importance sampler [-]
    log_evidence: float = float("nan")  # log p(d), the likelihood's dropped constant left out
    log_evidence_std: float = float("nan")
    doubts: tuple[QualityWarning, ...] = ()


class PosteriorSampler(Protocol):
    """Draws from a posterior; the same generator gives the same draws."""

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Raises nothing of its own: a poor result is reported in `doubts`."""
        ...


@dataclass(slots=True, eq=False)
class CountedDensity:
    """A log density evaluated in chunks, with the number of points it was asked for."""

    log_density: LogDensity
    evaluations: int = field(default=0, init=False)

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """(n,) log densities and (n,) companions at points, (n, n_dim)."""
        self.evaluations += len(points)
        starts = range(0, max(len(points), 1), POINTS_AT_ONCE)
        parts = [self.log_density(points[start : start + POINTS_AT_ONCE]) for start in starts]
        return (
            np.concatenate([values for values, _ in parts]),
            np.concatenate([companions for _, companions in parts]),
        )


def log_prior_volume(prior: Prior) -> float:
    """log of ∫ dr over the supported ratios: the box where k11·k22 > k12².

        V = ∫∫ max(0, min(h, √(r11 r22 / c)) − l) dr11 dr22,   c = k12² / (k11 k22) at nominal

    with l and h the box's bounds. What gravity alone forbids (.1 % of it for the IEA 15 MW
    monopile) counts as prior with a likelihood of zero.
    """
    box = (prior.settings.lowest_ratio, prior.settings.highest_ratio)
    k11, k22, k12 = map(float, prior.nominal)
    return _log_volume(box, k11, k22, k12)


@lru_cache(maxsize=64)  # the same for every window of a turbine
def _log_volume(box: tuple[float, float], k11: float, k22: float, k12: float) -> float:
    """log of the integral over r11 and r22 by midpoints."""
    low, high = box
    nodes = low + (np.arange(VOLUME_NODES) + 0.5) * (high - low) / VOLUME_NODES
    highest = np.minimum(high, np.sqrt(np.outer(nodes, nodes) * k11 * k22 / k12**2))
    return float(np.log(np.maximum(highest - low, 0.0).mean() * (high - low) ** 2))
