"""Whether 90 % intervals hold the truth in 90 of 100 streams of drawn estimates.

    python -m tests.benchmarks calibration [--part streams|single|ranks|pairing|all] [--streams 100]
        [--case 1 2 3] [--windows 72] [--runs 200] [--trials 2000] [--tails gaussian|student-t]
        [--first-seed 1]

The likelihood as it is stated: floors and guards off, every mode's partner known. `streams` draws
twelve hours of windows about the paper's eleven modes of a true stiffness in .8 to 1.25 of nominal:
with errors of known size alone; with a discrepancy of .3 % that all windows share; with windows
that overlap by nine tenths. `single` draws one window each and counts the error of the posterior's
peak, floors on as a scenario has them. `ranks` draws stiffness, σ and data from the prior and the
likelihood themselves, and asks where the truth ranks among draws of the posterior: everywhere
alike, or the posterior is not the prior's and the likelihood's (simulation-based calibration, Talts
et al. 2018, arXiv:1804.06788). `pairing` draws all modes that the sensors see of a stiffness
anywhere in the prior, and takes away, adds and spoils some.

What it gave with Student-t tails, for k11, k22, k12:

    streams (seeds 1..100): cover .91 .87 .90 without model error; .92 .93 .94 with a shared
        discrepancy of .3 %; .95 .94 .95 with hops of one minute
    single (seeds 1..100): median error of the peak .62 1.04 1.55 %, cover .95 .94 .96
    ranks (seeds 1..200): p = .92 .60 .50, σ .24; Gaussian tails .64 .53 .88, σ .70
    pairing (2000 trials: seeds 1001..1250, 2001..2250, 3001..3250, 4001..4250, each with the truth
        anywhere in the prior and in .8 to 1.25): .3 % and .05 % of the pairs wrong; invented modes
        99.5 % left alone
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chisquare

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.exact_inference import StiffnessDensity
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.likelihood.likelihood import (
    LikelihoodSettings,
    ModalLikelihood,
    ModeComparison,
)
from pipeline.updating.likelihood.pairing import PairingSearch, PairingSettings, PairingTargets
from pipeline.updating.model_matching import laplace_peak
from pipeline.updating.prior import PARAMETER_NAMES, Prior, PriorSettings
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.interface import Peak, PosteriorDraws
from pipeline.updating.samplers.registry import SamplingSettings, sampler_of
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from tests.benchmarks._drawn import DURATION, LAYOUT, TrueModes, drawn_window, turbine_model
from tests.benchmarks._pairing_trials import pairing_part

Tails = Literal["gaussian", "student-t"]

LOWEST, HIGHEST = 0.8, 1.25  # true stiffness / nominal in `streams` [-]
SHARED = 0.003  # discrepancy of the structure [-]
OVERLAPPING_HOP = 60.0  # [s]
CASES = ("no model error", "shared discrepancy of .3 %", "hops of one minute")
HIGHEST_SIGMA = 0.01  # of the prior in `ranks`: R is taken from the data, which is right as long as
# σ is small beside 1
PARTS = ("streams", "single", "ranks", "pairing", "all")
HEADER = (
    f"{'':40s}{'cover k11 k22 k12':>20s}{'rms z':>20s}{'half width %':>20s}{'peak off %':>20s}"
    f"{'ESS':>7s}"
)
RANKED = 99  # draws among which the truth is ranked
BINS = 10  # of the ranks' histogram


@dataclass(frozen=True, slots=True, eq=False)
class Posteriors:
    """Makes posteriors of drawn windows; what does not depend on them is computed once."""

    model: ForwardModel
    layout: SensorLayout
    prior: Prior
    settings: LikelihoodSettings
    search: PairingSearch

    @classmethod
    def of(
        cls,
        settings: LikelihoodSettings,
        *,
        highest_sigma: float = 0.1,
        model: ForwardModel | None = None,
        layout: SensorLayout = LAYOUT,
    ) -> "Posteriors":
        """model: the turbine with the paper's modes, if not another; at this layout."""
        model = model or turbine_model()
        prior = Prior(model.nominal, PriorSettings(highest_sigma=highest_sigma))
        search = PairingSearch(model, prior, PairingSettings(), np.random.default_rng(0))
        return cls(model, layout, prior, settings, search)

    def true_modes(self, ratios: FloatArray) -> TrueModes:
        """The structure at (3,) ratios, which the windows are drawn about."""
        return TrueModes.of(self.model, ratios, self.layout)

    def likelihood(self, evidence: ModalEvidence) -> ModalLikelihood:
        """Every mode compared with the model's of its name, in frequency and shape."""
        partners = [self.model.labels.index(mode.name) for mode in evidence.modes]
        return ModalLikelihood(
            evidence,
            [
                ModeComparison(row, (mode,), shape_used=True, gap=0.0)
                for row, mode in enumerate(partners)
            ],
            model_columns=range(len(self.model.labels)),
            settings=self.settings,
            highest_sigma=self.prior.settings.highest_sigma,
        )

    def draws(
        self, evidence: ModalEvidence, generator: np.random.Generator
    ) -> tuple[Peak, PosteriorDraws]:
        """The posterior's peak, and the posterior by the streaming sampler from there."""
        likelihood = self.likelihood(evidence)
        density = StiffnessDensity(likelihood, self.model, self.prior, generator)
        peak = self._peak(evidence, likelihood)
        sampler = sampler_of(SamplingSettings(), SamplerSettings())
        return peak, sampler(density.target(peak), generator)

    def _peak(self, evidence: ModalEvidence, likelihood: ModalLikelihood) -> Peak:
        """Uphill from where the updater would begin: a hundred standard deviations from the truth
        the likelihood alone has summits of its own."""
        start = self.search.best(PairingTargets.of(evidence.modes, evidence.n_windows)).ratios
        return laplace_peak(likelihood, self.model, self.prior, start)


def evidence_of_stream(
    true: TrueModes, case: str, n_windows: int, generator: np.random.Generator
) -> ModalEvidence:
    """Twelve hours of windows, or as many as asked for, combined."""
    size = true.values.shape
    hop, discrepancy = DURATION, np.zeros(size)
    if case == CASES[1]:
        discrepancy = SHARED * true.reference * generator.standard_normal(size)
    if case == CASES[2]:
        hop = OVERLAPPING_HOP
    errors = _errors(n_windows, round(DURATION / hop), size, generator)
    evidence = ModalEvidence(channels=true.layout.channel_names)
    for number, each in enumerate(errors):
        window = drawn_window(true, each, window=number, hop=hop, discrepancy=discrepancy)
        evidence = evidence.with_estimate(window)
    return evidence


def _errors(
    n_windows: int, hops: int, size: tuple[int, ...], generator: np.random.Generator
) -> FloatArray:
    """(n_windows, *size) of unit variance: means of what each of a window's hops adds."""
    fresh = generator.standard_normal((n_windows + hops - 1, *size))
    return np.array([fresh[n : n + hops].sum(axis=0) / np.sqrt(hops) for n in range(n_windows)])


def true_ratios(generator: np.random.Generator, prior: Prior) -> FloatArray:
    """(3,) in .8 to 1.25 where the springs are positive definite."""
    while True:
        ratios = generator.uniform(LOWEST, HIGHEST, 3)
        if prior.supports(ratios):
            return ratios


@dataclass(frozen=True, slots=True)
class Coverage:
    """Over all streams of one case; vectors in the order k11, k22, k12."""

    covered: FloatArray  # (3,) share of streams whose 90 % interval holds the truth [-]
    scaled_error: FloatArray  # (3,) rms of (median − truth) / std [-]
    half_width: FloatArray  # (3,) median, share of the truth [-]
    peak_error: FloatArray  # (3,) median, of the likeliest stiffness, share of the truth [-]
    effective_draws: float  # fewest
    by_chains: int  # streams in which importance sampling gave up


def covered_streams(
    posteriors: Posteriors, case: str, n_streams: int, n_windows: int, *, first_seed: int
) -> Coverage:
    """Coverage of one case."""
    found = []
    for seed in range(first_seed, first_seed + n_streams):
        generator = np.random.default_rng([seed, CASES.index(case)])
        ratios = true_ratios(generator, posteriors.prior)
        true = posteriors.true_modes(ratios)
        evidence = evidence_of_stream(true, case, n_windows, generator)
        peak, drawn = posteriors.draws(evidence, generator)
        low, median, high = np.quantile(drawn.flat[:, :3], [0.05, 0.5, 0.95], axis=0)
        scaled = (median - ratios) / drawn.flat[:, :3].std(axis=0)
        inside = (low <= ratios) & (ratios <= high)
        by_chains = np.full(3, drawn.sampler != "importance")
        error = np.abs(peak.ratios / ratios - 1)
        half_width = (high - low) / 2 / ratios
        found.append([inside, scaled**2, half_width, by_chains, [drawn.ess] * 3, error])
    columns = np.array(found, dtype=float)
    return Coverage(
        covered=columns[:, 0].mean(axis=0),
        scaled_error=np.sqrt(columns[:, 1].mean(axis=0)),
        half_width=np.median(columns[:, 2], axis=0),
        peak_error=np.median(columns[:, 5], axis=0),
        effective_draws=float(columns[:, 4].min()),
        by_chains=int(columns[:, 3, 0].sum()),
    )


@dataclass(frozen=True, slots=True, eq=False)
class Ranks:
    """Where the truth ranks among draws of its posterior, run by run."""

    ranks: NDArray[np.int64]  # (n_runs, 4) from 0 to RANKED: k11, k22, k12, σ
    by_chains: int  # runs in which importance sampling gave up

    @property
    def uniformity(self) -> FloatArray:
        """(4,) p of the chi-square test of a flat histogram."""
        edges = np.linspace(0, RANKED + 1, BINS + 1)
        counts = [np.histogram(column, edges)[0] for column in self.ranks.T]
        return np.array([chisquare(each).pvalue for each in counts])


def truth_ranks(posteriors: Posteriors, n_runs: int, *, first_seed: int) -> Ranks:
    """One window a run, drawn from prior and likelihood."""
    ranks, by_chains = [], 0
    for seed in range(first_seed, first_seed + n_runs):
        generator = np.random.default_rng([seed, 77])
        truth = _drawn_from_prior(posteriors, generator)
        evidence = _drawn_from_likelihood(posteriors, truth, generator)
        _, drawn = posteriors.draws(evidence, generator)
        chosen = generator.choice(drawn.flat, RANKED, replace=False)
        ranks.append((chosen < truth).sum(axis=0))
        by_chains += drawn.sampler != "importance"
    return Ranks(np.array(ranks), by_chains)


def _drawn_from_prior(posteriors: Posteriors, generator: np.random.Generator) -> FloatArray:
    """(4,) ratios of a structure that stands, and σ."""
    while True:
        ratios = posteriors.prior.draws(1, generator)[0]
        if posteriors.model.modal(posteriors.prior.stiffness(ratios[None])).admissible[0]:
            highest = posteriors.prior.settings.highest_sigma
            return np.append(ratios, generator.uniform(0.0, highest))


def _drawn_from_likelihood(
    posteriors: Posteriors, truth: FloatArray, generator: np.random.Generator
) -> ModalEvidence:
    """One window with a discrepancy of σ, where tails are heavy times a mode's own √λ for its
    frequency and another for its shape."""
    true = posteriors.true_modes(truth[:3])
    scales = np.ones((len(true.values), 2))
    if posteriors.settings.tails == "student-t":
        degrees = posteriors.settings.degrees_of_freedom
        scales = degrees / generator.chisquare(degrees, scales.shape)  # inverse gamma (ν/2, ν/2)
    rows = np.repeat(scales, (1, true.values.shape[1] - 1), axis=1)
    errors = generator.standard_normal((2, *true.values.shape))
    discrepancy = truth[3] * np.sqrt(rows) * true.reference * errors[0]
    window = drawn_window(true, errors[1], window=0, discrepancy=discrepancy)
    return ModalEvidence(channels=true.layout.channel_names).with_estimate(window)


def as_stated(tails: Tails) -> LikelihoodSettings:
    """No floors: what the errors are is known."""
    return LikelihoodSettings(frequency_floor=0.0, shape_floor=0.0, tails=tails)


def streams_part(
    cases: Sequence[str],
    n_streams: int,
    n_windows: int,
    tails: Sequence[Tails],
    *,
    first_seed: int,
) -> None:
    """Print the coverage of each case."""
    print(f"90 % intervals over {n_streams} streams of {n_windows} windows, seeds {first_seed}…")
    print(HEADER)
    for law in tails:
        posteriors = Posteriors.of(as_stated(law))
        for case in cases:
            found = covered_streams(posteriors, case, n_streams, n_windows, first_seed=first_seed)
            print(_row(f"{case}, {law}", found), flush=True)


def single_part(n_streams: int, tails: Sequence[Tails], first_seed: int) -> None:
    """Print the same of one window each."""
    print(f"\n{n_streams} single windows of the paper's modes, floors on, seeds {first_seed}…")
    print(HEADER)
    for law in tails:
        posteriors = Posteriors.of(LikelihoodSettings(tails=law))
        found = covered_streams(posteriors, CASES[0], n_streams, 1, first_seed=first_seed)
        print(_row(law, found), flush=True)


def _row(name: str, found: Coverage) -> str:
    columns = (found.covered, found.scaled_error, 100 * found.half_width, 100 * found.peak_error)
    text = "".join(f"{' '.join(f'{v:5.2f}' for v in each):>20s}" for each in columns)
    chains = f"  {found.by_chains} by chains" if found.by_chains else ""
    return f"{name:40s}{text}{found.effective_draws:7.0f}{chains}"


def ranks_part(n_runs: int, tails: Sequence[Tails], first_seed: int) -> None:
    """Print how uniform the ranks are."""
    print(f"\nranks of the truth among {RANKED} draws, {n_runs} runs, {BINS} bins: p of chi-square")
    for law in tails:
        posteriors = Posteriors.of(as_stated(law), highest_sigma=HIGHEST_SIGMA)
        found = truth_ranks(posteriors, n_runs, first_seed=first_seed)
        names = zip((*PARAMETER_NAMES, "sigma"), found.uniformity, strict=True)
        text = "  ".join(f"{name} {p:.3f}" for name, p in names)
        print(f"{law:12s}{text}  ({found.by_chains} by chains)", flush=True)


def main(arguments: list[str]) -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks calibration")
    parser.add_argument(
        "--part", choices=("streams", "single", "ranks", "pairing", "all"), default="all"
    )
    parser.add_argument("--streams", type=int, default=100)
    parser.add_argument("--case", type=int, choices=(1, 2, 3), nargs="+", default=(1, 2, 3))
    parser.add_argument("--windows", type=int, default=72)
    parser.add_argument("--runs", type=int, default=200)
    parser.add_argument("--trials", type=int, default=2000)
    parser.add_argument("--tails", choices=("gaussian", "student-t"), nargs="+")
    parser.add_argument("--first-seed", type=int, default=1)
    chosen = parser.parse_args(arguments)
    tails: Sequence[Tails] = chosen.tails or ("student-t", "gaussian")
    if chosen.part in ("streams", "all"):
        cases = [CASES[number - 1] for number in chosen.case]
        streams_part(cases, chosen.streams, chosen.windows, tails, first_seed=chosen.first_seed)
    if chosen.part in ("single", "all"):
        single_part(chosen.streams, tails, chosen.first_seed)
    if chosen.part in ("ranks", "all"):
        ranks_part(chosen.runs, tails, chosen.first_seed)
    if chosen.part in ("pairing", "all"):
        pairing_part(chosen.trials, chosen.first_seed)
