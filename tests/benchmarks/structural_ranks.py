"""Where the truth ranks among draws of the joint posterior, and which partners modes find.

    python -m tests.benchmarks structural_ranks [--sign SIGN] [--seeds FIRST] [--trials N] [--keep]

Simulation-based calibration (Talts et al. 2018, arXiv:1804.06788) of springs, structure, level and
sensors together: an alternative, all coordinates and σ are drawn from the prior, modes from the
likelihood about them, and the posterior is made as in a session. Springs have a normal prior of
`SPRING_STD` here, on both sides: the shipped one is so wide that most of its draws are no tower.
Errors are normal, as the likelihood has them before it weighs gross ones less, and a mode has
shares of its neighbours of nearly its shape, as `likelihood.mixtures` says.

ranks      p of χ² that ranks are uniform, for each spring, figure, the level and σ
valleys    peaks whose cost is above `VALLEY` times its degrees of freedom
wrong      identified modes whose partner continues another mode of the truth
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import chisquare

from pipeline.messages import ModalEstimate, Mode
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.mixtures import (
    HIDDEN_MIXING,
    LEAST_LIKENESS,
    MIXED_REACH,
    SEEN_MIXING,
    WIDEST_SHARE,
)
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.joint_fit import JointFit
from pipeline.updating.structural.joint_model import JointPeak, continued
from pipeline.updating.structural.prior import GaussianBelief, JointCoordinates
from pipeline.updating.structural.refresh import WIDENING
from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.dynamics.figure_modes import Linearisation
from tests.benchmarks import structural_uncertainty
from tests.benchmarks._results import keep
from tests.outside.modal_data import LAYOUT
from tests.outside.model import SpringSign

FIRST_SEED = 22000
SPRING_STD = 0.15  # of ln k11 and ln k22; of logit c² as well [-]
HIGHEST_SIGMA = 0.002  # of the discrepancy's prior in these trials [-]
DURATION = 600.0  # T of the one window [s]
DAMPING = 0.007  # ζ [-]
SHAPE_STD = 0.006  # of a component [-]
SEEN = 0.6  # share of the model's modes that a window shows [-]
APART = 1.5  # modes nearer than this over T are not drawn: their estimate would be a blend
RANKED = 99  # draws among which the truth is ranked
BINS = 10
VALLEY = 1.5  # cost per degree of freedom


@dataclass(frozen=True, slots=True, eq=False)
class Trial:
    """What came of one truth."""

    ranks: FloatArray
    """(n_dim + 1,) in 0 to `RANKED` of every coordinate and of σ"""
    relative_cost: float
    wrong: int
    pairs: int
    right_alternative: bool


def inference_of(sign: SpringSign) -> JointInference:
    """The product's, but for the prior of springs and σ."""
    narrowed = structural_uncertainty.inference_of(sign).with_springs(_springs)
    return JointInference(
        narrowed.fits,
        structure=narrowed.structure,
        layout=narrowed.layout,
        prior=narrowed.prior,
        highest_sigma=HIGHEST_SIGMA,
    )


def _springs(coordinates: JointCoordinates) -> GaussianBelief:
    return GaussianBelief(("k11", "k22", "k12"), coordinates.origin[:3], np.eye(3) / SPRING_STD**2)


def trial(inference: JointInference, rng: np.random.Generator) -> Trial | None:
    """Draw a truth and its data, infer, and rank; None where there is no posterior."""
    chances = [alternative.probability for alternative, _ in inference.fits]
    number = int(rng.choice(len(chances), p=np.array(chances) / sum(chances)))
    truth, fit = inference.fits[number]
    modes = None
    while modes is None:  # a drawn structure may not stand
        u = rng.multivariate_normal(
            fit.coordinates.origin, np.linalg.inv(fit.coordinates.prior_precision)
        )
        modes = fit.linearised(u)
    sigma = float(rng.uniform(0.0, HIGHEST_SIGMA))
    evidence, numbers = _drawn(modes, fit, sigma, rng)
    result = inference.result(evidence, level_std=fit.coordinates.level_std)
    if result is None:
        return None
    draws, sigmas = result.draws(RANKED, rng, widening=WIDENING)
    below = np.append((draws < u).sum(axis=0), (sigmas < sigma).sum())
    best = result.best
    wrong, pairs = _wrong_pairs(best.peak, modes, numbers)
    return Trial(
        below.astype(float),
        best.peak.relative_cost,
        wrong,
        pairs,
        best.alternative.name == truth.name,
    )


def _drawn(
    modes: Linearisation, fit: JointFit, sigma: float, rng: np.random.Generator
) -> tuple[ModalEvidence, list[int]]:
    """One window's modes about the truth's, and which of the truth's each is."""
    likelihood = fit.likelihood
    gaps = np.diff(modes.frequencies)
    apart = np.minimum(np.append(np.inf, gaps), np.append(gaps, np.inf)) > APART / DURATION
    shown = np.flatnonzero(apart & (rng.uniform(size=len(apart)) < SEEN)).tolist()
    found = []
    for number in shown:
        f, shape = _mixed(modes, number, shown, rng)
        std_f = f * np.sqrt(DAMPING / (2 * np.pi * f * DURATION))
        spread_f = np.hypot(std_f, f * np.hypot(likelihood.frequency_floor, sigma))
        norm = float(np.linalg.norm(shape))
        spread = np.sqrt(SHAPE_STD**2 + likelihood.shape_floor**2 + (sigma * norm) ** 2)
        unit = int(np.argmax(np.abs(shape)))
        free = np.arange(len(shape)) != unit
        factor = np.diag(np.concatenate([[std_f, 1e-4], SHAPE_STD * free]))
        seen = shape + spread * free * rng.standard_normal(len(shape))
        if np.argmax(np.abs(seen)) != unit:
            continue
        found.append((number, _mode(number, f + spread_f * rng.standard_normal(), seen, factor)))
    found.sort(key=lambda each: each[1].frequency)  # as the evidence has them
    estimate = ModalEstimate(
        turbine="t",
        window=0,
        start_ns=0,
        end_ns=round(DURATION * NANOSECONDS),
        layout_id=LAYOUT.layout_id,
        channels=LAYOUT.channel_names,
        modes=tuple(mode for _, mode in found),
        water_level=0.0,
    )
    evidence = ModalEvidence(channels=LAYOUT.channel_names).with_estimate(estimate)
    return evidence, [number for number, _ in found]


def _mixed(
    modes: Linearisation, number: int, shown: Sequence[int], rng: np.random.Generator
) -> tuple[float, FloatArray]:
    """Frequency and shape of a mode with random shares of its neighbours of nearly its shape."""
    own, f = modes.shapes[number], modes.frequencies[number]
    unit = int(np.argmax(np.abs(own)))
    log_f, shape = np.log(f), own.copy()
    for other in range(len(modes.frequencies)):
        apart = np.log(modes.frequencies[other] / f)
        neighbour = modes.shapes[other]
        product = float(own @ neighbour)
        likeness = product**2 / float((own @ own) * (neighbour @ neighbour))
        if other == number or abs(apart) > MIXED_REACH or likeness < LEAST_LIKENESS:
            continue
        mixing = SEEN_MIXING if other in shown else HIDDEN_MIXING
        share = min(mixing * (DAMPING / apart) ** 2, WIDEST_SHARE) * rng.standard_normal()
        log_f += share * product / float(own @ own) * apart
        shape += share * (neighbour - neighbour[unit] * own)
    return float(np.exp(log_f)), shape


def _mode(number: int, frequency: float, shape: FloatArray, factor: FloatArray) -> Mode:
    return Mode(
        name=f"m{number}",
        frequency=frequency,
        frequency_std=float(factor[0, 0]),
        damping_ratio=DAMPING,
        damping_ratio_std=float(factor[1, 1]),
        shape=shape,
        covariance_factor=factor,
        n_block_columns=0,
    )


def _wrong_pairs(peak: JointPeak, truth: Linearisation, numbers: Sequence[int]) -> tuple[int, int]:
    """How many modes have a partner that does not continue their own, and how many have one."""
    there = continued(truth, peak.comparison.linearisation)
    partners = peak.comparison.pairing.model_modes
    paired = [(partner, number) for partner, number in zip(partners, numbers, strict=True)]
    paired = [(partner, number) for partner, number in paired if partner >= 0]
    return sum(there[number] != partner for partner, number in paired), len(paired)


def summary(trials: Sequence[Trial], names: Sequence[str]) -> dict[str, Any]:
    """Return the figures of all trials."""
    ranks = np.array([each.ranks for each in trials])
    bins = np.floor(ranks * BINS / (RANKED + 1)).astype(int)
    p = [float(chisquare(np.bincount(column, minlength=BINS)).pvalue) for column in bins.T]
    inside = ((ranks >= 5) & (ranks < 95)).mean(axis=0)
    named = dict(zip(names, zip(p, inside.tolist(), strict=True), strict=True))
    pairs = sum(each.pairs for each in trials)
    return {
        "trials": len(trials),
        "least_p": round(min(p), 5),
        "least_p_of": names[int(np.argmin(p))],
        "asked_p": round(0.01 / len(names), 6),
        "cover_90": {name: round(cover, 3) for name, (_, cover) in list(named.items())[:3]},
        "pooled_cover_90": round(float(inside[:3].mean()), 3),
        "p": {name: round(value, 4) for name, (value, _) in named.items()},
        "valleys": sum(each.relative_cost > VALLEY for each in trials),
        "wrong_pairs_percent": round(100 * sum(each.wrong for each in trials) / pairs, 3),
        "pairs": pairs,
        "right_alternative": round(float(np.mean([t.right_alternative for t in trials])), 3),
    }


def main(arguments: Sequence[str]) -> None:
    """Print the figures; keep them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks structural_ranks")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--trials", type=int, default=300)
    parser.add_argument("--keep", action="store_true")
    chosen = parser.parse_args(arguments)
    inference = inference_of(chosen.sign)
    names = (*inference.fits[0][1].coordinates.names, "sigma")
    seeds = range(chosen.seeds, chosen.seeds + chosen.trials)
    started, done = time.process_time(), []
    for seed in seeds:
        found = trial(inference, np.random.default_rng(seed))
        if found is None:
            print(f"seed {seed}: no posterior", flush=True)
            continue
        done.append(found)
        if len(done) % 50 == 0:
            print(f"{len(done)} trials, {time.process_time() - started:.0f} s CPU", flush=True)
    figures = summary(done, names)
    print(json.dumps(figures, indent=1))
    if chosen.keep:
        keep(
            f"structural-ranks-{chosen.sign}",
            figures,
            command=f"python -m tests.benchmarks structural_ranks --sign {chosen.sign} "
            f"--seeds {chosen.seeds} --trials {chosen.trials}",
            seeds=seeds,
            depends=structural_uncertainty.DEPENDS,
        )
