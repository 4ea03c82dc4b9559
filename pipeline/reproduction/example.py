"""Run one seed of the publication's example: simulate ten minutes, identify, update in three ways.

paper's sea, wind and 3 % noise ─► SSI-cov ─► the eleven modes by label
    ├─► Eq. 6, Nelder and Mead from γ = 0.25, 1 and 4
    ├─► Eqs. 8 to 10, TMCMC as published, 100 000 samples, Gaussian errors
    └─► the same posterior by the corrected sampler, the reference for TMCMC's bias
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from pipeline.messages import ModalEstimate, Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from pipeline.reproduction.density import PublishedDensity
from pipeline.reproduction.paper import LABELS, SAMPLES
from pipeline.scenario import Scenario, load_scenario, with_overrides
from pipeline.sources.sources import simulated_tower
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import sightings
from pipeline.updating.likelihood.deterministic import (
    Descent,
    ModalObjective,
    deterministic_update,
    identified_by_label,
)
from pipeline.updating.likelihood.laplace import laplace_peak
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    observations,
)
from pipeline.updating.likelihood.pairing import Pairing
from pipeline.updating.prior import Prior, UpdatingError
from pipeline.updating.samplers.interface import PosteriorDraws
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


def run_example(seed: int, sign: SpringSign, *, samples: int = SAMPLES) -> Example:
    """Run the example for one seed.

    Parameters
    ----------
    samples : int, optional
        Samples of TMCMC as published; the corrected one needs fewer.

    Raises
    ------
    UpdatingError
        If none of the eleven modes was found.
    """
    scenario = with_overrides(load_scenario(SCENARIO), seed=seed)
    scenario = replace(scenario, turbine=replace(scenario.turbine, springs_sign=sign))
    model = ModalModel(scenario.structure, scenario.layout)
    estimate = identified_window(scenario)
    identified = identified_by_label(
        estimate, model, scenario.layout.channel_names, model.nominal, wanted=LABELS
    )
    if not identified.labels:
        raise UpdatingError(f"seed {seed}: none of the publication's eleven modes was found")
    prior = Prior(model.nominal)
    objective = ModalObjective(identified, model)
    known = [_nearest(estimate.modes, f) for f in identified.frequencies]
    published, corrected = _posteriors(
        replace(estimate, modes=tuple(known)), identified.labels, model, prior, seed, samples
    )
    return Example(
        seed=seed,
        sign=sign,
        modes=_modes(model, identified.labels, known),
        others=len(estimate.modes) - len(known),
        objective_at_truth=objective(np.ones(3)),
        descents=deterministic_update(objective, prior),
        published=published,
        corrected=corrected,
    )


def identified_window(scenario: Scenario) -> ModalEstimate:
    """Rdentify the scenario's ten minutes without the model."""
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


def _nearest(modes: Sequence[Mode], frequency: float) -> Mode:
    return min(modes, key=lambda mode: abs(mode.frequency - frequency))


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
    seed: int,
    samples: int,
) -> tuple[ExamplePosterior, ExamplePosterior]:
    """Draw by TMCMC as published and corrected; modes are compared by label."""
    evidence = ModalEvidence(channels=estimate.channels, joint_covariance=False).with_sightings(
        sightings(estimate, estimate.channels), 1.0, estimate.duration
    )
    forward = model.subset(labels)
    order = {f"m{mode.name[1:]}": place for place, mode in enumerate(estimate.modes)}
    columns = tuple(order[mode.name] for mode in evidence.modes)
    pairing = Pairing(np.ones(3), columns, total_cost=0.0, cost=0.0, paired_share=1.0)
    frequencies = forward.modal(prior.nominal[None]).frequencies[0]
    used = observations(evidence, pairing, frequencies, AS_PUBLISHED)
    likelihood = ModalLikelihood(
        evidence,
        used,
        model_columns=list(range(len(labels))),
        settings=AS_PUBLISHED,
        highest_sigma=prior.settings.highest_sigma,
    )
    density = PublishedDensity(likelihood, forward, prior)
    target = density.target(laplace_peak(likelihood, forward, prior, np.ones(3)))
    published = PublishedTmcmc(PublishedSettings(samples=samples))
    corrected = CorrectedTmcmc(TemperingSettings(samples=min(samples, KEPT_DRAWS)))
    return (
        _posterior(published(target, np.random.default_rng([seed, 1])), density),
        _posterior(corrected(target, np.random.default_rng([seed, 2])), density),
    )


def _posterior(drawn: PosteriorDraws, density: PublishedDensity) -> ExamplePosterior:
    points = drawn.flat[:, :4]
    some = points[np.linspace(0, len(points) - 1, min(KEPT_DRAWS, len(points))).astype(int)]
    values = np.concatenate([density(part)[0] for part in np.array_split(some, 20)])
    return ExamplePosterior(drawn.sampler, some[int(np.argmax(values))], some, drawn.evaluations)
