"""Transitional Markov chain Monte Carlo: from the prior to the posterior through tempered ones.

    p_j(x) ∝ p(d | x)^β_j p(x),   0 = β_0 < β_1 < … < β_m = 1

Twice: as published, one Metropolis step for each sample of a stage, which is biased when the data
are informative (the samples of a stage are little but copies of the last stage's); and corrected,
where the population only shows an importance sampler where the posterior is.
Source: Ching and Chen (2007), Journal of Engineering Mechanics 133(7), 816–832.
"""

from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pipeline.messages import QualityWarning
from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.importance import (
    ENSEMBLE,
    Adaptation,
    normalised,
    posterior_draws,
    systematic_choice,
    weighted_draws,
    with_wide_part,
)
from pipeline.updating.samplers.interface import CountedDensity, PosteriorDraws, Target
from pipeline.updating.samplers.student_t import fitted_mixture, kish_size, weighted_moments
from sensors.arrays import FloatArray
from sensors.settings import NO_KEY

MOST_STAGES = 200
GOOD_ACCEPTANCE = 0.3  # of a random walk in a few dimensions [-]


@dataclass(frozen=True, slots=True)
class PublishedSettings:
    """TMCMC with the constants of Ching and Chen (2007)."""

    samples: int = field(default=20_000, metadata=NO_KEY)
    """A stage; §4.2 has 100 000."""
    variation: ClassVar[float] = 1.0
    """Coefficient of variation of a stage's weights [-]."""
    scale: ClassVar[float] = 0.2
    """β, of the proposal's standard deviations to the stage's [-]."""

    def __post_init__(self) -> None:
        _check(self.samples)


@dataclass(frozen=True, slots=True)
class TemperingSettings:
    """TMCMC, corrected."""

    samples: int = 20_000
    """Number of samples of the last stage, and of draws."""
    particles: int = field(default=1000, metadata=NO_KEY)
    """Of every stage."""
    variation: ClassVar[float] = 0.5
    """Coefficient of variation of a stage's weights [-]."""
    remembered: ClassVar[float] = 0.6
    """Correlation with a stage's start at which its steps end [-]."""
    most_steps: ClassVar[int] = 8
    """Of a stage."""
    pilot: int = field(default=4000, metadata=NO_KEY)
    """Draws of one pilot round of the importance sampling."""

    most_pilots: ClassVar[int] = 4
    """Rounds."""
    components: ClassVar[int] = 8
    """At most, of the mixture."""
    least_efficiency: ClassVar[float] = 0.1
    """Kish ESS / N below which the answer is doubted [-]."""

    def __post_init__(self) -> None:
        _check(min(self.samples, self.particles, self.pilot))


def _check(samples: int) -> None:
    if samples < 100:
        raise UpdatingError(f"{samples} samples are too few for tempering; at least 100 are needed")


@dataclass(frozen=True, slots=True, eq=False)
class Population:
    """Samples of one tempered distribution."""

    points: FloatArray
    """(n, n_dim)."""
    companions: FloatArray
    """(n,)."""
    log_likelihood: FloatArray
    """(n,)."""
    exponent: float = 0.0
    """β."""
    log_evidence: float = 0.0
    """Σ over the stages of log mean(w)."""
    variance: float = 0.0
    """Of log_evidence, were the samples independent."""
    stages: int = 0

    def taken(self, rows: NDArray[np.bool_] | NDArray[np.int64]) -> "Population":
        """The samples of these rows, a mask or indices: each as often as it is named."""
        return self.at(self.points[rows], self.companions[rows], self.log_likelihood[rows])

    def at(
        self, points: FloatArray, companions: FloatArray, log_likelihood: FloatArray
    ) -> "Population":
        """Other samples of the same stage."""
        return replace(self, points=points, companions=companions, log_likelihood=log_likelihood)


def from_prior(
    target: Target, density: CountedDensity, n: int, generator: np.random.Generator
) -> Population:
    """n draws of the prior, β = 0."""
    points = target.prior_draws(n, generator)
    values, companions = density(points)
    return Population(points, companions, values)


def next_exponent(log_likelihood: FloatArray, exponent: float, variation: float) -> float:
    """β_{j+1} ≤ 1 at which the weights p(d | x)^(β_{j+1} − β_j) vary by `variation`.

    Samples of no likelihood at all weigh nothing at any exponent and aren't counted.
    """
    finite = log_likelihood[np.isfinite(log_likelihood)]
    if not len(finite):
        raise UpdatingError(
            f"none of {len(log_likelihood)} draws of the prior has a likelihood above zero"
        )

    def varies_too_much(step: float) -> bool:
        weights = np.exp(step * (finite - finite.max()))
        return bool(weights.std() > variation * weights.mean())

    if not varies_too_much(1 - exponent):
        return 1.0
    low, high = 0.0, 1 - exponent
    for _ in range(100):
        middle = (low + high) / 2
        low, high = (low, middle) if varies_too_much(middle) else (middle, high)
    return exponent + high


def _stage(population: Population, variation: float) -> tuple[Population, FloatArray]:
    """The same samples at the next exponent, and the weights (of sum 1) that take them there."""
    exponent = next_exponent(population.log_likelihood, population.exponent, variation)
    log_weights = (exponent - population.exponent) * population.log_likelihood
    weights = normalised(log_weights)
    n = len(weights)
    reached = replace(
        population,
        exponent=exponent,
        log_evidence=population.log_evidence + float(logsumexp(log_weights) - np.log(n)),
        variance=population.variance + 1 / kish_size(weights) - 1 / n,
        stages=population.stages + 1,
    )
    return reached, weights


def _metropolis(
    population: Population,
    density: CountedDensity,
    factor: FloatArray,
    generator: np.random.Generator,
) -> tuple[Population, float]:
    """One random-walk step of every sample under its tempered density; the share accepted.

    factor   (n_dim, n_dim), a step is factor @ N(0, 1)

    The prior is uniform, so the ratio of densities is (p(d | x') / p(d | x))^β.
    """
    shape = population.points.shape
    proposed = population.points + generator.standard_normal(shape) @ factor.T
    values, companions = density(proposed)
    gain = population.exponent * (values - population.log_likelihood)
    accepted = np.log(generator.random(len(gain))) < gain
    moved = population.at(
        np.where(accepted[:, None], proposed, population.points),
        np.where(accepted, companions, population.companions),
        np.where(accepted, values, population.log_likelihood),
    )
    return moved, float(accepted.mean())


def _step_factor(points: FloatArray, weights: FloatArray) -> FloatArray:
    """Cholesky factor of the weighted covariance; only its diagonal where it is singular."""
    covariance = weighted_moments(points, weights)[1]
    try:
        return np.asarray(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:  # fewer distinct points than dimensions
        return np.diag(np.sqrt(np.maximum(np.diag(covariance), 1e-300)))


@dataclass(frozen=True, slots=True)
class PublishedTmcmc:
    """TMCMC as Ching and Chen published it. Shown for what it is: use the corrected one.

    In a stage a sample is picked with a chance proportional to its weight and one Metropolis step
    is made from where the chain that began there now stands; the result is a sample of the next
    stage. Chains don't know of each other, so all chains make their first step at once, then all
    that were picked twice their second, and so on: the same law, a few array operations a stage.
    """

    settings: PublishedSettings

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Draws of the last stage. Raises UpdatingError where no draw of the prior counts."""
        density = CountedDensity(target.log_density)
        population = from_prior(target, density, self.settings.samples, generator)
        while population.exponent < 1 and population.stages < MOST_STAGES:
            reached, weights = _stage(population, self.settings.variation)
            population = self._moved(reached, weights, density, generator)
        flat = np.column_stack([population.points, population.companions])
        flat = generator.permutation(flat)
        return PosteriorDraws(
            flat=flat,
            ensemble=flat[:ENSEMBLE, :-1],
            sampler="tmcmc-published",
            evaluations=density.evaluations,
            ess=_distinct(population.points),
            log_evidence=population.log_evidence,
            log_evidence_std=float(np.sqrt(population.variance)),
            warnings=(_PUBLISHED_BIAS, *_unfinished(population)),
        )

    def _moved(
        self,
        population: Population,
        weights: FloatArray,
        density: CountedDensity,
        generator: np.random.Generator,
    ) -> Population:
        """The next stage's samples: step k of every chain that was picked at least k times."""
        factor = self.settings.scale * _step_factor(population.points, weights)
        counts = generator.multinomial(len(weights), weights)
        chains = population
        visited = []
        for step in range(int(counts.max())):
            going = counts > step
            chains, counts = chains.taken(going), counts[going]
            chains, _ = _metropolis(chains, density, factor, generator)
            visited.append(chains)
        return population.at(
            np.concatenate([each.points for each in visited]),
            np.concatenate([each.companions for each in visited]),
            np.concatenate([each.log_likelihood for each in visited]),
        )


_PUBLISHED_BIAS = QualityWarning(
    "tmcmc-published",
    "TMCMC as published makes one Metropolis step a sample and stage: on informative data its "
    "posterior is too wide and its evidence is off; --sampler tmcmc is the mended one",
)


def _distinct(points: FloatArray) -> float:
    """Kish size of the distinct points. An upper bound: neighbours on a chain are not independent
    either."""
    return kish_size(np.unique(points, axis=0, return_counts=True)[1].astype(float))


def _unfinished(population: Population) -> tuple[QualityWarning, ...]:
    if population.exponent >= 1:
        return ()
    text = f"tempering stopped after {population.stages} stages at β = {population.exponent:.3g}"
    return (QualityWarning("tempering-unfinished", text),)


def tempered_population(
    target: Target,
    density: CountedDensity,
    settings: TemperingSettings,
    generator: np.random.Generator,
) -> Population:
    """Samples of the posterior by tempering with adapted steps.

    Parameters
    ----------
    target : Target
        With the prior.
    density : CountedDensity
        Of the posterior.
    settings : TemperingSettings
        With the number of particles and the weights' variation in a stage.
    generator : numpy.random.Generator
        That they are drawn with.

    Notes
    -----
    Each stage resamples, then walks until its samples have forgotten where they started. The step
    length starts at 2.38/√d standard deviations and follows the acceptance towards
    GOOD_ACCEPTANCE (Robbins and Monro), through all stages.
    """
    population = from_prior(target, density, settings.particles, generator)
    scale = 2.38 / np.sqrt(population.points.shape[1])
    while population.exponent < 1 and population.stages < MOST_STAGES:
        population, weights = _stage(population, settings.variation)
        factor = _step_factor(population.points, weights)
        start = population.taken(systematic_choice(weights, len(weights), generator))
        population = start
        for _ in range(settings.most_steps):
            population, accepted = _metropolis(population, density, scale * factor, generator)
            scale *= np.exp(accepted - GOOD_ACCEPTANCE)
            if _correlation(start.points, population.points) < settings.remembered:
                break
    return population


def _correlation(before: FloatArray, after: FloatArray) -> float:
    """Largest over dimensions of the correlation between two sets of points, row by row."""
    before, after = before - before.mean(axis=0), after - after.mean(axis=0)
    norms = np.sqrt((before**2).sum(axis=0) * (after**2).sum(axis=0))
    products = (before * after).sum(axis=0)
    return float(np.divide(products, norms, out=np.ones_like(norms), where=norms > 0).max())


@dataclass(frozen=True, slots=True)
class CorrectedTmcmc:
    """TMCMC that ends in importance sampling, whose weights take out what bias is left.

    The population of the last stage is fitted by a Student-t mixture; pilot rounds refine it; the
    final draws from it are independent and exactly weighted. The evidence is their mean weight, in
    place of the product over stages, and it comes with a standard deviation.
    """

    settings: TemperingSettings

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Draws of equal weight. Raises UpdatingError where no draw of the prior counts."""
        settings = self.settings
        density = CountedDensity(target.log_density)
        population = tempered_population(target, density, settings, generator)
        equal = np.full(len(population.points), 1.0)
        fit = fitted_mixture(
            population.points, equal, generator, most_components=settings.components
        )
        start = with_wide_part(fit, population.points, equal)
        adaptation = Adaptation(density, start, generator, components=settings.components)
        adaptation.pilots(settings.pilot, settings.most_pilots)
        drawn = weighted_draws(density, adaptation.proposal, settings.samples, generator)
        draws = posterior_draws(drawn, target, density, settings.samples, "tmcmc", generator)
        return replace(draws, warnings=(*self._warnings(draws), *_unfinished(population)))

    def _warnings(self, draws: PosteriorDraws) -> tuple[QualityWarning, ...]:
        if draws.efficiency >= self.settings.least_efficiency:
            return ()
        return (
            QualityWarning(
                "importance-efficiency",
                f"the final importance sampling kept {draws.efficiency:.1%} of its draws (at least "
                f"{self.settings.least_efficiency:.0%} wanted); its quantiles are rough",
            ),
        )
