"""A change of the springs by a description that does not hold: absolute and relative.

    python -m tests.benchmarks rough_change [--sign SIGN] [--seeds FIRST] [--sets N] [--keep]

The truth is tests.outside's `detailed` structure (blades with twist and their own distribution;
in every second set E is 4 % more, too), of which the updater knows the coarse one. Four windows
before and four after a change of one of four kinds, none among them; true springs uniform in .9 to
1.1 of nominal before it. The width of rough figures was chosen on seeds 20000 to 20005.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.refresh import joint_refresh
from sensors.arrays import FloatArray
from tests.benchmarks._results import keep
from tests.benchmarks.structural_uncertainty import DEPENDS, inference_of
from tests.outside.figures import Figures
from tests.outside.modal_data import LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, SpringSign, detailed

FIRST_SEED = 80000
WINDOWS = 4
CHANGES = ((0.8, 0.85, 0.9), (1.0, 0.9, 1.0), (0.85, 0.85, 0.85), (1.0, 1.0, 1.0))
HALF = 1.645  # standard deviations to the end of a 90 % interval


def trial(seed: int, sign: SpringSign, inference: JointInference) -> dict[str, Any] | None:
    """One change; None where there is no posterior."""
    rng = np.random.default_rng(seed)
    before, factor = NOMINAL * rng.uniform(0.9, 1.1, 3), np.array(CHANGES[seed % 4])
    figures = replace(Figures(), youngs_modulus=1.04) if seed % 2 else Figures()
    periods = [_evidence(theta, figures, sign, rng) for theta in (before, before * factor)]
    found = joint_refresh(inference, periods[1], (), rng, reference=periods[0])
    if found is None or found.refusal is not None or found.relative is None:
        return None
    theta = found.draws[:, :3] * NOMINAL / (before * factor)
    low, median, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
    stds = np.sqrt(np.diag(found.relative.covariance))
    z = (found.relative.mean - np.log(factor)) / stds
    return {
        "seed": seed,
        "change": factor.tolist(),
        "median_over_true": median.round(2).tolist(),
        "held": ((low < 1) & (high > 1)).tolist(),
        "relative": np.exp(found.relative.mean).round(3).tolist(),
        "relative_std": stds.round(3).tolist(),
        "relative_held": (np.abs(z) < HALF).tolist(),
        "trusted": not distrust(found, UpdatingSettings().guards),
    }


def _evidence(
    theta: FloatArray, figures: Figures, sign: SpringSign, rng: np.random.Generator
) -> ModalEvidence:
    truth = Truth(theta=theta, figures=figures, sign=sign, description=detailed())
    seen = ModalEvidence(channels=LAYOUT.channel_names)
    for estimate in estimates(truth, WINDOWS, rng, reported_levels=[0.0] * WINDOWS):
        seen = seen.with_estimate(estimate)
    return seen


def main(arguments: Sequence[str]) -> None:
    """Print a row for each set and their sum; keep them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks rough_change")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int, default=12)
    parser.add_argument("--keep", action="store_true")
    chosen = parser.parse_args(arguments)
    inference = inference_of(chosen.sign)
    seeds = range(chosen.seeds, chosen.seeds + chosen.sets)
    trials = []
    for seed in seeds:
        found = trial(seed, chosen.sign, inference)
        print(seed, found, flush=True)
        if found is not None:
            trials.append(found)
    off = np.abs(np.log([each["median_over_true"] for each in trials]))
    figures = {
        "sets": len(trials),
        "refused": len(seeds) - len(trials),
        "held": np.sum([each["held"] for each in trials], axis=0).tolist(),
        "median_factor_off": np.exp(np.median(off, axis=0)).round(2).tolist(),
        "relative_held": np.sum([each["relative_held"] for each in trials], axis=0).tolist(),
        "relative_half_width_percent": (
            100 * HALF * np.median([each["relative_std"] for each in trials], axis=0)
        )
        .round(1)
        .tolist(),
        "trusted": sum(each["trusted"] for each in trials),
    }
    print(figures)
    if chosen.keep:
        keep(
            f"rough-change-{chosen.sign}",
            figures | {"trials": trials},
            command=f"python -m tests.benchmarks rough_change --sign {chosen.sign} --seeds "
            f"{chosen.seeds} --sets {chosen.sets}",
            seeds=list(seeds),
            depends=DEPENDS,
        )
