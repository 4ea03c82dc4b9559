"""The samplers by name: `--sampler importance|emcee|tmcmc|tmcmc-published`."""

from dataclasses import dataclass, field
from typing import Literal, get_args

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.updating.prior import UpdatingError
from pipeline.updating.samplers.emcee_sampler import Chains, SamplerSettings, ensemble_chains
from pipeline.updating.samplers.importance import ImportanceSampler, ImportanceSettings
from pipeline.updating.samplers.interface import (
    CountedDensity,
    Peak,
    PosteriorDraws,
    PosteriorSampler,
    Target,
)
from pipeline.updating.samplers.student_t import StudentMixture
from pipeline.updating.samplers.tmcmc import (
    CorrectedTmcmc,
    PublishedSettings,
    PublishedTmcmc,
    TemperingSettings,
)
from sensors.arrays import FloatArray

SamplerName = Literal["importance", "emcee", "tmcmc", "tmcmc-published"]

WARM_DISTANCE = 5.0  # of the peak from an earlier ensemble, in its standard deviations
START_SPREAD = 1.5  # of cold starting points, in the peak's standard deviations


@dataclass(frozen=True, slots=True)
class SamplingSettings:
    """Section [updating.sampling] of a scenario: which sampler, and each one's own settings."""

    method: SamplerName = "importance"
    """Sampler of an exact structure; an uncertain one takes none of them."""
    importance: ImportanceSettings = field(default_factory=ImportanceSettings)
    tempering: TemperingSettings = field(default_factory=TemperingSettings)
    published: PublishedSettings = field(default_factory=PublishedSettings)

    def __post_init__(self) -> None:
        if self.method not in get_args(SamplerName):
            words = ", ".join(get_args(SamplerName))
            raise UpdatingError(f"sampler {self.method!r} is not one of {words}")


def sampler_of(
    settings: SamplingSettings, chains: SamplerSettings, *, largest_rhat: float = 1.05
) -> PosteriorSampler:
    """The sampler that the settings name. chains: emcee's own settings."""
    ensemble = EnsembleSampler(chains, largest_rhat)
    if settings.method == "importance":
        return ImportanceSampler(settings.importance, chains=ensemble)
    if settings.method == "tmcmc":
        return CorrectedTmcmc(settings.tempering)
    if settings.method == "tmcmc-published":
        return PublishedTmcmc(settings.published)
    return ensemble


@dataclass(frozen=True, slots=True)
class EnsembleSampler:
    """Markov chains of an ensemble through emcee (`emcee_sampler.ensemble_chains`)."""

    settings: SamplerSettings
    largest_rhat: float = 1.05
    """Chains that disagree more have not converged."""

    def __call__(self, target: Target, generator: np.random.Generator) -> PosteriorDraws:
        """Draws of the chains after burn-in; `warnings` where they are short or disagree."""
        density = CountedDensity(target.log_density)
        start = ensemble_start(target, density, self.settings.walkers, generator)
        chains = ensemble_chains(density, start, self.settings, generator)
        return PosteriorDraws(
            flat=chains.flat,
            ensemble=chains.ensemble,
            sampler="emcee",
            evaluations=density.evaluations,
            ess=chains.ess,
            rhat=chains.rhat,
            autocorrelation_time=chains.autocorrelation_time,
            warnings=_warnings(chains, self.largest_rhat),
        )


def ensemble_start(
    target: Target, density: CountedDensity, n: int, generator: np.random.Generator
) -> FloatArray:
    """(n, n_dim) points of positive density where walkers may start.

    Parameters
    ----------
    target : Target
        With the posterior's peak, and the last posterior's draws where there are any.
    density : CountedDensity
        Of the posterior.
    n : int
        How many points.
    generator : numpy.random.Generator
        That they are drawn with.

    Notes
    -----
    Draws of the last posterior while the peak still lies among them; else points around the peak,
    wider than the posterior: chains that start apart and come together show that they have
    converged.
    """
    warm = target.ensemble
    if warm is not None and len(warm) >= n and _among(target.peak, warm):
        chosen = warm[:n] if len(warm) == n else generator.choice(warm, n, replace=False)
        if np.isfinite(density(chosen)[0]).all() and len(np.unique(chosen, axis=0)) == n:
            return chosen
    return _around_peak(target, density, n, generator)


def _around_peak(
    target: Target, density: CountedDensity, n: int, generator: np.random.Generator
) -> FloatArray:
    peak = StudentMixture.single(target.peak.ratios, target.peak.covariance).widened(START_SPREAD)
    found = np.empty((0, len(target.peak.ratios)))
    for attempt in range(200):
        near = attempt < 5  # where most of the peak's Gaussian lies outside, the prior fills up
        points = peak.draws(n, generator) if near else target.prior_draws(n, generator)
        found = np.vstack([found, points[np.isfinite(density(points)[0])]])
        if len(found) >= n:
            return found[:n]
    raise UpdatingError(f"fewer than {n} of {200 * n} points have a likelihood above zero")


def _among(peak: Peak, ensemble: FloatArray) -> bool:
    """Whether the peak lies within a few standard deviations of the ensemble."""
    offset = peak.ratios - ensemble.mean(axis=0)
    return bool(offset @ np.linalg.pinv(np.cov(ensemble.T)) @ offset < WARM_DISTANCE**2)


def _warnings(chains: Chains, largest_rhat: float) -> tuple[QualityWarning, ...]:
    warnings = []
    if not chains.long_enough:
        warnings.append(
            QualityWarning(
                "chain-short",
                f"the chain of {len(chains.points)} steps is "
                f"{len(chains.points) / chains.autocorrelation_time:.0f} autocorrelation times "
                f"long with {chains.ess:.0f} effective draws; its quantiles are rough",
            )
        )
    if not chains.rhat <= largest_rhat:
        warnings.append(
            QualityWarning(
                "not-converged",
                f"the chains disagree (split R-hat {chains.rhat:.3f}, at most {largest_rhat:g} "
                "expected)",
            )
        )
    return tuple(warnings)
