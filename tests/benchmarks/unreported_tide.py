"""Springs of towers in a tide that nothing reports.

    python -m tests.benchmarks unreported_tide [--sign SIGN] [--seeds FIRST] [--sets N] [--keep]

A set: every figure of structure and sensors drawn from its prior, springs uniform in .8 to 1.25 of
nominal, modal data by tests.outside (its own elements); the mean level off by 1 m (standard
deviation) and a tide of 1.4 m amplitude over 74 windows, none of it reported. Posteriors of six
windows, the last one counts. Held: inside the 90 % interval. Settings were chosen on seeds 18600
to 18631.
"""

import argparse
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import FoundationEvent, FoundationPosterior, ModalEstimate
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep
from tests.benchmarks.first_weeks import SETTINGS
from tests.benchmarks.structural_uncertainty import DEPENDS, misplaced, scaled
from tests.outside.figures import draw
from tests.outside.instruments import instruments
from tests.outside.modal_data import DURATION, LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, SpringSign, averaged, converged

FIRST_SEED = 264000
WINDOWS = 74  # half a day: one tide
POSTERIORS = (0, 2, 5, 17, 36, WINDOWS - 1)
AMPLITUDE = 1.4  # of the tide [m]
ZERO_STD = 1.0  # of the mean level [m]


@dataclass(frozen=True, slots=True, eq=False)
class Answer:
    """What the last posterior of a set reports."""

    held: FloatArray
    """(3,) 1 where the interval holds the truth"""
    z: FloatArray
    """(3,) error of ln k over its standard deviation [-]"""
    half_width: FloatArray
    """(3,) [% of the median]"""
    trusted: bool
    events: int
    """Changes that were reported; there were none"""
    seconds: float
    """CPU of the slowest refresh but the first [s]"""


def windows(seed: int, sign: SpringSign) -> tuple[Truth, list[ModalEstimate]]:
    """A tower and its modal estimates."""
    rng = np.random.default_rng(seed)
    figures = draw(rng, level_std=ZERO_STD)
    theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    while theta[0] * theta[1] < 1.1 * theta[2] ** 2:
        theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    truth = Truth(theta, figures, sign, (averaged(), converged())[seed % 2])
    phase = DURATION * np.arange(WINDOWS) / 44714 + rng.uniform()
    levels = figures.water_level + AMPLITUDE * np.sin(2 * np.pi * phase)
    sensed = instruments(LAYOUT, misplaced(seed, 1.0))
    seen = replace(sensed.true, layout_id=LAYOUT.layout_id)
    modal = estimates(truth, WINDOWS, rng, levels=levels.round(1).tolist(), layout=seen)
    return truth, [scaled(estimate, sensed.gains) for estimate in modal]


def answer(updater: FoundationUpdater, seed: int, sign: SpringSign) -> Answer:
    """Watch one tower through half a day."""
    truth, modal = windows(seed, sign)
    state, events, seconds, last = updater.initial_state(), 0, [], None
    for number, estimate in enumerate(modal):
        if number in POSTERIORS:
            started = time.process_time()
            state, answers = updater.watched(state, estimate)
            seconds.append(time.process_time() - started)
            last = answers[-1]
        else:
            state, event = updater.accumulated(state, estimate)
            answers = () if event is None else (event,)
        events += sum(isinstance(each, FoundationEvent) for each in answers)
    assert isinstance(last, FoundationPosterior), last
    low, median, high = (
        np.array([getattr(spring, name) for spring in last.parameters[:3]])
        for name in ("p05", "median", "p95")
    )
    return Answer(
        held=((low < truth.theta) & (truth.theta < high)).astype(float),
        z=np.log(median / truth.theta) / (np.log(high / low) / 3.29),
        half_width=50 * (high - low) / median,
        trusted=last.trusted,
        events=events,
        seconds=max(seconds[1:]),
    )


def main(arguments: Sequence[str]) -> None:
    """Print a line for each set and their sum."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks unreported_tide")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int, default=30)
    parser.add_argument("--keep", action="store_true")
    chosen = parser.parse_args(arguments)
    turbine = load_turbine("iea15mw_monopile").with_sign(chosen.sign)
    inference = joint_inference(turbine, LAYOUT, SETTINGS, seed=1)
    model = ModalModel(turbine, LAYOUT)
    updater = FoundationUpdater(model, LAYOUT, SETTINGS, seed=1, joint=inference)
    seeds, found = list(range(chosen.seeds, chosen.seeds + chosen.sets)), []
    for seed in seeds:
        found.append(answer(updater, seed, chosen.sign))
        print(seed, found[-1], flush=True)
    held = np.sum([each.held for each in found], axis=0)
    figures = {
        "sets": len(found),
        "held": held.tolist(),
        "pooled": round(float(held.sum()) / (3 * len(found)), 3),
        "rms_z": np.sqrt(np.mean([each.z**2 for each in found], axis=0)).round(2).tolist(),
        "half_width_percent": np.median([e.half_width for e in found], axis=0).round(1).tolist(),
        "trusted": sum(each.trusted for each in found),
        "events": sum(each.events for each in found),
        "slowest_refresh": round(max(each.seconds for each in found), 2),
    }
    print(figures)
    if chosen.keep:
        keep(
            f"unreported-tide-{chosen.sign}",
            figures,
            command=f"python -m tests.benchmarks unreported_tide --sign {chosen.sign} "
            f"--seeds {chosen.seeds} --sets {chosen.sets}",
            seeds=seeds,
            depends=[*DEPENDS, "pipeline/updating/updater.py", "pipeline/updating/change"],
        )
