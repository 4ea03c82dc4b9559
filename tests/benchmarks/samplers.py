"""Samplers against brute force, and what a streaming refresh costs beside a warm ensemble.

    python -m tests.benchmarks samplers [--samples 100000] [--seeds 3]
        [--modes eleven|visible] [--part reference|refresh|both]
        [--sampler tmcmc --sampler importance …]

The data are the windows of recordings/parked.mcap. The reference of the first part is a product
grid over the three ratios, σ integrated on its own grid: three times, with each ratio as the
leading axis, so that every marginal is a smooth function on a line.

What it gave, eleven modes, seeds 1 to 3: `tmcmc` with 100 000 draws from 200 000 likelihoods, KS
.004 to .006, evidence within .0015 ± .0012 nats of the grid's; `importance` with 1600 likelihoods,
evidence within .012 ± .012. A warm refresh costs 1.4 likelihoods an effective draw, emcee's stretch
move 50 to 77: 34 to 57 times as many.
"""

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import emcee
import numpy as np
from scipy.interpolate import CubicSpline

from pipeline.messages import ModalEstimate
from pipeline.offline.identify_file import identify_file
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.exact_inference import StiffnessDensity
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    observations,
)
from pipeline.updating.likelihood.pairing import PairingSearch, PairingSettings, PairingTargets
from pipeline.updating.model_matching import laplace_peak
from pipeline.updating.prior import Prior
from pipeline.updating.samplers.convergence import autocorrelation_time
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.interface import CountedDensity, Peak, PosteriorDraws, Target
from pipeline.updating.samplers.registry import SamplingSettings, sampler_of
from pipeline.updating.samplers.tmcmc import PublishedSettings, TemperingSettings
from sensors.acquisition.layout import biaxial_layout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.pipeline.updating.likelihood.joint_density import JointDensity

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"
ELEVATIONS = (41.0, 80.0, 106.0, 145.0)  # [m], of the recording's layout
GRID_REACH = 7.0  # of the reference, in standard deviations
GRID_SIDES = (33, 43)  # points a side: the coarser only shows how exact the finer is
STRETCH_STEPS = 1500  # of 40 walkers: some thirty autocorrelation times
SAMPLERS = ("tmcmc", "tmcmc-published", "tmcmc-published, joint", "importance", "emcee")


@dataclass(frozen=True, slots=True, eq=False)
class Problem:
    """The posterior after some windows."""

    likelihood: ModalLikelihood
    forward: ModalModel
    prior: Prior
    peak: Peak

    def target(self, seed: int, ensemble: FloatArray | None = None) -> Target:
        """Three ratios, σ integrated out."""
        generator = np.random.default_rng([seed, 1])
        density = StiffnessDensity(self.likelihood, self.forward, self.prior, generator)
        return density.target(self.peak, ensemble)

    def joint_target(self) -> Target:
        """Three ratios and σ, as the paper samples them."""
        return JointDensity(self.likelihood, self.forward, self.prior).target(self.peak)


def problems(modes: str) -> list[Problem]:
    """The posteriors after one window of the recording, after two, …"""
    description = load_turbine("iea15mw_monopile")
    layout = biaxial_layout("tower-1", turbine="iea15mw", unit="tower", elevations=ELEVATIONS)
    forward = ModalModel(description, layout)
    prior = Prior(forward.nominal)
    search = PairingSearch(forward, prior, PairingSettings(), np.random.default_rng(0))
    evidence = ModalEvidence(channels=layout.channel_names)
    found = []
    for estimate in identify_file(RECORDING, window=600.0).estimates:
        evidence = evidence.with_estimate(_on_layout(estimate, layout.channel_names))
        found.append(_problem(evidence, forward, prior, search, eleven=modes == "eleven"))
    return found


def _on_layout(estimate: ModalEstimate, channels: tuple[str, ...]) -> ModalEstimate:
    return replace(estimate, channels=channels)


def _problem(
    evidence: ModalEvidence,
    forward: ModalModel,
    prior: Prior,
    search: PairingSearch,
    *,
    eleven: bool,
) -> Problem:
    """Pairing and likelihood as in the updater. eleven: only modes that Table 1 lists."""
    settings = LikelihoodSettings()
    pairing = search.best(PairingTargets.of(evidence.modes, evidence.n_windows))
    local = forward.following(prior.stiffness(pairing.ratios))
    frequencies = local.modal(prior.stiffness(pairing.ratios)).frequencies[0]
    used = observations(evidence, pairing, frequencies, settings)
    if eleven:
        listed = {mode.name for mode in forward.description.reference_modes}
        used = tuple(each for each in used if local.labels[each.model_modes[0]] in listed)
    columns = sorted({mode for each in used for mode in each.model_modes})
    subset = local.subset([local.labels[mode] for mode in columns])
    likelihood = ModalLikelihood(
        evidence,
        used,
        model_columns=columns,
        settings=settings,
        highest_sigma=prior.settings.highest_sigma,
    )
    return Problem(
        likelihood, subset, prior, laplace_peak(likelihood, subset, prior, pairing.ratios)
    )


@dataclass(frozen=True, slots=True, eq=False)
class Reference:
    """Evidence and marginal distributions by brute force."""

    log_evidence: float
    distributions: tuple[Callable[[FloatArray], FloatArray], ...]  # of k11, k22, k12, sigma
    deviations: FloatArray  # (3,) standard deviations of the ratios
    edge: float  # largest share of a marginal in the grid's outermost points


def reference(problem: Problem, centre: FloatArray, covariance: FloatArray, side: int) -> Reference:
    """Product grids r = centre + L z, L lower triangular with each ratio leading in turn.

    centre, covariance   (3,), (3, 3): where to put the grid, from any sampler
    """
    z = np.linspace(-GRID_REACH, GRID_REACH, side)
    distributions, deviations, edges, integrals = [], [], [], []
    sigma_density = np.zeros(len(problem.likelihood.sigma))
    for leading in range(3):
        order = [leading, *(other for other in range(3) if other != leading)]
        factor = np.linalg.cholesky(covariance[np.ix_(order, order)])
        values, by_sigma = _on_grid(problem, centre, factor, order, z)
        step = (z[1] - z[0]) ** 3 * np.prod(np.diag(factor))
        integrals.append(values.sum() * step)
        marginal = values.sum(axis=(1, 2)) / values.sum()
        ratios = centre[leading] + factor[0, 0] * z
        distributions.append(_distribution(ratios, marginal))
        mean = marginal @ ratios
        deviations.append(np.sqrt(marginal @ (ratios - mean) ** 2))
        edges.append(marginal[[0, -1]].max())
        sigma_density += by_sigma
    distributions.append(_distribution(problem.likelihood.sigma, sigma_density))
    scale = _scale(problem, centre)
    volume = problem.target(0).log_prior_volume
    return Reference(
        float(np.log(np.mean(integrals)) + scale - volume),
        tuple(distributions),
        np.array(deviations),
        float(max(edges)),
    )


def _scale(problem: Problem, centre: FloatArray) -> float:
    """Log density at the centre, taken out of all values so that they can be exponentiated."""
    return float(problem.target(0).log_density(centre[None])[0][0])


def _on_grid(
    problem: Problem, centre: FloatArray, factor: FloatArray, order: list[int], z: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """exp(log density − scale) on the grid, (side, side, side), and summed over it for each σ."""
    values = np.zeros((len(z),) * 3)
    by_sigma = np.zeros(len(problem.likelihood.sigma))
    scale = _scale(problem, centre)
    second, third = np.meshgrid(z, z, indexing="ij")
    widths = np.gradient(problem.likelihood.sigma)
    widths[[0, -1]] /= 2
    for number, first in enumerate(z):
        points = np.column_stack([np.full(second.size, first), second.ravel(), third.ravel()])
        ratios = np.empty_like(points)
        ratios[:, order] = centre[order] + points @ factor.T
        supported = problem.prior.supports(ratios)
        if not supported.any():
            continue
        modes = problem.forward.modal(problem.prior.stiffness(ratios[supported]))
        densities = np.exp(problem.likelihood.log_likelihood(modes) - scale)
        plane = np.zeros(len(points))
        plane[supported] = densities @ widths / problem.prior.settings.highest_sigma
        values[number] = plane.reshape(second.shape)
        by_sigma += densities.sum(axis=0)
    return values, by_sigma


def _distribution(nodes: FloatArray, density: FloatArray) -> Callable[[FloatArray], FloatArray]:
    """Distribution function of a density known at nodes, by a cubic spline."""
    cumulated = CubicSpline(nodes, density).antiderivative()
    low, total = cumulated(nodes[0]), cumulated(nodes[-1]) - cumulated(nodes[0])
    return lambda x: np.clip((cumulated(np.clip(x, nodes[0], nodes[-1])) - low) / total, 0, 1)


def kolmogorov_distance(draws: FloatArray, distribution: Callable[..., FloatArray]) -> float:
    """Largest distance between the draws' empirical distribution function and the reference."""
    draws = np.sort(draws)
    values, steps = distribution(draws), np.arange(len(draws) + 1) / len(draws)
    return float(max(np.abs(values - steps[1:]).max(), np.abs(values - steps[:-1]).max()))


def reference_part(
    problem: Problem, samplers: Sequence[str], samples: int, seeds: Sequence[int]
) -> None:
    """Samplers against the grid on one posterior."""
    found = sampler_of(SamplingSettings(), SamplerSettings())(
        problem.target(99), np.random.default_rng(99)
    )
    placed = found.flat[:, :3].mean(axis=0), np.cov(found.flat[:, :3].T)
    coarse, fine = (reference(problem, *placed, side) for side in GRID_SIDES)
    print(
        f"posterior of {len(problem.forward.labels)} modes, sd of k11, k22, k12 "
        + ", ".join(f"{100 * each:.2f} %" for each in fine.deviations)
        + f"; log evidence by grid {fine.log_evidence:.4f} ({GRID_SIDES[0]} points a side: "
        f"{coarse.log_evidence - fine.log_evidence:+.1e}), share at its edge {fine.edge:.0e}"
    )
    print(
        f"{'sampler':24s}{'seed':>5s}{'draws':>8s}{'likelihoods':>12s}{'CPU s':>7s}{'ESS':>8s}"
        f"{'KS':>8s}{'sd/ref k11 k22 k12':>20s}{'evidence off by':>19s}"
    )
    sampling = SamplingSettings(
        tempering=TemperingSettings(samples=samples),
        published=PublishedSettings(samples=samples),
    )
    chains = SamplerSettings(effective_draws=5000, most_steps=3000)
    for method in samplers:
        name = method.split(",")[0]
        sampler = sampler_of(replace(sampling, method=name), chains)  # type: ignore[arg-type]
        for seed in seeds:
            target = problem.joint_target() if "joint" in method else problem.target(seed)
            begun = time.process_time()
            drawn = sampler(target, np.random.default_rng(seed))
            _line(method, seed, drawn, fine, time.process_time() - begun)


def _line(method: str, seed: int, drawn: PosteriorDraws, fine: Reference, seconds: float) -> None:
    columns = np.delete(drawn.flat, 3, axis=1) if drawn.flat.shape[1] == 5 else drawn.flat
    distances = [
        kolmogorov_distance(column, distribution)
        for column, distribution in zip(columns.T, fine.distributions, strict=True)
    ]
    ratios = columns[:, :3].std(axis=0) / fine.deviations
    widths = " ".join(f"{each:5.2f}" for each in ratios)
    print(
        f"{method:24s}{seed:5d}{len(columns):8d}{drawn.evaluations:12d}{seconds:7.1f}"
        f"{drawn.ess:8.0f}{max(distances):8.4f}{widths:>20s}"
        f"{drawn.log_evidence - fine.log_evidence:+11.4f} ± {drawn.log_evidence_std:.4f}",
        flush=True,
    )


def refresh_part(found: Sequence[Problem], seed: int) -> None:
    """Likelihoods per effective draw, window by window, all warm from the window before."""
    print(
        f"\n{'window':>6s}{'modes':>6s}{'importance':>12s}{'ESS':>7s}{'Kish/N':>8s}{'CPU s':>7s}"
        f"{'per draw':>10s}{'emcee fitted':>14s}{'emcee stretch':>15s}{'times':>7s}"
    )
    importance = sampler_of(SamplingSettings(), SamplerSettings())
    fitted = sampler_of(SamplingSettings(method="emcee"), SamplerSettings())
    warm = None
    for number, problem in enumerate(found):
        begun = time.process_time()
        drawn = importance(problem.target(seed, warm), np.random.default_rng([seed, number]))
        seconds = time.process_time() - begun
        walked = fitted(problem.target(seed, warm), np.random.default_rng([seed, number]))
        start = warm if warm is not None else drawn.ensemble
        stretch = _stretch_cost(problem, start, np.random.default_rng([seed, number]))
        cost = drawn.evaluations / drawn.ess
        print(
            f"{number:6d}{len(problem.forward.labels):6d}{drawn.evaluations:12d}{drawn.ess:7.0f}"
            f"{drawn.efficiency:8.2f}{seconds:7.2f}{cost:10.2f}"
            f"{walked.evaluations / walked.ess:14.2f}{stretch:15.1f}{stretch / cost:7.1f}",
            flush=True,
        )
        warm = drawn.ensemble


def _stretch_cost(problem: Problem, start: FloatArray, generator: np.random.Generator) -> float:
    """Likelihoods per effective draw of emcee's stretch move with 40 warm walkers.

    The first tenth is burn-in. The walkers start on independent draws of the posterior before: the
    kindest start there is.
    """
    density = CountedDensity(problem.target(0).log_density)
    inside = start[np.isfinite(density(start)[0])]
    walkers = generator.choice(np.unique(inside, axis=0), 40, replace=False)
    density.evaluations = 0
    sampler = emcee.EnsembleSampler(40, 3, lambda points: density(points)[0], vectorize=True)
    random_state = np.random.RandomState(generator.integers(2**32, size=4, dtype=np.uint32))
    state = emcee.State(walkers, random_state=random_state.get_state())
    sampler.run_mcmc(state, STRETCH_STEPS)
    chains = sampler.get_chain(discard=STRETCH_STEPS // 10)
    tau = max(autocorrelation_time(chains[:, :, axis]) for axis in range(3))
    return density.evaluations / (chains[:, :, 0].size / tau)


def main(arguments: list[str]) -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks samplers")
    parser.add_argument("--samples", type=int, default=100_000)
    parser.add_argument("--modes", choices=("eleven", "visible"), default="eleven")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--part", choices=("reference", "refresh", "both"), default="both")
    parser.add_argument("--sampler", action="append", choices=SAMPLERS)
    options = parser.parse_args(arguments)
    found = problems(options.modes)
    if options.part != "refresh":
        seeds = range(1, options.seeds + 1)
        reference_part(found[0], options.sampler or SAMPLERS, options.samples, seeds)
    if options.part != "reference":
        refresh_part(found, seed=1)
