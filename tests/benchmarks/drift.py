"""What a converter's drift that the stamps show costs the posterior.

    python -m tests.benchmarks drift [--pairs 20] [--first-seed 9201] [--write]

    one response of the tower ─┬─ converter at its rate           ─► window ─► posterior
                               └─ converter 100 to 2500 ppm off   ─► window ─► posterior
                                                     └─► recorded, replayed: the same bits?

Stamps are right, samples are counted: the drift is that of the count. The springs are those of the
structure that the updater knows, drawn from the seed.
"""

import argparse
import json
import time
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import count, islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from pipeline.messages import FoundationPosterior, Message, ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.writer import Recorder
from pipeline.runtime.source_feed import with_end
from pipeline.sources.recorded_stream import recorded_stream
from pipeline.transport.codec import encode
from pipeline.updating.forward_model import ForwardModel
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.structural.settings import StructureSettings
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.simulation.acquisition_units import UnitSettings, read_by_units, unit_layouts
from sensors.simulation.tower import SimulatedTower
from sensors.structure.foundation import TurbineError
from tests.benchmarks._cases import LAYOUT, Case, described, simulated, true_ratios
from tests.benchmarks._results import keep

LEAST_DRIFT, MOST_DRIFT = 100.0, 2500.0  # [ppm]
SPRINGS = ("k11", "k22", "k12")


@dataclass(frozen=True, slots=True, eq=False)
class Pair:
    """One response of the tower by a converter without drift and with it."""

    seed: int
    drift: float
    """[ppm]"""
    shifts: FloatArray
    """(3,) of the springs' medians by the drift, in standard deviations without it [-]"""
    held: tuple[bool, ...]
    """(3,) whether the 90 % interval with drift holds the truth"""
    held_without: tuple[bool, ...]
    """(3,) the same without drift"""
    replayed: bool
    """Whether the recording gives the estimates and the posterior of the live blocks bit by bit"""


def drift_of(seed: int) -> float:
    """A drift [ppm] of either sign, its size even in logarithm."""
    generator = np.random.default_rng([seed, 17])
    size = np.exp(generator.uniform(np.log(LEAST_DRIFT), np.log(MOST_DRIFT)))
    return float(size * generator.choice([-1.0, 1.0]))


def stands(seed: int) -> bool:
    """Whether the tower on the seed's springs stands."""
    try:
        simulated(Case(seed, 1, structure="exact"))
    except TurbineError:
        return False
    return True


def measured(seed: int, drift: float) -> list[Message]:
    """Layout and blocks of one window, taken by a converter that is so much off [ppm]."""
    tower = simulated(Case(seed, 1, structure="exact"))
    heights = tuple(sorted({each.elevation for each in LAYOUT.channels}))
    unit = UnitSettings(LAYOUT.unit, heights, clock_drift=drift)
    settings = replace(tower.settings, duration=tower.settings.duration + 5.0)
    (layout,) = unit_layouts(LAYOUT, (unit,))
    blocks = SimulatedTower(described("published"), LAYOUT, settings)
    return [layout, *read_by_units(blocks, LAYOUT, (unit,))]


def estimates_of(messages: Iterable[Message]) -> list[ModalEstimate]:
    """What the identification answers."""
    node = IdentificationNode()
    said = [answer for message in with_end(messages) for answer in node.handle(message)]
    return [each for each in said if isinstance(each, ModalEstimate)]


def posterior_of(estimates: Sequence[ModalEstimate], seed: int) -> FoundationPosterior:
    """The posterior after them, the structure known."""
    structure, layout = described("published"), LAYOUT
    settings = UpdatingSettings(structure=StructureSettings(exact=True))
    updater = FoundationUpdater(_forward(structure, layout), layout, settings, seed=seed)
    state, answer = updater.initial_state(), None
    for estimate in estimates:
        state, answer = updater.updated(state, estimate)
    if not isinstance(answer, FoundationPosterior):
        raise ValueError(f"seed {seed}: {answer}")
    return answer


def _forward(structure: Any, layout: SensorLayout) -> ForwardModel:
    return ModalModel(structure, layout)


def replayed(messages: Iterable[Message]) -> list[Message]:
    """The same, recorded and read again."""
    with TemporaryDirectory() as folder:
        path = Path(folder) / "drift.mcap"
        recorder = Recorder(path, metadata={}, clock=None)
        for message in messages:
            recorder.handle(message)
        recorder.close()
        return list(recorded_stream(path))


def pair(seed: int) -> Pair:
    """Both converters of one seed."""
    drift = drift_of(seed)
    plain = posterior_of(estimates_of(measured(seed, 0.0)), seed)
    blocks = measured(seed, drift)
    live = estimates_of(blocks)
    again = estimates_of(replayed(blocks))
    drifting = posterior_of(live, seed)
    same = [encode(each) for each in live] == [encode(each) for each in again]
    same = same and encode(drifting) == encode(posterior_of(again, seed))
    truth = true_ratios(seed) * described("published").nominal
    before, after = plain.draws[:, :3], drifting.draws[:, :3]
    shifts = (np.median(after, axis=0) - np.median(before, axis=0)) / before.std(axis=0)
    return Pair(seed, drift, shifts, _held(after, truth), _held(before, truth), same)


def _held(draws: FloatArray, truth: FloatArray) -> tuple[bool, ...]:
    low, high = np.quantile(draws, [0.05, 0.95], axis=0)
    return tuple(bool(each) for each in (low <= truth) & (truth <= high))


def figures(pairs: Sequence[Pair]) -> dict[str, Any]:
    """What is reported of them."""
    shifts = np.array([each.shifts for each in pairs])
    return {
        "pairs": len(pairs),
        "drift [ppm]": [round(each.drift, 1) for each in pairs],
        "median |shift| of k [std]": dict(
            zip(SPRINGS, np.median(np.abs(shifts), axis=0).round(4).tolist(), strict=True)
        ),
        "median shift of k [std]": dict(
            zip(SPRINGS, np.median(shifts, axis=0).round(4).tolist(), strict=True)
        ),
        "largest |shift| [std]": round(float(np.abs(shifts).max()), 4),
        "90 % intervals that hold": f"{sum(map(sum, (p.held for p in pairs)))} of {3 * len(pairs)}",
        "the same without drift": (
            f"{sum(map(sum, (p.held_without for p in pairs)))} of {3 * len(pairs)}"
        ),
        "live = replay, bit by bit": f"{sum(p.replayed for p in pairs)} of {len(pairs)}",
    }


def main(arguments: list[str]) -> None:
    """Run the pairs and print what came out."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks drift")
    parser.add_argument("--pairs", type=int, default=20)
    parser.add_argument("--first-seed", type=int, default=9201)
    parser.add_argument("--write", action="store_true")
    chosen = parser.parse_args(arguments)
    seeds = list(islice(filter(stands, count(chosen.first_seed)), chosen.pairs))
    pairs, started = [], time.process_time()
    for seed in seeds:
        pairs.append(pair(seed))
        last = pairs[-1]
        print(f"{seed}: {last.drift:+7.0f} ppm, shifts {last.shifts.round(3)}, {last.held}")
    found = figures(pairs)
    print(json.dumps(found, indent=1, ensure_ascii=False))
    print(f"{time.process_time() - started:.0f} s of CPU time")
    if chosen.write:
        command = f"python -m tests.benchmarks drift --pairs {chosen.pairs} "
        keep(
            "drift",
            found,
            command=f"{command}--first-seed {chosen.first_seed} --write",
            seeds=seeds,
            depends=["pipeline/oma", "pipeline/updating", "pipeline/nodes"],
        )
