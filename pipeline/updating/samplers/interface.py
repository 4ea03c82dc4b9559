"""What every sampler is given and gives back, so that one can stand in for another.

A sampler is a function of a Target and a random generator that answers with PosteriorDraws;
`samplers.sampler_of` makes each of them from its name.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from pipeline.messages import QualityWarning
from sensors.arrays import FloatArray

POINTS_AT_ONCE = (
    2048  # points evaluated at once: the model's arrays stay within the processor's cache
)

LogDensity = Callable[[FloatArray], tuple[FloatArray, FloatArray]]
"""(n, n_dim) points → (n,) log density, −inf outside, and (n,) a companion drawn given the point
(here σ) that stays with the walker that takes the point."""


@dataclass(frozen=True, slots=True, eq=False)
class Peak:
    """Gaussian approximation of the posterior in the ratios k / nominal."""

    ratios: FloatArray
    """(3,); what else is uncertain follows (`uncertain`)."""
    covariance: FloatArray
    """(3, 3)."""


@dataclass(frozen=True, slots=True, eq=False)
class Target:
    """A posterior under a uniform prior, and what is known of it beforehand.

    The last two only determine where to look first. They never enter the answer.
    """

    log_density: LogDensity
    """Log likelihood, −inf where the prior is zero."""
    prior_draws: Callable[[int, np.random.Generator], FloatArray]
    """n → (n, n_dim)."""
    log_prior_volume: float
    """Log of the volume on which the prior is uniform."""
    peak: Peak
    """Gaussian approximation of the posterior."""
    ensemble: FloatArray | None = None
    """(n, n_dim) draws of an earlier posterior."""


@dataclass(frozen=True, slots=True, eq=False)
class PosteriorDraws:
    """Draws from a posterior, all of equal weight, with what a reader needs to trust them."""

    flat: FloatArray
    """(n_draws, n_dim + 1) points with their companion."""
    ensemble: FloatArray
    """(n, n_dim) of the points: where the next posterior may start."""
    sampler: str
    """"importance", "emcee", …"""
    evaluations: int
    """Of the likelihood, adaptation included."""
    ess: float
    """Independent draws with as much information."""
    rhat: float = float("nan")
    """Largest R̂ over chains or independent batches."""
    autocorrelation_time: float = float("nan")
    """[steps]; NaN where there is no chain."""
    efficiency: float = float("nan")
    """Kish ESS / draws of an importance sampler [-]."""
    log_evidence: float = float("nan")
    """Log p(d), the likelihood's dropped constant left out."""
    log_evidence_std: float = float("nan")
    warnings: tuple[QualityWarning, ...] = ()


class PosteriorSampler(Protocol):
    """Draws from a posterior; the same generator gives the same draws."""

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Raises nothing of its own: a poor result is reported in `warnings`."""
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
