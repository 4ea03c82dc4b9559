"""Run one seed of the publication's example: simulate ten minutes, identify, update in three ways.

paper's sea, wind and 3 % noise ─► SSI-cov ─► paired blind, as the product does ─► its eleven modes
    ├─► Eq. 6, Nelder and Mead from γ = 0.25, 1 and 4
    ├─► Eqs. 8 to 10, TMCMC as published, 100 000 samples, Gaussian errors
    └─► the same posterior by the corrected sampler, the reference for TMCMC's bias
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.reproduction.deterministic import Descent, ModalObjective, deterministic_update
from pipeline.reproduction.listed_modes import ListedModes, paired_blind
from pipeline.reproduction.paper import LABELS, SAMPLES
from pipeline.scenario import Scenario, load_scenario, with_overrides
from pipeline.sources.sources import simulated_tower
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import SeenWindow, mode_observations
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    ModeComparison,
)
from pipeline.updating.model_matching import laplace_peak
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
# As the publication has it: no systematic floors, Gaussian errors, every mode by its frequency and
# shape. Only the shape's component that Eq. 11 sets to 1 is left out.
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
    shape_deviation: float
    """Largest error of a component of the shape at K0, over its standard deviation [-]."""
    unresolved: bool
    """Whether it belongs to a pair of which the window shows the mean frequency only."""

    @property
    def frequency_deviation(self) -> float:
        """Error of the frequency at K0 over its standard deviation [-]."""
        return abs(self.frequency - self.model_frequency) / self.frequency_std


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
    """Number of identified modes that are other modes of the model."""
    unpaired: int
    """Number of identified modes that are paired with no mode of the model."""
    objective_at_truth: float
    """Objective J at the truth K0 [-]."""
    descents: tuple[Descent, ...]
    published: ExamplePosterior
    corrected: ExamplePosterior
    deviation: float
    """Root mean square of all compared errors at K0 over their standard deviations [-]."""
    left_out: str
    """Label of the mode without which the density's peak is nearest to the truth; "" for none."""
    without: Peak
    """Peak of the publication's density without that mode."""
    own_peak: Peak
    """Peak of the product's own likelihood of all paired modes."""


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
    listed = paired_blind(estimate, model, prior, np.random.default_rng([seed, 3]))
    if not listed.found:
        raise UpdatingError(f"seed {seed}: none of the publication's eleven modes was found")
    objective = ModalObjective(listed.found, model)
    descents = deterministic_update(objective)
    report(PREPARED)
    comparison = _Comparison.of(estimate, listed.found, model, prior)
    published, corrected = _posteriors(comparison, listed.start, seed, samples, report)
    left_out, without = _nearest_without_one(comparison, estimate, listed, model)
    return Example(
        seed=seed,
        sign=sign,
        modes=_modes(model, listed.found, comparison),
        others=listed.others,
        unpaired=listed.unpaired,
        objective_at_truth=objective(np.ones(3)),
        descents=descents,
        published=published,
        corrected=corrected,
        deviation=float(np.sqrt(np.mean(np.square(comparison.deviations())))),
        left_out=left_out,
        without=without,
        own_peak=listed.own_peak,
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
        modes=tuple(replace(mode, name=f"m{number}") for number, mode in enumerate(found.modes)),
    )


def _no_report(share: float) -> None:
    """Report nothing."""


@dataclass(frozen=True, slots=True, eq=False)
class _Comparison:
    """The found modes beside the model's, as Eq. 9 compares them: each by its own frequency and
    shape, those of a pair that the window does not separate too."""

    labels: tuple[str, ...]
    """Of the modes in the likelihood's order."""
    likelihood: ModalLikelihood
    forward: ForwardModel
    prior: Prior

    @classmethod
    def of(
        cls, estimate: ModalEstimate, found: Mapping[str, Mode], model: ModalModel, prior: Prior
    ) -> "_Comparison":
        apart = replace(estimate, modes=tuple(replace(mode, pair_id="") for mode in found.values()))
        seen = SeenWindow.of(apart, mode_observations(apart, apart.channels), rise=0.0)
        evidence = ModalEvidence(channels=apart.channels, joint_covariance=False)
        evidence = evidence.with_window(replace(seen, weight=1.0, level_known=True))
        label_of = {mode.name: label for label, mode in found.items()}
        labels = tuple(label_of[mode.name] for mode in evidence.modes)
        likelihood = ModalLikelihood(
            evidence,
            [ModeComparison(row, (row,), shape_used=True, gap=0.0) for row in range(len(labels))],
            model_columns=range(len(labels)),
            settings=AS_PUBLISHED,
            highest_sigma=prior.settings.highest_sigma,
        )
        return cls(labels, likelihood, model.subset(labels), prior)

    def peak(self, start: FloatArray) -> Peak:
        """Return the density's peak, sought from (3,) ratios k / nominal."""
        return laplace_peak(self.likelihood, self.forward, self.prior, start)

    def deviations(self) -> FloatArray:
        """Return the errors at nominal over their std, (p,) [-]."""
        nominal = self.forward.modal(self.prior.stiffness(np.ones((1, 3))))
        return np.abs(self.likelihood.whitened(nominal)[0])

    def shape_deviations(self) -> dict[str, float]:
        """Return the largest of each mode's shape [-]."""
        rows = self.likelihood.frequency_components
        of_modes = np.split(self.deviations(), rows[1:])
        return {
            label: float(own[1:].max(initial=0.0))
            for label, own in zip(self.labels, of_modes, strict=True)
        }


def _nearest_without_one(
    comparison: _Comparison, estimate: ModalEstimate, listed: ListedModes, model: ModalModel
) -> tuple[str, Peak]:
    """Leave each mode out in turn: return the one without which the density's peak is nearest to
    the truth, in stds of the density of all, and that peak; "" where all are better."""
    every = comparison.peak(listed.start)
    peaks = {"": every}
    for label in listed.found if len(listed.found) > 1 else ():
        others = {each: mode for each, mode in listed.found.items() if each != label}
        without = _Comparison.of(estimate, others, model, comparison.prior)
        peaks[label] = without.peak(listed.start)
    stds = np.sqrt(np.diag(every.covariance))
    return min(peaks.items(), key=lambda each: float(np.linalg.norm((each[1].ratios - 1) / stds)))


def _modes(
    model: ModalModel, found: Mapping[str, Mode], comparison: _Comparison
) -> tuple[ExampleMode, ...]:
    at_truth = model.subset(LABELS).modal(model.nominal)
    deviations = comparison.shape_deviations()
    rows = []
    for row, label in enumerate(LABELS):
        mode = found.get(label)
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
                shape_deviation=deviations.get(label, float("nan")),
                unresolved=mode is not None and bool(mode.pair_id),
            )
        )
    return tuple(rows)


def _posteriors(
    comparison: _Comparison, start: FloatArray, seed: int, samples: int, report: ShareReport
) -> tuple[ExamplePosterior, ExamplePosterior]:
    """Return the posteriors of the found pairs by TMCMC as published and by the corrected one.

    start   (3,) ratios k / nominal at which they were found
    """
    density = PublishedDensity(comparison.likelihood, comparison.forward, comparison.prior)
    target = density.target(comparison.peak(start))
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
