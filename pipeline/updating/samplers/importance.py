"""Importance sampling from a Student-t mixture: a posterior refreshed in some two thousand draws.

Pilot rounds fit the mixture to the posterior; what they drew is thrown away, so that the draws
that are kept are independent, from a proposal fixed before them, and their weights are exact. The
share that survives the weighting (Kish ESS / N) measures how well the mixture fits.
"""

import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray
from scipy.special import logsumexp

from pipeline.messages import QualityWarning
from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.interface import (
    CountedDensity,
    PosteriorDraws,
    PosteriorSampler,
    Target,
)
from pipeline.updating.samplers.student_t import (
    StudentMixture,
    fitted_mixture,
    kish_size,
    mixed,
    weighted_moments,
)
from sensors.arrays import FloatArray
from sensors.settings import NO_KEY

logger = logging.getLogger(__name__)

BATCHES = 4  # of independent draws, compared with each other for R̂
ENSEMBLE = 400  # draws remembered for the next posterior
WIDE, WIDE_SHARE = 3.0, 0.1  # a component for what the fit does not see: its width, its share
GOOD_EFFICIENCY = 0.6  # beyond this a further pilot round costs more than it saves
EARLY_EFFICIENCY = 0.1  # below this a pilot round is still on its way to the posterior
ATTEMPTS = 3  # at the draws that are kept
FIT_SIZE = 30.0  # effective points from which a mixture can be fitted


@dataclass(frozen=True, slots=True)
class ImportanceSettings:
    """How many draws, and when importance sampling is given up."""

    effective_draws: float = 1000.0
    """Effective number of draws (Kish) at which sampling stops."""
    least_efficiency: ClassVar[float] = 0.1
    """Kish ESS / N below which chains take over [-]."""
    pilot: int = field(default=200, metadata=NO_KEY)
    """Draws of one pilot round."""
    most_pilots: int = field(default=8, metadata=NO_KEY)
    """Rounds."""
    components: int = field(default=8, metadata=NO_KEY)
    """At most, of the mixture."""
    draws: int = 4000
    """Number of draws of equal weight at the end."""

    def __post_init__(self) -> None:
        if min(self.effective_draws, self.pilot, self.draws) < 50 or self.most_pilots < 1:
            raise UpdatingError(
                f"importance sampling needs effective_draws ({self.effective_draws:g}), pilot "
                f"({self.pilot}) and draws ({self.draws}) of at least 50 and a pilot round"
            )
        if self.components < 1:
            raise UpdatingError(f"components is {self.components}; at least 1 is needed")


@dataclass(frozen=True, slots=True, eq=False)
class WeightedDraws:
    """Independent draws of a proposal q with their log weights log p − log q."""

    points: FloatArray
    """(n, n_dim)."""
    companions: FloatArray
    """(n,)."""
    log_target: FloatArray
    """Log p, (n,)."""
    log_weights: FloatArray
    """(n,)."""

    @classmethod
    def joined(cls, parts: Sequence["WeightedDraws"]) -> "WeightedDraws":
        """All of several, in order."""
        return cls(
            points=np.concatenate([each.points for each in parts]),
            companions=np.concatenate([each.companions for each in parts]),
            log_target=np.concatenate([each.log_target for each in parts]),
            log_weights=np.concatenate([each.log_weights for each in parts]),
        )

    @property
    def weights(self) -> FloatArray:
        """(n,) of sum 1; all zero where no draw has a density."""
        return normalised(self.log_weights)

    @property
    def ess(self) -> float:
        """Kish's effective sample size."""
        return kish_size(self.weights)

    @property
    def efficiency(self) -> float:
        """Kish ESS / N."""
        return self.ess / len(self.points)

    @property
    def log_mean_weight(self) -> float:
        """log of ∫ p, estimated by the mean weight."""
        return float(logsumexp(self.log_weights) - np.log(len(self.log_weights)))

    @property
    def log_mean_weight_std(self) -> float:
        """Its standard deviation, √((N / ESS − 1) / N): the mean weight's, to first order."""
        if not self.ess > 0:
            return float("inf")
        return float(np.sqrt((1 / self.efficiency - 1) / len(self.points)))

    def resampled(self, n: int, generator: np.random.Generator) -> FloatArray:
        """(n, n_dim + 1) points with companions, of equal weight, in random order."""
        chosen = systematic_choice(self.weights, n, generator)
        return np.column_stack([self.points, self.companions])[generator.permutation(chosen)]

    def rhat(self) -> float:
        """Largest over point and companion of R̂ between independent batches of the draws.

        R̂² = 1 + (variance of the batches' weighted means) / (mean variance within)
        """
        values = np.column_stack([self.points, self.companions])
        moments = []
        for batch in range(BATCHES):
            weights = normalised(self.log_weights[batch::BATCHES])
            if not weights.any():
                return float("inf")
            mean, covariance = weighted_moments(values[batch::BATCHES], weights)
            moments.append((mean, np.diag(covariance)))
        means, variances = (np.array(each) for each in zip(*moments, strict=True))
        within, between = variances.mean(axis=0), means.var(axis=0, ddof=1)
        ratios = np.divide(between, within, out=np.zeros_like(between), where=within > 0)
        return float(np.sqrt(1 + ratios.max()))


def normalised(log_weights: FloatArray) -> FloatArray:
    """(n,) weights of sum 1; all zero where every log weight is −inf."""
    highest = log_weights.max()
    if not np.isfinite(highest):
        return np.zeros_like(log_weights)
    weights = np.exp(log_weights - highest)
    return np.asarray(weights / weights.sum())


def systematic_choice(
    weights: FloatArray, n: int, generator: np.random.Generator
) -> NDArray[np.int64]:
    """(n,) indices in rising order, each index its weight's share of n times to within one."""
    positions = (np.arange(n) + generator.random()) / n
    edges = np.cumsum(weights)
    return np.minimum(np.searchsorted(edges, positions * edges[-1], side="right"), len(weights) - 1)


def weighted_draws(
    density: CountedDensity, proposal: StudentMixture, n: int, generator: np.random.Generator
) -> WeightedDraws:
    """n independent draws of the proposal with their weights."""
    points = proposal.draws(n, generator)
    values, companions = density(points)
    return WeightedDraws(points, companions, values, values - proposal.log_density(points))


def first_proposal(target: Target, generator: np.random.Generator) -> StudentMixture:
    """Where a refresh starts: the peak's Gaussian, the last posterior's draws, and a wide part."""
    peak = StudentMixture.single(target.peak.ratios, target.peak.covariance)
    parts = [(0.6, peak.widened(1.2)), (0.1, peak.widened(WIDE))]
    if target.ensemble is not None and len(target.ensemble) > 2 * target.ensemble.shape[1]:
        weights = np.full(len(target.ensemble), 1.0)
        parts.append((0.3, fitted_mixture(target.ensemble, weights, generator, most_components=4)))
    return mixed(*parts)


class Adaptation:
    """A proposal that learns from every draw so far.

    All rounds' draws are weighted by the mixture of their proposals (the balance heuristic), and
    the next proposal is fitted to them. While few of them count, weights are flattened to w^γ
    until FIT_SIZE do, and the mixture walks towards the posterior.
    Source: Cornuet et al. (2012), Scandinavian Journal of Statistics 39 (adaptive multiple
    importance sampling); γ as in Koblents and Míguez (2015), Statistics and Computing 25.
    """

    def __init__(
        self,
        density: CountedDensity,
        proposal: StudentMixture,
        generator: np.random.Generator,
        *,
        components: int,
    ) -> None:
        """components: at most, of a fitted mixture."""
        self._density = density
        self._generator = generator
        self._components = components
        self._rounds: list[WeightedDraws] = []
        self._proposals: list[StudentMixture] = []
        self._points: FloatArray = proposal.means
        self._weights: FloatArray | None = None
        self.proposal = proposal
        self.efficiency = 0.0  # of the last round

    def pilots(self, size: int, most: int) -> None:
        """Rounds of `size` draws, twice as many once a share of them counts, until the proposal
        fits well or stops improving."""
        for number in range(most):
            last = self.efficiency
            n = size if last < EARLY_EFFICIENCY else 2 * size
            self.learn(weighted_draws(self._density, self.proposal, n, self._generator))
            settled = number > 1 and EARLY_EFFICIENCY < self.efficiency < 1.1 * last
            if self.efficiency > GOOD_EFFICIENCY or settled:
                return

    def learn(self, drawn: WeightedDraws) -> None:
        """Fit the proposal to all draws, these included. drawn: from the present proposal."""
        self._rounds.append(drawn)
        self._proposals.append(self.proposal)
        self.efficiency = drawn.efficiency
        points = np.concatenate([each.points for each in self._rounds])
        target = np.concatenate([each.log_target for each in self._rounds])
        sizes = np.log([len(each.points) for each in self._rounds])
        logs = np.column_stack([each.log_density(points) for each in self._proposals])
        weights = _flattened(target - logsumexp(logs + sizes, axis=1))
        if weights is None:
            return
        fit = fitted_mixture(points, weights, self._generator, most_components=self._components)
        self.proposal = with_wide_part(fit, points, weights)
        self._points, self._weights = points, weights

    def ensemble(self, n: int) -> FloatArray | None:
        """(n or fewer, n_dim) distinct points spread as the posterior is, as far as is known."""
        if self._weights is None:
            return None
        chosen = systematic_choice(self._weights, n, self._generator)
        return self._points[np.unique(chosen)]


def with_wide_part(
    mixture: StudentMixture, points: FloatArray, weights: FloatArray
) -> StudentMixture:
    """The mixture with a small share of a wide component about all points."""
    mean, covariance = weighted_moments(points, weights / weights.sum())
    wide = StudentMixture.single(mean, covariance).widened(WIDE)
    return mixed((1 - WIDE_SHARE, mixture), (WIDE_SHARE, wide))


def _flattened(log_weights: FloatArray) -> FloatArray | None:
    """Weights w^γ, γ ≤ 1 the largest for which FIT_SIZE of them count; None where none does."""
    reachable = np.isfinite(log_weights)
    if reachable.sum() < FIT_SIZE:
        return None
    low, high = 0.0, 1.0
    if kish_size(normalised(log_weights)) >= FIT_SIZE:
        return normalised(log_weights)
    for _ in range(30):
        middle = (low + high) / 2
        # −inf · γ stays −inf for γ > 0: what the prior excludes is never fitted
        enough = kish_size(normalised(middle * log_weights)) >= FIT_SIZE
        low, high = (middle, high) if enough else (low, middle)
    return normalised(max(low, 1e-9) * log_weights)


def drawn_until(
    density: CountedDensity,
    proposal: StudentMixture,
    settings: ImportanceSettings,
    generator: np.random.Generator,
    *,
    expected: float,
    least: float,
) -> WeightedDraws:
    """Draws of one proposal until enough of them count, or a smaller share than `least` does.

    Parameters
    ----------
    density : CountedDensity
        Of the posterior.
    proposal : StudentMixture
        That the draws come from.
    settings : ImportanceSettings
        With the effective draws that are enough.
    generator : numpy.random.Generator
        That they are drawn with.
    expected : float
        Efficiency that sizes the first batch [-].
    least : float
        Efficiency below which it ends [-].
    """
    n = int(np.ceil(settings.effective_draws / np.clip(expected, least, 1.0)))
    drawn = weighted_draws(density, proposal, n, generator)
    while drawn.ess < settings.effective_draws and drawn.efficiency >= least:
        missing = (settings.effective_draws - drawn.ess) / drawn.efficiency
        n = max(int(1.1 * missing), settings.pilot // 2)
        drawn = WeightedDraws.joined([drawn, weighted_draws(density, proposal, n, generator)])
    return drawn


@dataclass(frozen=True, slots=True)
class ImportanceSampler:
    """The streaming sampler: warm importance sampling, with chains where its efficiency is poor.

    It finds what lies around the peak and the last posterior. Whether there is another peak
    elsewhere is for a search of the prior to find, as the pairing's does before every refresh.
    """

    settings: ImportanceSettings
    chains: PosteriorSampler
    """Takes over."""

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Draws of the posterior; `warnings` reports when the chains took over and why."""
        settings = self.settings
        density = CountedDensity(target.log_density)
        start = first_proposal(target, generator)
        adaptation = Adaptation(density, start, generator, components=settings.components)
        for attempt in range(ATTEMPTS):
            # what a few draws could not fit, four times as many may
            adaptation.pilots(settings.pilot * 4**attempt, settings.most_pilots)
            expected, least = adaptation.efficiency, settings.least_efficiency
            if expected < least:
                continue
            # a disappointing attempt is worth more as a pilot round, except for the last one
            patience = least if attempt == ATTEMPTS - 1 else max(least, expected / 2)
            drawn = drawn_until(
                density,
                adaptation.proposal,
                settings,
                generator,
                expected=expected,
                least=patience,
            )
            if drawn.ess >= settings.effective_draws:
                return posterior_draws(
                    drawn, target, density, settings.draws, "importance", generator
                )
            adaptation.learn(drawn)
        ensemble = adaptation.ensemble(ENSEMBLE)
        warm = target if ensemble is None else replace(target, ensemble=ensemble)
        return self._by_chains(warm, density, adaptation.efficiency, generator)

    def _by_chains(
        self,
        target: Target,
        density: CountedDensity,
        efficiency: float,
        generator: np.random.Generator,
    ) -> PosteriorDraws:
        warning = QualityWarning(
            "importance-efficiency",
            f"importance sampling kept {efficiency:.1%} of its draws (at least "
            f"{self.settings.least_efficiency:.0%} wanted); Markov chains took over",
        )
        logger.info(warning.text)
        chains = self.chains(target, generator)
        return replace(
            chains,
            evaluations=chains.evaluations + density.evaluations,
            efficiency=efficiency,
            warnings=(warning, *chains.warnings),
        )


def posterior_draws(
    drawn: WeightedDraws,
    target: Target,
    density: CountedDensity,
    n: int,
    sampler: str,
    generator: np.random.Generator,
) -> PosteriorDraws:
    """n draws of equal weight, with the evidence ∫ p dx / V."""
    flat = drawn.resampled(n, generator)
    return PosteriorDraws(
        flat=flat,
        ensemble=flat[:ENSEMBLE, :-1],
        sampler=sampler,
        evaluations=density.evaluations,
        ess=drawn.ess,
        rhat=drawn.rhat(),
        efficiency=drawn.efficiency,
        log_evidence=drawn.log_mean_weight - target.log_prior_volume,
        log_evidence_std=drawn.log_mean_weight_std,
    )
