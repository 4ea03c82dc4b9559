"""The springs' posterior where the structure is exact; where it is not, see `structural.inference`.

evidence ─► Matcher: pairs, likelihood, peak ─► sampler: draws ─► ExactRefresh
"""

from dataclasses import dataclass

import numpy as np

from pipeline.updating.change.event_message import TrackSensitivity, stiffness_slopes
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import ModalLikelihood
from pipeline.updating.model_matching import (
    Match,
    Matcher,
    partners_in_water,
    rise_of_comparison,
)
from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.prior import Prior, log_prior_volume, modal_where_supported
from pipeline.updating.samplers.interface import Peak, PosteriorDraws, Target
from pipeline.updating.samplers.registry import sampler_of
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.state import UpdatingState
from sensors.arrays import FloatArray

LONG_RIDGE = 0.1  # std / median of a spring that the modes do not separate from the others [-]
POPULATION_ENSEMBLE = 400  # draws of a farm's prior from which the first posterior is looked for


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


@dataclass(frozen=True, slots=True, eq=False)
class ExactRefresh:
    """What one window's refresh found."""

    draws: PosteriorDraws
    representative: FloatArray
    """Ratios k / nominal, (3,), at which the model's modes are shown."""
    sensitivities: tuple[TrackSensitivity, ...]
    """Of every paired mode's track."""


class ExactInference:
    """Infers k11, k22, k12 and σ alone.

    Parameters
    ----------
    forward : ForwardModel
        The structure at the layout's sensors.
    seed : int
        The scenario's.
    population : StiffnessPopulation, optional
        What a farm's other turbines imply of this one's springs.
    """

    def __init__(
        self,
        forward: ForwardModel,
        prior: Prior,
        settings: UpdatingSettings,
        *,
        seed: int,
        population: StiffnessPopulation | None,
    ) -> None:
        self._forward, self._prior, self._settings = forward, prior, settings
        self._seed, self._population = seed, population
        self._sampler = sampler_of(
            settings.sampling, settings.sampler, largest_rhat=settings.guards.rhat
        )
        self._matchers: dict[float, Matcher] = {}  # by the water's rise [m]
        self._matcher_in_water(0.0)

    def matched(self, state: UpdatingState) -> Match:
        """The model's modes beside the evidence's, looked for at the last posterior's springs too,
        before it at the farm's. Raises EstimateRefused."""
        start = state.median
        if start is None and self._population is not None:
            start = self._population.centre
        rise = rise_of_comparison(state.evidence)
        evidence = state.evidence.with_levels_above(rise) if rise else state.evidence
        return self._matcher_in_water(rise).matched(evidence, start)

    def _matcher_in_water(self, rise: float) -> Matcher:
        """What compares in water above the model's level; kept, for the mean of windows stays."""
        if rise not in self._matchers:
            self._matchers[rise] = Matcher(
                self._forward.with_water_risen(rise) if rise else self._forward,
                self._prior,
                pairing=self._settings.pairing,
                likelihood=self._settings.likelihood,
                generator=np.random.default_rng(self._seed),
            )
        return self._matchers[rise]

    def refreshed(self, match: Match, state: UpdatingState, window: int) -> ExactRefresh:
        """Draws of the posterior after the window of that number."""
        generator = np.random.default_rng([self._seed, window])
        density = StiffnessDensity(
            match.likelihood, match.forward, self._prior, generator, self._population
        )
        draws = self._sampler(density.target(match.peak, self._ensemble(state)), generator)
        representative = self._representative(draws, match.peak.ratios)
        sensitivities = self._sensitivities(state.evidence, match, representative[:3])
        return ExactRefresh(draws, representative, sensitivities)

    def _ensemble(self, state: UpdatingState) -> FloatArray | None:
        """(n, 3) ratios about which the sampler looks first: the last posterior's, before it the
        farm's."""
        if state.ensemble is not None or self._population is None:
            return state.ensemble
        generator = np.random.default_rng([self._seed, 2])
        drawn = self._population.draws(POPULATION_ENSEMBLE, generator)
        return drawn[self._prior.supports(drawn)]

    def _sensitivities(
        self, evidence: ModalEvidence, match: Match, median: FloatArray
    ) -> tuple[TrackSensitivity, ...]:
        """How every paired mode's track depends on springs, at the median, and on the water."""
        rise = match.all_modes.water_level - self._forward.water_level
        water = np.zeros((len(match.all_modes.labels), 2))
        if evidence.level_varied:
            water[:] = [each.curve_about(-rise) for each in partners_in_water(match.all_modes)]
        slopes = stiffness_slopes(match.all_modes, self._prior, median)
        chosen = evidence.one_a_track(each.identified for each in match.used)
        found = [
            TrackSensitivity(
                track=evidence.modes[each.identified].track,
                model=match.all_modes.labels[each.model_modes[0]],
                slopes=slopes[list(each.model_modes)].mean(axis=0),
                water=water[each.model_modes[0]],
            )
            for each in match.used
            if each.identified in chosen
        ]
        return tuple(each for each in found if np.all(np.isfinite(each.slopes)))

    def _representative(self, draws: PosteriorDraws, peak: FloatArray) -> FloatArray:
        """(3,) the median of each ratio, what else is uncertain beside it; where these three cannot
        stand together, the draw nearest to them; and of a long ridge, which few modes leave, the
        peak: beside it the medians fit nothing, and draws only to within a σ nothing bounds."""
        flat = draws.flat[:, :-1]
        median = np.median(flat, axis=0)
        if (flat[:, :3].std(axis=0) > LONG_RIDGE * median[:3]).any():
            return peak
        supported, modes = modal_where_supported(self._forward, self._prior, median[None, :3])
        if supported[0] and modes is not None and modes.admissible[0]:
            return median
        distances = (((flat - median) / flat.std(axis=0)) ** 2).sum(axis=1)
        return flat[int(np.argmin(distances))]
