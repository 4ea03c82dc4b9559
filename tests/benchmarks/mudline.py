"""Springs of a tower whose mudline is not where its description has it.

    python -m tests.benchmarks mudline [--sign SIGN] [--highest HZ] [--short METRES…]
        [--seeds FIRST] [--sets N] [--keep]

The description's lowest tube ends `short` metres above the true mudline (below it where negative),
and its water reaches as far. The sets are those of `structural_uncertainty drawn`: springs, figures
and sensors drawn. Each posterior is compared with two readings:

true       the springs at the true mudline
described  what they and the pile between are at the description's mudline (`springs_at`)

Held: inside the 90 % interval. z: (median − truth) / std, of ln k.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from pilewatch import InputError, springs_at

from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.refresh import joint_refresh
from pipeline.updating.structural.settings import UNCERTAIN
from sensors.arrays import FloatArray
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import SpringSign
from tests.benchmarks._results import keep
from tests.benchmarks.structural_uncertainty import DEPENDS, Case, Reached, against, measured
from tests.outside.modal_data import LAYOUT, Truth
from tests.outside.sections import MUDLINE, YOUNGS_MODULUS

FIRST_SEED = 31000
SHORT = (5.0, 2.0, 1.0, 0.0, -1.0, -2.0, -5.0)  # [m]


def described(short: float, sign: SpringSign) -> TurbineDescription:
    """The shipped turbine with so much less pile above its mudline [m]."""
    turbine = load_turbine("iea15mw_monopile").with_sign(sign)
    bottom = turbine.mudline + short
    tubes = tuple(tube for tube in turbine.tubes if tube.top > bottom + 1e-6)
    return replace(turbine, tubes=(replace(tubes[0], bottom=bottom), *tubes[1:]))


def equivalent(truth: Truth, short: float) -> FloatArray | None:
    """(3,) springs at the description's mudline; None where no springs there are the true ones.

    Below the true mudline the lowest tube goes on.
    """
    assert truth.description is not None
    theta, level, end = truth.theta, MUDLINE, MUDLINE + short
    for can in truth.description.cans if short else ():
        wall = can.thickness * truth.figures.wall_thickness
        outer, inner = can.diameters[0], can.diameters[0] - 2 * wall
        modulus = YOUNGS_MODULUS * truth.figures.youngs_modulus
        rigidity = modulus * np.pi * (outer**4 - inner**4) / 64
        step = min(can.top, end) - level
        try:
            theta = springs_at(theta, truth.sign, rise=step, bending_rigidity=rigidity)
        except InputError:
            return None
        level += step
        if level >= end - 1e-6:
            break
    return theta if theta[2] > 0 else None


@dataclass(frozen=True, slots=True)
class Comparison:
    """One posterior against both readings of its springs."""

    seed: int
    equivalent_over_true: tuple[float, ...] | None
    true: Reached
    described: Reached | None
    """None: no springs there are these."""
    trusted: bool
    warnings: tuple[str, ...]


def comparison(
    case: Case, short: float, sign: SpringSign, inference: JointInference
) -> Comparison | None:
    """Draw a set and infer; None where there is no posterior."""
    rng = np.random.default_rng(case.seed)
    truth, evidence = measured(case, sign, rng)
    posterior = joint_refresh(inference, evidence, (), rng)
    if posterior is None:
        return None
    moved = equivalent(truth, short)
    warnings = distrust(posterior, UpdatingSettings().guards)
    return Comparison(
        seed=case.seed,
        equivalent_over_true=None if moved is None else tuple((moved / truth.theta).tolist()),
        true=against(posterior, truth.theta),
        described=None if moved is None else against(posterior, moved),
        trusted=not warnings,
        warnings=tuple(warning.code for warning in warnings),
    )


def row(found: Sequence[Comparison]) -> dict[str, object]:
    """Of the sets of one length."""
    moved = [each.equivalent_over_true for each in found if each.equivalent_over_true is not None]
    return {
        "sets": len(found),
        "trusted": sum(each.trusted for each in found),
        "warnings": sorted({code for each in found for code in each.warnings}),
        "equivalent_over_true": np.median(moved, axis=0).round(2).tolist() if moved else [],
        "half_width_percent": np.median([each.true.half_width for each in found], axis=0)
        .round(0)
        .tolist(),
        "true": _reading([each.true for each in found]),
        "described": _reading([e.described for e in found if e.described is not None]),
    }


def _reading(reached: Sequence[Reached]) -> dict[str, object]:
    held = np.array([each.held for each in reached]).reshape(-1, 3)
    z = np.array([each.z for each in reached]).reshape(-1, 3)
    return {
        "sets": len(held),
        "held": held.sum(axis=0).tolist(),
        "pooled": int(held.sum()),
        "median_z": np.median(z, axis=0).round(1).tolist() if len(z) else [],
        "largest_z": round(float(np.abs(z).max(initial=0.0)), 1),
        "z": z.round(1).tolist(),
    }


def main(arguments: Sequence[str]) -> None:
    """Print a row for each length; keep them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks mudline")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--highest", type=float, help="of the modes that are used [Hz]")
    parser.add_argument("--short", type=float, nargs="+", default=list(SHORT))
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int, default=5)
    parser.add_argument("--keep", action="store_true")
    chosen = parser.parse_args(arguments)
    rows, seeds = {}, range(chosen.seeds, chosen.seeds + chosen.sets)
    highest = np.inf if chosen.highest is None else chosen.highest
    for short in chosen.short:
        started = time.process_time()
        inference = joint_inference(
            described(short, chosen.sign), LAYOUT, UpdatingSettings(structure=UNCERTAIN), seed=1
        )
        assert inference is not None
        cases = [Case("mudline", seed, highest_frequency=highest) for seed in seeds]
        found = [comparison(case, short, chosen.sign, inference) for case in cases]
        name = f"{abs(short):g} m {'short' if short > 0 else 'long'}" if short else "as it is"
        rows[name] = row([each for each in found if each is not None])
        seconds = time.process_time() - started
        print(f"{chosen.sign} {name}: {json.dumps(rows[name])} ({seconds:.0f} s)", flush=True)
    if chosen.keep:
        below = "" if chosen.highest is None else f"-below-{chosen.highest:g}-hz"
        keep(
            f"mudline-{chosen.sign}{below}",
            {"sets": len(seeds), "intervals": 3 * len(seeds), **rows},
            command=f"python -m tests.benchmarks mudline --sign {chosen.sign}"
            + (f" --highest {chosen.highest:g}" if chosen.highest else "")
            + f" --seeds {chosen.seeds} --sets {chosen.sets}",
            seeds=list(seeds),
            depends=(*DEPENDS, "pipeline/api/pilewatch/springs.py"),
        )
