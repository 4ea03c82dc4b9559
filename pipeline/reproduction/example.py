"""Run one seed of the publication's example: simulate ten minutes, identify, update in three ways.

paper's sea, wind and 3 % noise ─► SSI-cov ─► paired blind, as the product does ─► its eleven modes
    ├─► Eq. 6, Nelder and Mead from γ = 0.25, 1 and 4
    ├─► Eqs. 8 to 10, TMCMC as published, 100 000 samples, Gaussian errors
    └─► the same posterior by the corrected sampler, the reference for TMCMC's bias
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.reproduction.deterministic import Descent, ModalObjective, deterministic_update
from pipeline.reproduction.paper import LABELS, SAMPLES
from pipeline.scenario import Scenario, load_scenario, with_overrides
from pipeline.sources.sources import simulated_tower
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import SeenWindow, mode_observations
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    observations,
)
from pipeline.updating.likelihood.pairing import Pairing, PairingSettings
from pipeline.updating.model_matching import Matcher, laplace_peak
from pipeline.updating.prior import Prior, UpdatingError, log_prior_volume, modal_where_supported
from pipeline.updating.samplers.interface import LogDensity, Peak, PosteriorDraws, Target
from pipeline.updating.samplers.tmcmc import (
    CorrectedTmcmc,
    PublishedSettings,
    PublishedTmcmc,
    TemperingSettings,
)
from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.foundation import SpringSign

SCENARIO = "paper"
# As the publication has it: no systematic floors, Gaussian errors.
AS_PUBLISHED = LikelihoodSettings(frequency_floor=0.0, shape_floor=0.0, tails="gaussian")
KEPT_DRAWS = 20_000  # of each posterior, for figures
# Density evaluations of a run, from runs of seeds 101 to 104: what its progress is counted against
PUBLISHED_STAGES, CORRECTED_EVALUATIONS = 13, 28
PREPARED = 0.06  # share of a run's time until the posteriors begin
ShareReport = Callable[[float], None]  # called with the share of a run that is done [-]


class PublishedDensity:
    """log p(d | r, σ) under a uniform prior, for any sampler."""

    def __init__(self, likelihood: ModalLikelihood, forward: ForwardModel, prior: Prior) -> None:
        """Keep the likelihood, the model and the prior.

        Parameters
        ----------
        likelihood : ModalLikelihood
            Errors η, their variances and the reference of σ.
        forward : ForwardModel
            Model of the compared modes, in the order of the likelihood.
        """
        self._likelihood = likelihood
        self._forward = forward
        self._prior = prior
        self._variances = np.diag(likelihood.measurement_covariance)
        self._log_volume = log_prior_volume(prior) + float(np.log(prior.settings.highest_sigma))

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return log densities, −inf outside the prior, and σ at points of shape (n, 4)."""
        sigma = points[:, 3]
        inside = np.flatnonzero((sigma >= 0) & (sigma <= self._prior.settings.highest_sigma))
        supported, modes = modal_where_supported(self._forward, self._prior, points[inside, :3])
        density = np.full(len(points), -np.inf)
        if modes is not None:
            rows = inside[supported]
            variances = self._variances + np.outer(sigma[rows] ** 2, self._likelihood.reference)
            errors = self._likelihood.errors(modes)
            values = -0.5 * (errors**2 / variances + np.log(variances)).sum(axis=1)
            density[rows] = np.where(np.isfinite(values), values, -np.inf)
        return density, sigma

    def prior_draws(self, n: int, generator: np.random.Generator) -> FloatArray:
        """Draw from the prior, shape (n, 4)."""
        sigma = generator.uniform(0.0, self._prior.settings.highest_sigma, size=n)
        return np.column_stack([self._prior.draws(n, generator), sigma])

    def target(self, peak: Peak) -> Target:
        """Return the target of a sampler.

        Parameters
        ----------
        peak : Peak
            Peak of the density in the three ratios.
        """
        start = self._prior.settings.highest_sigma / 4
        covariance = np.zeros((4, 4))
        covariance[:3, :3], covariance[3, 3] = peak.covariance, start**2
        joint = Peak(np.append(peak.ratios, start), covariance)
        return Target(self, self.prior_draws, self._log_volume, joint)


@dataclass(frozen=True, slots=True)
class ExampleMode:
    """One of the publication's modes in our run."""

    label: str
    model_frequency: float
    """Frequency of the model at K0 [Hz]."""
    frequency: float
    """Identified frequency [Hz]; NaN where not found."""
    frequency_std: float
    """Standard deviation of the identified frequency [Hz]."""
    mac: float
    """MAC with the model's shape at K0 [-]."""


@dataclass(frozen=True, slots=True, eq=False)
class ExamplePosterior:
    """The posterior of the stiffness, as ratios k / nominal, and of σ by one sampler."""

    sampler: str
    highest: FloatArray
    """Draw of highest density, the MAP estimate, shape (4,) [-]."""
    draws: FloatArray
    """Draws of equal weight, shape (n, 4) [-]."""
    evaluations: int
    """Number of evaluations of the likelihood."""

    @property
    def correlations(self) -> FloatArray:
        """Correlations of k11-k22, k11-k12, k22-k12, shape (3,) [-]."""
        matrix = np.asarray(np.corrcoef(self.draws[:, :3].T))
        return matrix[[0, 0, 1], [1, 2, 2]]

    @property
    def stds(self) -> FloatArray:
        """Standard deviations of the ratios, shape (3,) [-]."""
        return self.draws[:, :3].std(axis=0)

    @property
    def covers(self) -> NDArray[np.bool_]:
        """Whether each 90 % interval contains the truth, 1; shape (3,)."""
        low, high = np.quantile(self.draws[:, :3], [0.05, 0.95], axis=0)
        return (low <= 1) & (high >= 1)


@dataclass(frozen=True, slots=True, eq=False)
class Example:
    """Results of one seed."""

    seed: int
    sign: SpringSign
    modes: tuple[ExampleMode, ...]
    others: int
    """Number of identified modes beside the eleven."""
    objective_at_truth: float
    """Objective J at the truth K0 [-]."""
    descents: tuple[Descent, ...]
    published: ExamplePosterior
    corrected: ExamplePosterior


def run_example(
    seed: int, sign: SpringSign, *, samples: int = SAMPLES, report: ShareReport | None = None
) -> Example:
    """Run the example for one seed.

    Parameters
    ----------
    seed : int
        Of the simulation and of the samplers.
    sign : SpringSign
        Of k12.
    samples : int
        Of TMCMC as published; the corrected one needs fewer.
    report : callable, optional
        Called with the share that is done [-].

    Raises
    ------
    UpdatingError
        If none of the eleven modes was found.
    """
    report = report or _no_report
    scenario = with_overrides(load_scenario(SCENARIO), seed=seed)
    scenario = replace(scenario, turbine=replace(scenario.turbine, springs_sign=sign))
    model = ModalModel(scenario.structure, scenario.layout)
    estimate = identified_window(scenario)
    prior = Prior(model.nominal)
    labelled, start = paired_blind(estimate, model, prior, np.random.default_rng([seed, 3]))
    if not labelled:
        raise UpdatingError(f"seed {seed}: none of the publication's eleven modes was found")
    labels, known = tuple(labelled), list(labelled.values())
    objective = ModalObjective(labelled, model)
    descents = deterministic_update(objective)
    report(PREPARED)
    published, corrected = _posteriors(
        replace(estimate, modes=tuple(known)),
        labels,
        model,
        prior,
        start,
        seed,
        samples,
        report,
    )
    return Example(
        seed=seed,
        sign=sign,
        modes=_modes(model, labels, known),
        others=len(estimate.modes) - len(known),
        objective_at_truth=objective(np.ones(3)),
        descents=descents,
        published=published,
        corrected=corrected,
    )


def identified_window(scenario: Scenario) -> ModalEstimate:
    """Identify the scenario's ten minutes without the model."""
    tower = simulated_tower(scenario)
    samples = np.concatenate(list(tower.samples())).astype(np.float64)
    found = identify(samples, scenario.simulation.sampling_rate, scenario.oma)
    start_ns = scenario.simulation.start_ns
    return ModalEstimate(
        turbine=scenario.turbine.id,
        window=0,
        start_ns=start_ns,
        end_ns=start_ns + round(scenario.simulation.duration * NANOSECONDS),
        layout_id=scenario.layout.layout_id,
        channels=scenario.layout.channel_names,
        modes=tuple(
            replace(mode, name=f"m{number}", pair_id="") for number, mode in enumerate(found.modes)
        ),
    )


def paired_blind(
    estimate: ModalEstimate, model: ModalModel, prior: Prior, generator: np.random.Generator
) -> tuple[dict[str, Mode], FloatArray]:
    """Find the publication's modes among the identified ones as the product does.

    Parameters
    ----------
    estimate : ModalEstimate
        Of the window.
    model : ModalModel
        Every mode of which the sensors can see is searched.
    prior : Prior
        The search goes over the whole of it.
    generator : numpy.random.Generator
        For the search.

    Returns
    -------
    dict
        Label → identified mode, of the eleven that were found, lowest frequency first.
    ndarray, shape (3,)
        Ratios k / nominal at which they were paired: where the samplers begin.

    Notes
    -----
    The truth is not known to it.
    """
    evidence = ModalEvidence(channels=estimate.channels).with_estimate(estimate)
    matcher = Matcher(
        model,
        prior,
        pairing=PairingSettings(),
        likelihood=LikelihoodSettings(),
        generator=generator,
    )
    match = matcher.matched(evidence)
    by_name = {mode.name: mode for mode in estimate.modes}
    found = {
        model.labels[partner]: by_name[mode.name]
        for mode, partner in zip(match.evidence.modes, match.pairing.model_modes, strict=True)
        if partner >= 0 and model.labels[partner] in LABELS
    }
    return found, match.pairing.ratios


def _no_report(share: float) -> None:
    """Report nothing."""


def _modes(
    model: ModalModel, labels: Sequence[str], known: Sequence[Mode]
) -> tuple[ExampleMode, ...]:
    at_truth = model.subset(LABELS).modal(model.nominal)
    rows = []
    for row, label in enumerate(LABELS):
        mode = known[labels.index(label)] if label in labels else None
        mac = float("nan")
        if mode is not None:
            mac = float(
                modal_assurance_criterion(mode.shape[None], at_truth.shapes[0, row][None])[0, 0]
            )
        rows.append(
            ExampleMode(
                label=label,
                model_frequency=float(at_truth.frequencies[0, row]),
                frequency=mode.frequency if mode else float("nan"),
                frequency_std=mode.frequency_std if mode else float("nan"),
                mac=mac,
            )
        )
    return tuple(rows)


def _posteriors(
    estimate: ModalEstimate,
    labels: Sequence[str],
    model: ModalModel,
    prior: Prior,
    start: FloatArray,
    seed: int,
    samples: int,
    report: ShareReport,
) -> tuple[ExamplePosterior, ExamplePosterior]:
    """Return the posteriors of the found pairs by TMCMC as published and by the corrected one.

    start   (3,) ratios k / nominal at which they were found
    """
    seen = SeenWindow.of(estimate, mode_observations(estimate, estimate.channels), rise=0.0)
    evidence = ModalEvidence(channels=estimate.channels, joint_covariance=False)
    evidence = evidence.with_window(replace(seen, weight=1.0, level_known=True))
    forward = model.subset(labels)
    order = {f"m{mode.name[1:]}": place for place, mode in enumerate(estimate.modes)}
    columns = tuple(order[mode.name] for mode in evidence.modes)
    pairing = Pairing(start, columns, total_cost=0.0, cost=0.0, paired_share=1.0)
    frequencies = forward.modal(prior.stiffness(start[None])).frequencies[0]
    used = observations(evidence, pairing, frequencies, AS_PUBLISHED)
    likelihood = ModalLikelihood(
        evidence,
        used,
        model_columns=list(range(len(labels))),
        settings=AS_PUBLISHED,
        highest_sigma=prior.settings.highest_sigma,
    )
    density = PublishedDensity(likelihood, forward, prior)
    target = density.target(laplace_peak(likelihood, forward, prior, start))
    n_corrected = min(samples, KEPT_DRAWS)
    expected = PUBLISHED_STAGES * samples + CORRECTED_EVALUATIONS * n_corrected
    watched = _Watched(target.log_density, expected, report)
    target = replace(target, log_density=watched)
    published = PublishedTmcmc(PublishedSettings(samples=samples))
    corrected = CorrectedTmcmc(TemperingSettings(samples=n_corrected))
    return (
        _posterior(published(target, np.random.default_rng([seed, 1])), density),
        _posterior(corrected(target, np.random.default_rng([seed, 2])), density),
    )


class _Watched:
    """A density that reports how far the samplers are, by its evaluations."""

    def __init__(self, log_density: LogDensity, expected: int, report: ShareReport) -> None:
        self._log_density, self._expected, self._report = log_density, expected, report
        self._done = 0

    def __call__(self, points: FloatArray) -> tuple[FloatArray, FloatArray]:
        self._done += len(points)
        share = min(self._done / self._expected, 0.99)
        self._report(PREPARED + (1 - PREPARED) * share)
        return self._log_density(points)


def _posterior(drawn: PosteriorDraws, density: PublishedDensity) -> ExamplePosterior:
    points = drawn.flat[:, :4]
    some = points[np.linspace(0, len(points) - 1, min(KEPT_DRAWS, len(points))).astype(int)]
    values = np.concatenate([density(part)[0] for part in np.array_split(some, 20)])
    return ExamplePosterior(drawn.sampler, some[int(np.argmax(values))], some, drawn.evaluations)
