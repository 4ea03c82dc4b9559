"""Intervals after a first week of tides has reported of the structure's figures, and before it.

    python -m tests.benchmarks first_weeks [--sign SIGN] [--seeds FIRST] [--sets N] [--keep]

A set: every figure of structure and sensors drawn from its prior, springs uniform in .8 to 1.25 of
nominal, modal data by tests.outside (its own elements); 1008 windows under a spring-neap tide of
1.5 m, the gauge off by .1 m, then six windows at the mean level whose springs are inferred with all
defaults: with the figures' priors ("before") and with the calibration of the week ("after"). Held:
inside the 90 % interval. Settings were chosen on seeds 18000 to 18042 with 300 and 400 windows, of
sensors as stated, and after eight sets of the other sign (61000 to 61007) had shown floors counted
twice.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import ModalEstimate
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import SeenWindow, mode_observations
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference, prior_stds
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.periods.calibration import (
    calibrated,
    calibration_of,
    evidence_by_level,
)
from pipeline.updating.structural.refresh import JointRefresh, joint_refresh
from pipeline.updating.structural.settings import UNCERTAIN
from sensors.arrays import FloatArray
from sensors.structure.calibration import Calibration
from sensors.structure.description import TurbineDescription, load_turbine
from tests.benchmarks._results import keep
from tests.benchmarks.structural_uncertainty import misplaced, scaled
from tests.outside.figures import draw
from tests.outside.instruments import instruments
from tests.outside.modal_data import DURATION, LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, SpringSign, averaged, converged

FIRST_SEED = 65000
WEEK = 1008  # windows
LATER = 6  # windows whose springs are inferred
TIDE = 1.5  # amplitude [m]
SETTINGS = UpdatingSettings(structure=UNCERTAIN)


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What one posterior says of the springs."""

    held: tuple[bool, ...]
    half_width: FloatArray
    """(3,) [% of the median]"""
    trusted: bool


def tide(n_windows: int) -> FloatArray:
    """Levels above the mean of the windows of some days, to 10 cm [m], (n_windows,)."""
    t = DURATION * np.arange(n_windows)
    fortnight = 1 + 0.3 * np.sin(2 * np.pi * t / (14.77 * 86400))
    return np.round(TIDE * fortnight * np.sin(2 * np.pi * t / 44714), 1)


def drawn(seed: int, sign: SpringSign, n_windows: int) -> tuple[Truth, list[ModalEstimate]]:
    """A turbine, the estimates of its first windows under tides and of the later ones."""
    rng = np.random.default_rng(seed)
    figures = draw(rng)
    theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    while theta[0] * theta[1] < 1.1 * theta[2] ** 2:
        theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    truth = Truth(theta, figures, sign, (averaged(), converged())[seed % 2])
    reported = np.append(tide(n_windows), np.zeros(LATER))
    sensed = instruments(LAYOUT, misplaced(seed, 1.0))
    modal = estimates(
        truth,
        n_windows + LATER,
        rng,
        levels=(reported + figures.water_level).tolist(),
        reported_levels=reported.tolist(),
        layout=replace(sensed.true, layout_id=LAYOUT.layout_id),
    )
    return truth, [scaled(estimate, sensed.gains) for estimate in modal]


def inference_of(turbine: TurbineDescription) -> JointInference:
    """With all defaults."""
    found = joint_inference(turbine, LAYOUT, SETTINGS, seed=1)
    assert found is not None
    return found


@dataclass(frozen=True, slots=True, eq=False)
class FirstPeriod:
    """What the windows under tides report."""

    whole: ModalEvidence
    levels: list[tuple[float, ModalEvidence]]
    """Rise of the water [m] and the windows at it, rising."""
    found: JointRefresh
    """Of the whole."""


def first_period(inference: JointInference, modal: Sequence[ModalEstimate]) -> FirstPeriod:
    """The joint posterior of these estimates and the evidence at each level."""
    windows = [
        SeenWindow.of(each, mode_observations(each, LAYOUT.channel_names), each.water_level)
        for each in modal
    ]
    whole, levels = evidence_by_level(windows, ModalEvidence(channels=LAYOUT.channel_names))
    found = joint_refresh(inference, whole, (), np.random.default_rng(0))
    assert found is not None
    return FirstPeriod(whole, levels, found)


def calibration(inference: JointInference, period: FirstPeriod, sign: SpringSign) -> Calibration:
    """As `pilewatch calibrate` makes it of the period."""
    stds = prior_stds(inference.prior, inference.fits[0][1].sensors)
    alternatives = calibrated(period.found.result, period.levels)
    return calibration_of(alternatives, stds, springs_sign=sign, source="drawn")


def refreshed(inference: JointInference, modal: Sequence[ModalEstimate]) -> JointRefresh:
    """The posterior of some windows."""
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for estimate in modal:
        evidence = evidence.with_estimate(estimate)
    found = joint_refresh(inference, evidence, (), np.random.default_rng(1))
    assert found is not None
    return found


def answer(found: JointRefresh, truth: Truth) -> Answer:
    """Quantiles against the truth."""
    low, median, high = np.quantile(found.draws[:, :3] * NOMINAL, [0.05, 0.5, 0.95], axis=0)
    return Answer(
        held=tuple(((low < truth.theta) & (truth.theta < high)).tolist()),
        half_width=50 * (high - low) / median,
        trusted=not distrust(found, SETTINGS.guards),
    )


def before_and_after(
    seed: int, sign: SpringSign, n_windows: int = WEEK
) -> tuple[Answer, Answer, float]:
    """Of one set; and the CPU time of its calibration [s]."""
    turbine = load_turbine("iea15mw_monopile").with_sign(sign)
    inference = inference_of(turbine)
    truth, modal = drawn(seed, sign, n_windows)
    started = time.process_time()
    section = calibration(inference, first_period(inference, modal[:-LATER]), sign)
    seconds = time.process_time() - started
    later = inference_of(replace(turbine, calibration=section))
    return (
        answer(refreshed(inference, modal[-LATER:]), truth),
        answer(refreshed(later, modal[-LATER:]), truth),
        seconds,
    )


def main(arguments: Sequence[str]) -> None:
    """Print a row for each set and the table."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks first_weeks")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int, default=20)
    parser.add_argument("--windows", type=int, default=WEEK)
    parser.add_argument("--keep", action="store_true", help="write results/first-weeks-SIGN.json")
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.seeds, chosen.seeds + chosen.sets)
    befores, afters, seconds = [], [], []
    for seed in seeds:
        before, after, cpu = before_and_after(seed, chosen.sign, chosen.windows)
        befores.append(before)
        afters.append(after)
        seconds.append(cpu)
        ratio = after.half_width / before.half_width
        print(seed, before.half_width.round(1), after.half_width.round(1), ratio.round(2),
              *before.held, *after.held, after.trusted, f"{cpu:.1f} s", flush=True)  # fmt: skip
    widths = np.array([[b.half_width, a.half_width] for b, a in zip(befores, afters, strict=True)])
    figures = {
        "sets": len(befores),
        "held_before": np.sum([each.held for each in befores], axis=0).tolist(),
        "held_after": np.sum([each.held for each in afters], axis=0).tolist(),
        "half_width_before_percent": np.median(widths[:, 0], axis=0).round(1).tolist(),
        "half_width_after_percent": np.median(widths[:, 1], axis=0).round(1).tolist(),
        "ratio": np.median(widths[:, 1] / widths[:, 0], axis=0).round(2).tolist(),
        "trusted_after": int(sum(each.trusted for each in afters)),
        "cpu_seconds": round(float(np.median(seconds)), 1),
    }
    print(figures)
    if chosen.keep:
        keep(
            f"first-weeks-{chosen.sign}",
            figures,
            command="python -m tests.benchmarks first_weeks " + " ".join(arguments),
            seeds=list(seeds),
            depends=["pipeline/updating/structural", "sensors/dynamics", "tests/outside"],
        )
