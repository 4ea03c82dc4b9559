"""Whole sessions of `storm-scour`: one event each, and does its size hold?

    python -m tests.benchmarks storm_scour [--seeds 101000 101001 ...] [--keep]

The scenario as it is shipped: twelve hours simulated, identified and updated, with a tenth of k22
lost at hour 6, at the height of the storm. To save time there is a posterior of every window only
about the change and of every twelfth otherwise; every window enters evidence and detectors. First:
the size in the event's message; revised: k22 over that before the event in the last posterior.
A result is kept after every session; sessions that are kept already are not run again.
"""

import argparse
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from pipeline.messages import FoundationEvent, FoundationPosterior, ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.operating_state import usable_estimate
from pipeline.runtime.source_feed import with_end
from pipeline.scenario import Scenario, load_scenario
from pipeline.sources.sources import simulated
from pipeline.updating.structural.inference import joint_inference
from pipeline.updating.updater import FoundationUpdater
from sensors.arrays import one_blas_thread
from sensors.dynamics.modal_model import ModalModel
from tests.benchmarks._results import is_old, keep, kept

SEEDS = tuple(range(101000, 101010))
CHANGE = 36  # the first window after it
TRUE_RATIO = 0.9  # of k22 after it
EVERY = 12  # windows to a posterior, far from the change
DEPENDS = ["pipeline/updating", "pipeline/oma", "sensors", "pipeline/scenarios/storm-scour.toml"]


@dataclass(frozen=True, slots=True)
class Outcome:
    """What one session reports."""

    seed: int
    events: tuple[int, ...]
    """Windows in which they were noticed."""
    first: tuple[float, float, float] | None
    """Ratio of k22 in the first event's message: median, 5 % and 95 % quantiles."""
    revised: tuple[float, float, float] | None
    """The same in the last posterior."""

    @property
    def one_event(self) -> bool:
        """The change and nothing else."""
        return len(self.events) == 1 and self.events[0] >= CHANGE


def identified(scenario: Scenario) -> Iterator[ModalEstimate]:
    """The windows of the scenario's simulation."""
    source = simulated(scenario)
    node = IdentificationNode(scenario.oma, limits=scenario.limits)
    with one_blas_thread():
        for message in with_end(source.messages()):
            if type(message) in node.inputs:
                yield from (e for e in node.handle(message) if isinstance(e, ModalEstimate))


def session(scenario: Scenario, estimates: Iterator[ModalEstimate]) -> Outcome:
    """Update a turbine with the estimates."""
    layout, settings = scenario.layout, scenario.updating
    joint = joint_inference(scenario.structure, layout, settings, seed=scenario.seed)
    model = ModalModel(scenario.structure, layout)
    updater = FoundationUpdater(model, layout, settings, seed=scenario.seed, joint=joint)
    state, last = updater.initial_state(), None
    events: list[FoundationEvent] = []
    for each in estimates:
        estimate = usable_estimate(each, scenario.operation, layout)
        if not isinstance(estimate, ModalEstimate):
            continue
        answers: Sequence[Any]
        if abs(estimate.window - CHANGE) <= EVERY // 2 or estimate.window % EVERY == EVERY - 1:
            state, answers = updater.watched(state, estimate)
        else:
            state, event = updater.accumulated(state, estimate)
            answers = (event,)
        events += [each for each in answers if isinstance(each, FoundationEvent)]
        last = next((a for a in answers if isinstance(a, FoundationPosterior)), last)
    return Outcome(
        scenario.seed,
        tuple(event.window for event in events),
        _k22(events[0].changes, 1.0) if events else None,
        _k22(last.relative, 0.0) if last is not None else None,
    )


def _k22(changes: Sequence[Any], before: float) -> tuple[float, float, float] | None:
    """The ratio now to before; a message of an event has the change, less one."""
    found = next((each for each in changes if each.name == "k22"), None)
    if found is None:
        return None
    return (before + found.median, before + found.p05, before + found.p95)


def row(outcomes: Sequence[Outcome]) -> dict[str, Any]:
    """The figures of all sessions."""
    revised = [each.revised for each in outcomes if each.revised is not None]
    first = [each.first for each in outcomes if each.first is not None]
    return {
        "sessions": len(outcomes),
        "one_event_each": sum(each.one_event for each in outcomes),
        "revised_holds": sum(low <= TRUE_RATIO <= high for _, low, high in revised),
        "first_holds": sum(low <= TRUE_RATIO <= high for _, low, high in first),
        "revised_percent": [round(100 * (1 - median), 1) for median, *_ in revised],
        "half_width_percent": _median([50 * (high - low) for _, low, high in revised]),
    }


def _median(values: Sequence[float]) -> float | None:
    return round(float(np.median(values)), 2) if values else None


def main(arguments: Sequence[str]) -> None:
    """Print a line each session."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks storm_scour")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(SEEDS))
    parser.add_argument("--keep", action="store_true", help="write results/storm-scour.json")
    chosen = parser.parse_args(arguments)
    known = kept("storm-scour") if chosen.keep else None
    if known is None or is_old(known):  # sessions of another code do not stand beside these
        outcomes = []
    else:
        outcomes = [Outcome(**each) for each in known["figures"]["outcomes"]]
    for seed in chosen.seeds:
        if seed in {each.seed for each in outcomes}:
            continue
        scenario = replace(load_scenario("storm-scour"), seed=seed)
        outcomes.append(session(scenario, identified(scenario)))
        print(outcomes[-1], flush=True)
        if chosen.keep:
            keep(
                "storm-scour",
                row(outcomes) | {"outcomes": [asdict(each) for each in outcomes]},
                command="python -m tests.benchmarks storm_scour --seeds "
                + " ".join(str(each.seed) for each in outcomes),
                seeds=[each.seed for each in outcomes],
                depends=DEPENDS,
            )
    print(row(outcomes))
