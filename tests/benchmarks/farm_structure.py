"""Farms whose description is wrong: do pooled intervals hold?

    python -m tests.benchmarks farm_structure [--turbines 5 20] [--farms 40 10] [--common 1 0.5]
        [--seeds FIRST] [--keep]

A farm: springs that spread by 3 % about a centre uniform in .85 to 1.2 of nominal; every figure of
the structure drawn from its prior, a share `common` of its variance the same in all turbines; modal
data of six windows by tests.outside, its own elements, blades reduced or converged in turn, the
level known to .1 m. Each turbine has the product's posterior, then the farm is pooled.

alone     each turbine's own 90 % interval; pooled: with the others' help
blind     pooled as if the description's errors were each turbine's own
further   one more turbine of the farm with one window, without and with the farm's prior
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from pipeline.farm.farm import Farm, PoolingSettings, pooled_farm
from pipeline.farm.settings import GibbsSettings
from pipeline.messages import FoundationPosterior
from pipeline.updating.structural.alternatives import JointInference
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks._results import keep
from tests.benchmarks.first_weeks import SETTINGS
from tests.outside.figures import HALF_NORMAL, SPREADS, Figures
from tests.outside.modal_data import LAYOUT, Truth, estimates
from tests.outside.model import NOMINAL, averaged, converged

FIRST_SEED = 104000
SPREAD = 0.03  # of ln k over a farm [-]
WINDOWS = 6
POOLING = PoolingSettings(gibbs=GibbsSettings(burn_in=80, sweeps=150, rounds=1))
TURBINE = load_turbine("iea15mw_monopile")


@dataclass(slots=True, eq=False)
class Held:
    """Intervals beside the truth, over turbines."""

    held: list[FloatArray] = field(default_factory=list)
    z: list[FloatArray] = field(default_factory=list)
    half_width: list[FloatArray] = field(default_factory=list)
    error: list[FloatArray] = field(default_factory=list)

    def add(self, low: FloatArray, median: FloatArray, high: FloatArray, truth: FloatArray) -> None:
        """One or more turbines, (..., 3) ratios to nominal."""
        std = (np.log(high) - np.log(low)) / (2 * 1.6449)
        self.held.append(np.atleast_2d((low <= truth) & (truth <= high)))
        self.z.append(np.atleast_2d((np.log(median) - np.log(truth)) / std))
        self.half_width.append(np.atleast_2d((high - low) / 2 / median))
        self.error.append(np.atleast_2d(np.abs(median / truth - 1)))

    def row(self) -> dict[str, Any]:
        """The figures of all."""
        held, z, width, error = (
            np.concatenate(each) for each in (self.held, self.z, self.half_width, self.error)
        )
        return {
            "turbines": len(held),
            "held": held.mean(axis=0).round(3).tolist(),
            "rms_z": np.sqrt((z**2).mean(axis=0)).round(2).tolist(),
            "half_width_percent": (100 * np.median(width, axis=0)).round(1).tolist(),
            "error_percent": (100 * np.median(error, axis=0)).round(1).tolist(),
        }


def main(arguments: Sequence[str]) -> None:
    """Print a table for each size and share."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks farm_structure")
    parser.add_argument("--turbines", type=int, nargs="+", default=[5, 20])
    parser.add_argument("--farms", type=int, nargs="+", default=[40, 10])
    parser.add_argument("--common", type=float, nargs="+", default=[1.0, 0.5])
    parser.add_argument("--seeds", type=int, default=FIRST_SEED)
    parser.add_argument("--keep", action="store_true")
    chosen = parser.parse_args(arguments)
    rows: list[dict[str, Any]] = []
    seeds: list[int] = []
    for turbines, farms in zip(chosen.turbines, chosen.farms, strict=True):
        for common in chosen.common:
            own = range(chosen.seeds + 1000 * len(rows), chosen.seeds + 1000 * len(rows) + farms)
            rows.append(measured(turbines, common, own))
            seeds += own
    if chosen.keep:
        command = "python -m tests.benchmarks farm_structure " + " ".join(arguments)
        depends = ["pipeline/farm", "pipeline/updating", "sensors/dynamics", "tests/outside"]
        figures = _flat(rows) | {"farms": rows}
        keep("farm-structure", figures, command=command, seeds=seeds, depends=depends)


def _flat(rows: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """What the documentation quotes, of fully common errors: "pooled_5_k11", … [%]."""
    return {
        f"{name}_{row['turbines']}_{spring}": round(100 * held)
        for row in rows
        if row["common"] == 1.0
        for name in ("alone", "blind", "pooled")
        for spring, held in zip(("k11", "k22", "k12"), row[name]["held"], strict=True)
    }


def measured(turbines: int, common: float, seeds: Sequence[int]) -> dict[str, Any]:
    """Farms of one size and share of common errors."""
    inference = joint_inference(TURBINE, LAYOUT, SETTINGS, seed=1)
    assert inference is not None
    model = ModalModel(TURBINE, LAYOUT)
    tables = {name: Held() for name in ("alone", "blind", "pooled", "further", "further_pooled")}
    for seed in seeds:
        _one_farm(tables, model, inference, turbines=turbines, common=common, seed=seed)
    rows = {name: table.row() for name, table in tables.items()}
    for name, row in rows.items():
        print(turbines, f"{common:g}", name, row, flush=True)
    return {"turbines": turbines, "common": common, "farms": len(seeds), **rows}


def _one_farm(
    tables: dict[str, Held],
    model: ModalModel,
    inference: JointInference,
    *,
    turbines: int,
    common: float,
    seed: int,
) -> None:
    rng = np.random.default_rng(seed)
    truths = drawn_farm(rng, turbines + 1, common, converged() if seed % 2 else averaged())
    posteriors = [
        posterior(f"t{n + 1}", truth, model, inference, WINDOWS, rng)
        for n, truth in enumerate(truths[:-1])
    ]
    known = [(p, t) for p, t in zip(posteriors, truths, strict=False) if p is not None]
    members = [p for p, _ in known if p.trusted]
    ratios = np.array([t.theta / NOMINAL for p, t in known if p.trusted])
    tables["alone"].add(*_intervals([each.parameters[:3] for each in members]), ratios)
    unaware = [replace(each, figure_errors=()) for each in members]
    farms: dict[str, Farm] = {}
    for name, each in (("blind", unaware), ("pooled", members)):
        farms[name] = pooled_farm(each, POOLING)
        tables[name].add(*_intervals([t.pooled for t in farms[name].turbines]), ratios)
    helped = joint_inference(
        TURBINE, LAYOUT, SETTINGS, seed=1, population=farms["pooled"].population
    )
    assert helped is not None
    state = rng.bit_generator.state
    for name, own in (("further", inference), ("further_pooled", helped)):
        rng.bit_generator.state = state  # the same window
        found = posterior("further", truths[-1], model, own, 1, rng)
        if found is not None:
            low, median, high = _intervals([found.parameters[:3]])
            tables[name].add(low, median, high, truths[-1].theta / NOMINAL)


def drawn_farm(rng: np.random.Generator, n: int, common: float, description: Any) -> list[Truth]:
    """Truths whose figures have a share of their variance in common."""
    centre = rng.uniform(0.85, 1.2, 3)
    while centre[0] * centre[1] * NOMINAL[0] * NOMINAL[1] < 1.3 * (centre[2] * NOMINAL[2]) ** 2:
        centre = rng.uniform(0.85, 1.2, 3)
    shared, truths = rng.standard_normal(len(SPREADS)), []
    for _ in range(n):
        own = rng.standard_normal(len(SPREADS))
        theta = NOMINAL * centre * np.exp(SPREAD * rng.standard_normal(3))
        figures = _figures(np.sqrt(common) * shared + np.sqrt(1 - common) * own)
        truths.append(Truth(theta, figures, "published", description))
    return truths


def _figures(z: FloatArray) -> Figures:
    """Of departures in prior standard deviations, in the order of SPREADS."""
    departures = {
        name: abs(spread * each) if name in HALF_NORMAL else spread * each
        for (name, spread), each in zip(SPREADS.items(), z.tolist(), strict=True)
    }
    nominal = Figures()
    return replace(nominal, **{k: getattr(nominal, k) + v for k, v in departures.items()})


def posterior(
    turbine: str,
    truth: Truth,
    model: ModalModel,
    inference: JointInference,
    windows: int,
    rng: np.random.Generator,
) -> FoundationPosterior | None:
    """The product's after some windows; None where it has none."""
    updater = FoundationUpdater(model, LAYOUT, SETTINGS, seed=1, joint=inference)
    state = updater.initial_state()
    *earlier, last = estimates(truth, windows, rng, reported_levels=[0.0] * windows)
    for estimate in earlier:
        state, _ = updater.accumulated(state, estimate)
    _, answer = updater.updated(state, last)
    return replace(answer, turbine=turbine) if isinstance(answer, FoundationPosterior) else None


def _intervals(springs: Sequence[Any]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """5 % quantiles, medians, 95 % quantiles over nominal, (n, 3) each."""
    table = np.array(
        [[(k.p05 / k.nominal, k.median / k.nominal, k.p95 / k.nominal) for k in s] for s in springs]
    )
    return table[..., 0], table[..., 1], table[..., 2]
