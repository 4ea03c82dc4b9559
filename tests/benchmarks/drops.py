"""A spring that softens while the description is wrong: found when, and how large?

    python -m tests.benchmarks drops [--sizes 0.03 0.05 0.1] [--trials 20] [--seeds FIRST]
        [--unreported] [--keep]

A trial: modal data by tests.outside, E −1 % and added mass +10 % off the description, the water's
level known and moving with a tide of 1 m, springs uniform in .9 to 1.15 of nominal; 36 windows,
then k22 falls by the size. Three of the windows have a posterior, the others enter the sums alone,
which is what changes are noticed by. Delay: windows until the event, 1 is the first after the drop.
Size: the ratio of k22 to that before the event, as the posterior of the sixth window after the drop
has it; bias is the median error. `--unreported`: nothing reports the level. No setting was chosen
on these seeds.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from pipeline.messages import FoundationEvent, FoundationPosterior, ModalEstimate
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep
from tests.benchmarks.first_weeks import SETTINGS
from tests.outside.figures import Figures
from tests.outside.modal_data import LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, converged

FIRST_SEED = 64000
BEFORE, AFTER = 36, 6  # windows
POSTERIORS = (5, BEFORE - 1, BEFORE + AFTER - 1)  # windows that have one
WRONG = Figures(youngs_modulus=0.99, added_mass=1.10)


@dataclass(frozen=True, slots=True)
class Outcome:
    """Of one trial."""

    delay: int | None
    """Windows; None: no event in AFTER windows."""
    false: int
    """Events before the drop."""
    revised: tuple[float, float, float] | None
    """k22 over that before: median, 5 % and 95 % quantiles."""


def trial(
    inference: JointInference, model: ModalModel, size: float, seed: int, *, reported: bool
) -> Outcome:
    """Watch one turbine through a drop; `reported`: the level of the water."""
    rng = np.random.default_rng(seed)
    theta = NOMINAL * rng.uniform(0.9, 1.15, 3)
    softer = theta * np.array([1.0, 1.0 - size, 1.0])
    n = BEFORE + AFTER
    tide = np.round(np.sin(2 * np.pi * (np.arange(n) * 600 / 44714 + rng.uniform())), 1).tolist()
    modal = _through_a_drop(theta, softer, tide, rng, reported=reported)
    updater = FoundationUpdater(model, LAYOUT, SETTINGS, seed=1, joint=inference)
    state, events, revised = updater.initial_state(), [], None
    for window, estimate in enumerate(modal):
        if window in POSTERIORS:
            state, answers = updater.watched(state, estimate)
        else:
            state, said = updater.accumulated(state, estimate)
            answers = () if said is None else (said,)
        events += [window for each in answers if isinstance(each, FoundationEvent)]
        last = answers[-1] if answers else None
        if isinstance(last, FoundationPosterior) and last.relative:
            k22 = last.relative[1]
            revised = (k22.median, k22.p05, k22.p95)
    delays = [window - BEFORE + 1 for window in events if window >= BEFORE]
    return Outcome(
        delay=min(delays, default=None),
        false=sum(window < BEFORE for window in events),
        revised=revised,
    )


def _through_a_drop(
    theta: FloatArray,
    softer: FloatArray,
    tide: Sequence[float],
    rng: np.random.Generator,
    *,
    reported: bool,
) -> list[ModalEstimate]:
    """Estimates of both periods, whose lasting errors are the same."""
    lasting: dict[int, FloatArray] = {}
    parts = []
    for springs, levels in ((theta, tide[:BEFORE]), (softer, tide[BEFORE:])):
        truth = Truth(springs, WRONG, description=converged())
        known = levels if reported else None
        parts += estimates(
            truth, len(levels), rng, levels=levels, reported_levels=known, lasting=lasting
        )
    first, duration = parts[0].start_ns, parts[0].end_ns - parts[0].start_ns
    return [
        replace(each, window=n, start_ns=first + n * duration, end_ns=first + (n + 1) * duration)
        for n, each in enumerate(parts)
    ]


def row(outcomes: Sequence[Outcome], size: float) -> dict[str, float | int | None]:
    """The figures of one size."""
    found = [each.delay for each in outcomes if each.delay is not None]
    revised = np.array([each.revised for each in outcomes if each.revised is not None])
    median, low, high = revised.T
    return {
        "trials": len(outcomes),
        "found": len(found),
        "false": sum(each.false for each in outcomes),
        "median_delay": float(np.median(found)) if found else None,
        "sizes": len(revised),
        "cover": round(float(np.mean((low < 1 - size) & (1 - size < high))), 3),
        "bias_percent": round(float(100 * np.median(median - (1 - size))), 2),
        "half_width_percent": round(float(100 * np.median(high - low) / 2), 2),
    }


def main(arguments: Sequence[str]) -> None:
    """Print a row for each size."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks drops")
    parser.add_argument("--sizes", type=float, nargs="+", default=[0.03, 0.05, 0.1])
    parser.add_argument("--trials", type=int, default=20)
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--unreported", action="store_true", help="nothing reports the level")
    parser.add_argument("--keep", action="store_true", help="write results/drops.json")
    chosen = parser.parse_args(arguments)
    turbine = load_turbine("iea15mw_monopile")
    inference = joint_inference(turbine, LAYOUT, SETTINGS, seed=1)
    assert inference is not None
    model, figures, seeds = ModalModel(turbine, LAYOUT), {}, []
    for number, size in enumerate(chosen.sizes):
        own = range(chosen.seeds + 1000 * number, chosen.seeds + 1000 * number + chosen.trials)
        outcomes = []
        for seed in own:
            outcomes.append(trial(inference, model, size, seed, reported=not chosen.unreported))
            print(size, seed, outcomes[-1], flush=True)
        seeds += own
        figures[f"{size:g}"] = row(outcomes, size)
        print(size, figures[f"{size:g}"], flush=True)
    if chosen.keep:
        keep(
            "drops-unreported" if chosen.unreported else "drops",
            figures,
            command="python -m tests.benchmarks drops " + " ".join(arguments),
            seeds=seeds,
            depends=["pipeline/updating", "sensors/dynamics", "tests/outside"],
        )
