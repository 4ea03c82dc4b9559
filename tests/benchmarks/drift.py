"""What a converter's drift that the stamps show costs the posterior.

    python -m tests.benchmarks drift [--pairs 20] [--first-seed 9201] [--write]

    one response of the tower ─┬─ converter at its rate           ─► window ─► posterior
                               └─ converter 100 to 2500 ppm off   ─► window ─► posterior
                                                     └─► recorded, replayed: the same bits?

Stamps are right, samples are counted: the drift is that of the count. The springs are those of the
structure that the updater knows, drawn from the seed.

What a shift is made of is measured beside it, on the same response, by what has no drift:

    re-seeded     the same estimates, another seed of the sampler: Monte Carlo
    in between    taken half a sample later: interpolation, and the noise of other instants
    moved         begun as much later as the drift moves the window's end: other seconds at its ends
    taken back    the drifting samples interpolated at the nominal instants: what is left of the
                  drift is the interpolation, twice
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
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.resampling import interpolated
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.simulation.acquisition_units import UnitSettings, read_by_units, unit_layouts
from sensors.simulation.tower import SimulatedTower
from sensors.structure.foundation import TurbineError
from tests.benchmarks._cases import LAYOUT, Case, described, simulated, true_ratios
from tests.benchmarks._results import keep

LEAST_DRIFT, MOST_DRIFT = 100.0, 2500.0  # [ppm]
SPRINGS = ("k11", "k22", "k12")
WINDOW, RATE = 600.0, 40.0  # [s], [Hz]
RESEEDED = 1_000_000  # beside the seed, of another sampler


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
    others: dict[str, FloatArray]
    """(3,) shifts by what is no drift"""
    modes: dict[str, "Moved"]
    """How the estimate differs from that without drift"""


@dataclass(frozen=True, slots=True)
class Moved:
    """How one window's modes differ from another's of the same response."""

    found: int
    """Modes that both have."""
    alone: int
    """Modes that one of them has."""
    frequency: float
    """Median difference of the frequencies [standard deviations]."""


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


def measured(seed: int, drift: float, start: float = 0.0) -> list[Message]:
    """Layout and blocks of one window, taken by a converter that is so much off [ppm].

    start   of its first sample after the tower's [s]
    """
    tower = simulated(Case(seed, 1, structure="exact"))
    heights = tuple(sorted({each.elevation for each in LAYOUT.channels}))
    unit = UnitSettings(LAYOUT.unit, heights, start=start, clock_drift=drift)
    settings = replace(tower.settings, duration=tower.settings.duration + 5.0)
    (layout,) = unit_layouts(LAYOUT, (unit,))
    blocks = SimulatedTower(described("published"), LAYOUT, settings)
    return [layout, *read_by_units(blocks, LAYOUT, (unit,))]


def taken_back(messages: Sequence[Message], drift: float) -> list[Message]:
    """Blocks of a converter that is so much off [ppm], as one without drift takes them."""
    blocks = [each for each in messages if isinstance(each, AccelerationBlock)]
    samples = np.concatenate([each.samples for each in blocks]).astype(np.float64)
    size, rate = len(blocks[0].samples), blocks[0].sampling_rate
    positions = np.arange(len(samples), dtype=np.float64) * (1 + 1e-6 * drift)
    whole = int((positions <= len(samples) - 1).sum()) // size * size
    even = (
        interpolated(samples, positions[:whole])
        .astype(np.float32)
        .reshape(-1, size, samples.shape[1])
    )
    start_ns = blocks[0].start_ns
    return [
        *(each for each in messages if not isinstance(each, AccelerationBlock)),
        *(
            replace(
                block, samples=own, start_ns=start_ns + round(number * size / rate * NANOSECONDS)
            )
            for number, (block, own) in enumerate(zip(blocks, even, strict=False))
        ),
    ]


def moved(before: Sequence[ModalEstimate], after: Sequence[ModalEstimate]) -> Moved:
    """How the modes of one window differ from those of another; nearest frequencies are the same
    mode where they lie within ten standard deviations."""
    one, other = before[0].modes, after[0].modes
    apart = []
    for mode in one:
        near = min(other, key=lambda each: abs(each.frequency - mode.frequency))
        apart.append(abs(near.frequency - mode.frequency) / mode.frequency_std)
    same = [each for each in apart if each < 10]
    found = len(same)
    return Moved(found, len(one) + len(other) - 2 * found, float(np.median(same)))


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
    estimates = estimates_of(measured(seed, 0.0))
    plain = posterior_of(estimates, seed)
    blocks = measured(seed, drift)
    live = estimates_of(blocks)
    again = estimates_of(replayed(blocks))
    drifting = posterior_of(live, seed)
    same = [encode(each) for each in live] == [encode(each) for each in again]
    same = same and encode(drifting) == encode(posterior_of(again, seed))
    truth = true_ratios(seed) * described("published").nominal
    others, found = {}, {"drift": moved(estimates, live)}
    others["re-seeded"] = shift(plain, posterior_of(estimates, seed + RESEEDED))
    late = round(1e-6 * abs(drift) * WINDOW * RATE) / RATE
    again_measured = {
        "in between": measured(seed, 0.0, start=0.5 / RATE),
        "moved": measured(seed, 0.0, start=late),
        "taken back": taken_back(blocks, drift),
    }
    for name, messages in again_measured.items():
        other = estimates_of(messages)
        others[name], found[name] = shift(plain, posterior_of(other, seed)), moved(estimates, other)
    return Pair(
        seed,
        drift,
        shift(plain, drifting),
        _held(drifting.draws[:, :3], truth),
        _held(plain.draws[:, :3], truth),
        same,
        others,
        found,
    )


def shift(before: FoundationPosterior, after: FoundationPosterior) -> FloatArray:
    """(3,) of the springs' medians, in standard deviations of the first."""
    one, other = before.draws[:, :3], after.draws[:, :3]
    return np.asarray((np.median(other, axis=0) - np.median(one, axis=0)) / one.std(axis=0))


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
        **{
            f"median |shift| {name} [std]": dict(
                zip(
                    SPRINGS,
                    np.median([abs(p.others[name]) for p in pairs], axis=0).round(4).tolist(),
                    strict=True,
                )
            )
            for name in pairs[0].others
        },
        **{
            f"modes {name}": {
                "in both": sum(p.modes[name].found for p in pairs),
                "in one": sum(p.modes[name].alone for p in pairs),
                "median |shift| of f [std]": round(
                    float(np.median([p.modes[name].frequency for p in pairs])), 4
                ),
            }
            for name in pairs[0].modes
        },
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
        for name, each in last.others.items():
            print(f"    {name:11s} {each.round(3)}", flush=True)
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
