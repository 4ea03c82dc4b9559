"""Springs of towers on piles that have mass, which springs have not.

    python -m tests.benchmarks piles [--seeds FIRST] [--sets N] [--keep]

Each tower of `structural_uncertainty drawn` stands on a pile of finite elements instead of springs:
25 to 45 m of the lowest tube in a bed whose stiffness grows with the depth to the power 0 to 2, k22
.8 to 1.25 of nominal. Its steel and up to as much soil again move, 30 % (one standard deviation)
away from what is stated. The same windows go to three descriptions:

stated    `moving_mass` as stated
steel     the lowest tube's steel
none      without `moving_mass`

Held: inside the 90 % interval of the springs that the pile is at rest.
"""

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq

from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.refresh import joint_refresh
from pipeline.updating.structural.settings import UNCERTAIN
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep
from tests.benchmarks.structural_uncertainty import (
    DEPENDS,
    Case,
    Reached,
    against,
    evidence_of,
)
from tests.outside import figures as outside_figures
from tests.outside.modal_data import LAYOUT, Truth
from tests.outside.model import NOMINAL, SpringSign, averaged, converged
from tests.outside.piles import Pile
from tests.outside.sections import MONOPILE_CANS, MONOPILE_DENSITY, YOUNGS_MODULUS

FIRST_SEED = 32000
SIGN: SpringSign = "embedded-pile"
DIAMETER, WALL = MONOPILE_CANS[0][2], MONOPILE_CANS[0][4]
STEEL = MONOPILE_DENSITY * np.pi * WALL * (DIAMETER - WALL)  # [kg/m]
RIGIDITY = YOUNGS_MODULUS * np.pi / 64 * (DIAMETER**4 - (DIAMETER - 2 * WALL) ** 4)  # [N·m²]
MASS_STD = 0.3  # of the true moving mass over the stated one [-]
LEAST_MASS = 0.2  # of the same [-]


def drawn_pile(rng: np.random.Generator) -> tuple[Pile, float]:
    """Draw a pile, and the moving mass that its description states [kg/m]."""
    length, power = rng.uniform(25.0, 45.0), rng.uniform(0.0, 2.0)
    stated = STEEL * rng.uniform(1.0, 2.0)
    mass = stated * max(LEAST_MASS, 1 + MASS_STD * rng.standard_normal())
    k22 = NOMINAL[1] * rng.uniform(0.8, 1.25)

    def on(log_bed: float) -> Pile:
        return Pile(length, RIGIDITY, mass, float(np.exp(log_bed)), power)

    found = brentq(lambda bed: float(on(bed).springs[1]) - k22, np.log(1e6), np.log(1e12))
    return on(float(found)), stated


@dataclass(frozen=True, slots=True)
class Outcome:
    """One posterior, and the springs that it ought to hold."""

    seed: int
    true_over_nominal: tuple[float, ...]
    reached: Reached
    trusted: bool
    warnings: tuple[str, ...]


def outcomes(seed: int) -> dict[str, Outcome]:
    """Draw a set and infer with each description; by its name."""
    rng = np.random.default_rng(seed)
    pile, stated = drawn_pile(rng)
    truth = Truth(
        pile.springs,
        outside_figures.draw(rng),
        SIGN,
        (averaged(), converged())[seed % 2],
        pile,
    )
    evidence = evidence_of(truth, Case("piles", seed), rng)
    found = {}
    for name, mass in {"stated": stated, "steel": STEEL, "none": 0.0}.items():
        posterior = joint_refresh(_inference(mass), evidence, (), np.random.default_rng(seed))
        if posterior is None:
            continue
        warnings = distrust(posterior, UpdatingSettings().guards)
        found[name] = Outcome(
            seed=seed,
            true_over_nominal=tuple((pile.springs / NOMINAL).tolist()),
            reached=against(posterior, truth.theta),
            trusted=not warnings,
            warnings=tuple(warning.code for warning in warnings),
        )
    return found


def _inference(moving_mass: float) -> JointInference:
    turbine = load_turbine("iea15mw_monopile").with_sign(SIGN)
    foundation = replace(turbine.foundation, moving_mass=moving_mass)
    found = joint_inference(
        replace(turbine, foundation=foundation),
        LAYOUT,
        UpdatingSettings(structure=UNCERTAIN),
        seed=1,
    )
    assert found is not None
    return found


def row(found: Sequence[Outcome]) -> dict[str, object]:
    """Of the sets of one description."""
    held = np.array([each.reached.held for each in found])
    z = np.array([each.reached.z for each in found])
    trusted = np.array([each.trusted for each in found])

    def median(values: list[tuple[float, ...]]) -> list[float]:
        return np.median(values, axis=0).round(1).tolist()

    return {
        "sets": len(found),
        "held": held.sum(axis=0).tolist(),
        "pooled": int(held.sum()),
        "trusted": int(trusted.sum()),
        "held_of_trusted": int(held[trusted].sum()),
        "warnings": sorted({code for each in found for code in each.warnings}),
        "median_error_percent": median([each.reached.error for each in found]),
        "half_width_percent": median([each.reached.half_width for each in found]),
        "median_z": median([each.reached.z for each in found]),
        "rms_z": np.sqrt((z**2).mean(axis=0)).round(2).tolist(),
        "largest_z": round(float(np.abs(z).max()), 1),
    }


def main(arguments: Sequence[str]) -> None:
    """Print a row for each description; keep them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks piles")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int, default=12)
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    chosen = parser.parse_args(arguments)
    seeds = range(chosen.seeds, chosen.seeds + chosen.sets)
    tables: dict[str, list[Outcome]] = {}
    started = time.process_time()
    for seed in seeds:
        for name, each in outcomes(seed).items():
            tables.setdefault(name, []).append(each)
            if chosen.verbose:
                print(name, each, flush=True)
    rows = {name: row(found) for name, found in tables.items()}
    for name, values in rows.items():
        print(f"{name}: {json.dumps(values)}", flush=True)
    print(f"({time.process_time() - started:.0f} s)")
    if chosen.keep:
        keep(
            "piles",
            {"sets": len(seeds), "intervals": 3 * len(seeds), **rows},
            command=f"python -m tests.benchmarks piles --seeds {chosen.seeds} --sets {chosen.sets}",
            seeds=list(seeds),
            depends=(*DEPENDS, "sensors/structure/foundation.py"),
        )
