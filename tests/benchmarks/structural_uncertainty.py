"""Intervals on towers of another simulator, whose figures nobody told the updater.

    python -m tests.benchmarks structural_uncertainty PART… [--sign SIGN] [--seeds FIRST]
        [--sets N] [--keep]

drawn     every figure from its prior, six windows
identified  the same from time histories, by the product's identification
weak      the same under the weak load; `single`: one window; `sheared`: of tubes that shear
level     the water level unknown (1 m)
alone     one figure off, the others as described, ten sets each
inside    in the priors and trusted?  `outside`: another turbine, wrong sensors, figures at 5 std
sign      k12 has the other sign than the description says
sensors   one sensor turned, swapped, flipped, scaled, displaced, all turned, twenty sets each

A set: springs uniform in .8 to 1.25 of nominal, modal data by tests.outside (its own elements;
blades reduced or converged in turn), sensors misplaced as their priors say where figures are drawn,
the level known to .1 m. Held: inside the 90 % interval.
z: (median − truth) / std, of ln k. Thresholds and floors were chosen on seeds below 22000.
"""

import argparse
import json
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.messages import ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.structural.joint_message import distrust
from pipeline.updating.structural.refresh import JointRefresh, joint_refresh
from pipeline.updating.structural.sensors.figures import GAIN_STD, HEADING_STD, HEIGHT_STD
from pipeline.updating.structural.settings import UNCERTAIN
from sensors.arrays import FloatArray
from sensors.structure.description import load_turbine
from sensors.structure.foundation import SPRING_SIGNS
from tests.benchmarks._results import keep
from tests.outside import figures as outside_figures
from tests.outside.figures import Figures
from tests.outside.instruments import SensorFault, instruments
from tests.outside.loads import STRONG, WEAK, Loads
from tests.outside.modal_data import LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, Description, SpringSign, averaged, converged, detailed
from tests.outside.records import record

FIRST_SEED = 30000
MISPLACED = 1  # of the random numbers that place a set's sensors
SPRINGS = ("k11", "k22", "k12")
DEPENDS = (
    "pipeline/updating/structural",
    "pipeline/updating/likelihood",
    "sensors/dynamics/figure_model.py",
    "sensors/structure/figures.py",
    "tests/outside",
)
HEIGHTS = (41.0, 80.0, 106.0, 145.0)  # of the sensors [m]
ALONE: dict[str, Callable[[Figures], Figures]] = {
    "E -1 %": lambda f: replace(f, youngs_modulus=0.99),
    "E -3 %": lambda f: replace(f, youngs_modulus=0.97),
    "wall -2 %": lambda f: replace(f, wall_thickness=0.98),
    "RNA +2 %": lambda f: replace(f, rna_mass=1.02),
    "RNA +5 %": lambda f: replace(f, rna_mass=1.05),
    "roll inertia +31 %": lambda f: replace(f, nacelle_roll_inertia=1.31),
    "added mass +10 %": lambda f: replace(f, added_mass=1.10),
    "added mass +20 %": lambda f: replace(f, added_mass=1.20),
    "level 1 m unknown": lambda f: replace(f, water_level=1.0),
    "level 2 m unknown": lambda f: replace(f, water_level=2.0),
    "growth 50 mm": lambda f: replace(f, marine_growth=0.05),
    "blade stiffness -10 %": lambda f: replace(f, flap_stiffness=0.9, edge_stiffness=0.9),
    "transition piece 450 t": lambda f: replace(f, transition_piece=450e3),
    "flooded": lambda f: replace(f, flooded=True),
}
FAULTS: dict[str, Callable[[float, int], tuple[SensorFault, ...]]] = {
    "turned 15°": lambda z, axis: (SensorFault("turned", z, 15.0),),
    "swapped": lambda z, axis: (SensorFault("swapped", z, 145.0 if z < 140 else 80.0),),
    "flipped": lambda z, axis: (SensorFault("flipped", z, axis=axis),),
    "gain +10 %": lambda z, axis: (SensorFault("gain", z, 0.1, axis=axis),),
    "3 m higher": lambda z, axis: (SensorFault("height", z, 3.0 if z < 140 else -3.0),),
    "all turned 30°": lambda z, axis: tuple(
        SensorFault("turned", each, 30.0 * (1 - 2 * axis)) for each in HEIGHTS
    ),
}


@dataclass(frozen=True, slots=True)
class Case:
    """One set: what is true, and how it is seen."""

    name: str
    seed: int
    figures: Callable[[Figures], Figures] | None = None
    """None: drawn from the priors; else changes the described ones."""
    n_windows: int = 6
    loads: Loads = STRONG
    level_std: float = 0.1
    """Of the true level about the mean, and whether it is reported: above .1 m it is not [m]."""
    description: Description | None = None
    faults: tuple[SensorFault, ...] = ()
    beyond: float = 1.0
    """Factor on the drawn figures' departures."""
    other_sign: bool = False
    """Whether k12 has the other sign than the description says."""
    sheared: bool = False
    """Whether its tubes deform by shear; the description's only bend."""
    identified: bool = False
    """Whether the modes come from time histories; else they are drawn."""
    highest_frequency: float = np.inf
    """Of the modes that the updater gets [Hz]."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """What came of a set."""

    name: str
    seed: int
    held: tuple[bool, ...]
    z: tuple[float, ...]
    half_width: tuple[float, ...]
    """[% of the median]"""
    error: tuple[float, ...]
    """[%]"""
    trusted: bool
    doubts: tuple[str, ...]
    named: bool
    """Whether the sensor that is wrong is named, and with what is wrong with it."""
    relative_cost: float
    unpredicted: float
    conflict: float
    """Of the worst figure [prior std]"""
    conflicts: tuple[str, ...]
    alternative: str
    paired: float
    seconds: float


def inference_of(sign: SpringSign) -> JointInference:
    """The product's, with all defaults."""
    turbine = load_turbine("iea15mw_monopile").with_sign(sign)
    found = joint_inference(turbine, LAYOUT, UpdatingSettings(structure=UNCERTAIN), seed=1)
    assert found is not None
    return found


def outcome(case: Case, sign: SpringSign, inference: JointInference) -> Outcome | None:
    """Draw a set and infer; None where there is no posterior."""
    rng = np.random.default_rng(case.seed)
    truth, evidence = measured(case, sign, rng)
    started = time.process_time()
    posterior = joint_refresh(inference, evidence, (), rng)
    if posterior is None:
        return None
    seconds = time.process_time() - started
    reached = against(posterior, truth.theta)
    doubts = distrust(posterior, UpdatingSettings().guards)
    named = [doubt.text for doubt in doubts if doubt.code == "sensor"]
    pairing = posterior.best.peak.comparison.pairing
    return Outcome(
        name=case.name,
        seed=case.seed,
        held=reached.held,
        z=reached.z,
        half_width=reached.half_width,
        error=reached.error,
        trusted=not doubts,
        doubts=tuple(f"{doubt.code}: {doubt.text}" for doubt in doubts),
        named=bool(case.faults) and any(text.startswith(_named(case)) for text in named),
        relative_cost=posterior.best.peak.relative_cost,
        unpredicted=posterior.checks.unpredicted_share,
        conflict=abs(posterior.conflicts[0].deviations) if posterior.conflicts else 0.0,
        conflicts=tuple(f"{c.name} {c.deviations:+.1f}" for c in posterior.conflicts[:3]),
        alternative=posterior.best.alternative.name,
        paired=pairing.paired_share,
        seconds=seconds,
    )


def _named(case: Case) -> str:
    """How a posterior begins to name the fault of a case's sensors."""
    fault = case.faults[0]
    if len(case.faults) > 1:
        return "all sensors are turned"
    if fault.kind == "swapped":
        low, high = sorted((fault.elevation, fault.size))
        return f"the sensors at {low:g} m and {high:g} m are swapped"
    if fault.kind in ("flipped", "gain"):
        at = [c.name for c in LAYOUT.channels if c.elevation == fault.elevation]
        return f"channel {at[fault.axis]} " + {"flipped": "is flipped", "gain": "reads"}[fault.kind]
    what = {"turned": "is turned", "height": "sits"}[fault.kind]
    return f"the sensor at {fault.elevation:g} m {what}"


def measured(case: Case, sign: SpringSign, rng: np.random.Generator) -> tuple[Truth, ModalEvidence]:
    """Draw a set: what is true, and the evidence of its windows."""
    truth = _truth(case, sign, rng)
    return truth, evidence_of(truth, case, rng)


def evidence_of(truth: Truth, case: Case, rng: np.random.Generator) -> ModalEvidence:
    """Draw what the windows of a case show of a structure."""
    if case.figures is None:
        case = replace(case, faults=(*misplaced(case.seed, case.beyond), *case.faults))
    known = case.level_std <= 0.1
    sensed = instruments(LAYOUT, case.faults)
    if case.identified:
        modal = _identified(truth, case, rng)
    else:
        drawn = estimates(
            truth,
            case.n_windows,
            rng,
            layout=replace(sensed.true, layout_id=LAYOUT.layout_id),
            loads=case.loads,
            reported_levels=[0.0] * case.n_windows if known else None,
        )
        modal = [scaled(estimate, sensed.gains) for estimate in drawn]
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    for estimate in modal:
        low = tuple(mode for mode in estimate.modes if mode.frequency <= case.highest_frequency)
        evidence = evidence.with_estimate(replace(estimate, modes=low))
    return evidence


@dataclass(frozen=True, slots=True)
class Reached:
    """Intervals of the three springs against springs."""

    held: tuple[bool, ...]
    z: tuple[float, ...]
    half_width: tuple[float, ...]
    """[% of the median]"""
    error: tuple[float, ...]
    """[%]"""


def against(posterior: JointRefresh, true: FloatArray) -> Reached:
    """Compare a posterior with k11 [N/m], k22 [N·m/rad], k12 [N/rad], (3,)."""
    theta = posterior.draws[:, :3] * NOMINAL
    low, median, high = np.quantile(theta, [0.05, 0.5, 0.95], axis=0)
    logs = np.log(theta)
    return Reached(
        held=tuple(((low < true) & (true < high)).tolist()),
        z=tuple(((np.median(logs, axis=0) - np.log(true)) / logs.std(axis=0)).tolist()),
        half_width=tuple((50 * (high - low) / median).tolist()),
        error=tuple((100 * (median / true - 1)).tolist()),
    )


def _identified(truth: Truth, case: Case, rng: np.random.Generator) -> list[ModalEstimate]:
    """What the product identifies in the time histories of a set, the level reported."""
    made = record(truth, case.n_windows, rng, faults=case.faults, loads=case.loads)
    node = IdentificationNode()
    found = list(node.handle(LAYOUT))
    for block in made.blocks():
        found.extend(node.handle(block))
    return [replace(each, water_level=0.0) for each in found if isinstance(each, ModalEstimate)]


def _truth(case: Case, sign: SpringSign, rng: np.random.Generator) -> Truth:
    theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    while theta[0] * theta[1] < 1.1 * theta[2] ** 2:
        theta = NOMINAL * rng.uniform(0.8, 1.25, 3)
    if case.figures is None:
        drawn = outside_figures.draw(rng, level_std=case.level_std)
        drawn = _farther(drawn, case.beyond)
    else:
        drawn = case.figures(Figures())
    if case.other_sign:
        (sign,) = (each for each in SPRING_SIGNS if each != sign)
    description = case.description or (averaged(), converged())[case.seed % 2]
    description = replace(description, shear=case.sheared)
    return Truth(theta=theta, figures=drawn, sign=sign, description=description)


def misplaced(seed: int, factor: float) -> tuple[SensorFault, ...]:
    """Gains, headings and heights of all sensors, drawn from their priors; the top one, which the
    tower's end carries, can only be lower."""
    rng = np.random.default_rng([seed, MISPLACED])
    found = []
    heights = np.unique(LAYOUT.elevations).tolist()
    for z in heights:
        rise = factor * HEIGHT_STD * rng.standard_normal()
        found.append(SensorFault("height", z, -abs(rise) if z == heights[-1] else rise))
        found.append(SensorFault("turned", z, factor * HEADING_STD * rng.standard_normal()))
        for axis in (0, 1):
            gain = factor * GAIN_STD * rng.standard_normal()
            found.append(SensorFault("gain", z, gain, axis=axis))
    return tuple(found)


def _farther(drawn: Figures, factor: float) -> Figures:
    if factor == 1.0:
        return drawn
    nominal = asdict(Figures())
    values = {k: nominal[k] + factor * (v - nominal[k]) for k, v in asdict(drawn).items()}
    return Figures(**(values | {"flooded": drawn.flooded}))


def scaled(estimate: ModalEstimate, gains: np.ndarray) -> ModalEstimate:
    """The estimate of sensors with gains."""
    if np.all(gains == 1.0):
        return estimate
    modes = []
    for mode in estimate.modes:
        shape = mode.shape * gains
        unit = int(np.argmax(np.abs(shape)))
        scaled = shape / shape[unit]
        factor = mode.covariance_factor.copy()
        factor[2:] *= gains[:, None]
        factor[2:] = (factor[2:] - np.outer(scaled, factor[2 + unit])) / shape[unit]
        factor[2 + unit] = 0.0
        modes.append(replace(mode, shape=scaled, covariance_factor=factor))
    return replace(estimate, modes=tuple(modes))


def cases(part: str, first: int, sets: int | None) -> Iterator[Case]:
    """The sets of one part."""
    seeds = range(first, first + (sets or {"drawn": 60}.get(part, 24)))
    if part in ("drawn", "inside"):
        yield from (Case(part, seed) for seed in seeds)
    elif part == "identified":
        yield from (Case(part, seed, identified=True) for seed in seeds)
    elif part == "weak":
        yield from (Case(part, seed, loads=WEAK) for seed in seeds)
    elif part == "single":
        yield from (Case(part, seed, n_windows=1) for seed in seeds)
    elif part == "sheared":
        yield from (Case(part, seed, sheared=True) for seed in seeds)
    elif part == "level":
        yield from (Case(part, seed, level_std=1.0) for seed in seeds)
    elif part == "sign":
        yield from (Case(part, seed, other_sign=True) for seed in seeds)
    elif part == "alone":
        for number, (name, change) in enumerate(ALONE.items()):
            std = 1.0 if name.startswith("level") else 0.1
            for k in range(sets or 10):
                yield Case(name, first + 100 * number + k, figures=change, level_std=std)
    elif part == "outside":
        yield from _outside_cases(first, sets or 24)
    elif part == "sensors":
        for number, (name, fault) in enumerate(FAULTS.items()):
            for k in range(sets or 20):
                z = HEIGHTS[k % 4]
                yield Case(name, first + 100 * number + k, faults=fault(z, k % 2))
    else:
        raise SystemExit(f"no part {part!r}")


def _outside_cases(first: int, sets: int) -> Iterator[Case]:
    kinds = 3
    for k in range(sets):
        seed = first + k
        if k % kinds == 0:
            yield Case("another turbine", seed, description=detailed())
        elif k % kinds == 1:
            yield Case("figures at 5 std", seed, beyond=5.0)
        else:
            name = tuple(FAULTS)[k // kinds % len(FAULTS)]
            z = HEIGHTS[k % 4]
            yield Case(name, seed, faults=FAULTS[name](z, k % 2))


@dataclass(slots=True)
class Table:
    """Outcomes of one name, summed up."""

    outcomes: list[Outcome] = field(default_factory=list)
    refused: int = 0

    def row(self) -> dict[str, Any]:
        held = np.array([each.held for each in self.outcomes])
        z = np.array([each.z for each in self.outcomes])
        widths = np.array([each.half_width for each in self.outcomes])
        errors = np.abs([each.error for each in self.outcomes])
        trusted = np.array([each.trusted for each in self.outcomes])
        far = np.abs(z[trusted])
        return {
            "sets": len(held),
            "refused": self.refused,
            "held": held.sum(axis=0).tolist(),
            "held_share": held.mean(axis=0).round(3).tolist(),
            "pooled": round(float(held.mean()), 3),
            "rms_z": np.sqrt((z**2).mean(axis=0)).round(2).tolist(),
            "median_error_percent": np.median(errors, axis=0).round(2).tolist(),
            "half_width_percent": np.median(widths, axis=0).round(1).tolist(),
            "trusted_share": round(float(trusted.mean()), 3),
            "trusted_beyond_2_std": round(float((far > 2).mean()), 3) if far.size else None,
            "trusted_beyond_3_std": round(float((far > 3).mean()), 3) if far.size else None,
            "relative_cost": np.quantile([e.relative_cost for e in self.outcomes], [0.5, 1])
            .round(2)
            .tolist(),
            "seconds": np.quantile([e.seconds for e in self.outcomes], [0.5, 1]).round(2).tolist(),
            "alternatives": dict(Counter(each.alternative for each in self.outcomes)),
            "sign_named": sum(
                any(doubt.startswith("springs-sign") for doubt in each.doubts)
                for each in self.outcomes
            ),
            "sensors_named": sum(each.named for each in self.outcomes),
            "held_or_named": int(sum(all(o.held) or not o.trusted for o in self.outcomes)),
        }


def main(arguments: Sequence[str]) -> None:
    """Print a row for each name; keep them where asked."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks structural_uncertainty")
    parser.add_argument("parts", nargs="+")
    parser.add_argument("--sign", choices=("published", "embedded-pile"), default="published")
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--sets", type=int)
    parser.add_argument("--keep", action="store_true")
    parser.add_argument("--verbose", action="store_true")
    chosen = parser.parse_args(arguments)
    inference = inference_of(chosen.sign)
    for part in chosen.parts:
        tables: dict[str, Table] = {}
        seeds = []
        for case in cases(part, chosen.seeds, chosen.sets):
            table = tables.setdefault(case.name, Table())
            seeds.append(case.seed)
            found = outcome(case, chosen.sign, inference)
            if found is None:
                table.refused += 1
                continue
            table.outcomes.append(found)
            if chosen.verbose:
                print(found, flush=True)
        rows = {name: table.row() for name, table in tables.items() if table.outcomes}
        for name, row in rows.items():
            print(f"{part} {chosen.sign} {name}: {json.dumps(row)}", flush=True)
        if chosen.keep:
            keep(
                f"structural-{part}-{chosen.sign}",
                _summary(rows) | {"rows": rows},
                command=f"python -m tests.benchmarks structural_uncertainty {part} --sign "
                f"{chosen.sign} --seeds {chosen.seeds}"
                + (f" --sets {chosen.sets}" if chosen.sets else ""),
                seeds=seeds,
                depends=DEPENDS,
            )


def _summary(rows: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """Over all rows of a part."""
    sets = sum(row["sets"] for row in rows.values())
    held = np.sum([row["held"] for row in rows.values()], axis=0).tolist()
    widths = np.median([row["half_width_percent"] for row in rows.values()], axis=0).tolist()
    return {
        "sets": sets,
        "refused": sum(row["refused"] for row in rows.values()),
        "pooled": round(sum(held) / (3 * sets), 3),
        **{f"held_{name}": count for name, count in zip(SPRINGS, held, strict=True)},
        **{f"half_{name}": width for name, width in zip(SPRINGS, widths, strict=True)},
        "fewest_held": min(min(row["held"]) for row in rows.values()),
        "trusted": round(sum(row["trusted_share"] * row["sets"] for row in rows.values())),
        "sensors_named": sum(row["sensors_named"] for row in rows.values()),
        "sign_named": sum(row["sign_named"] for row in rows.values()),
        "fewest_named": min(row["sensors_named"] for row in rows.values()),
    }
