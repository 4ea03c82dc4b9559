"""Whole sessions of a scenario over seeds: do the last intervals hold the truth, is every fault
named?"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from pipeline.app import Outputs, build
from pipeline.monitoring.summary import SessionSummary
from pipeline.runtime.lock_step import run_lock_step
from pipeline.scenario import Scenario, load_scenario
from pipeline.sources.sources import simulated
from sensors.simulation.faults import Fault

SPRINGS = ("k11", "k22", "k12")

# What a session calls each kind of fault: a window's reason or a warning, which is also what
# states a repair.
FILLED = {"dropped": "missing", "nan": "missing"}  # up to 5 % of a window cost no window
NAMES = {
    "dead": "constant",
    "stuck": "constant",
    "clipped": "clipped",
    "swapped": "swapped-channels",
    "duplicate": "duplicate-channel",
    "nan": "nan",
    "spikes": "spikes",
    "drift": "drift",
    "faulty": "sensor-fault",
    "dropped": "gap",
    "late": "late",
    "repeated": "repeated",
    "out-of-order": "out-of-order",
    "clock-drift": "clock-drift",
    "clock-jitter": "clock-jitter",
    "unsynchronised": "unsynchronised-clock",
}
REJECTING = ("constant", "nan", "gap", "sensor-fault", "swapped-channels", "duplicate-channel")


@dataclass(frozen=True, slots=True)
class SessionOutcome:
    """What one session said in the end."""

    seed: int
    covered: tuple[bool, ...]  # truth inside the 90 % interval, by SPRINGS
    off: tuple[float, ...]  # median over truth, less one, by SPRINGS [-]
    trusted: bool
    n_identified: int
    unnamed: tuple[Fault, ...]  # faults that nothing was said of
    falsely_rejected: tuple[str, ...]  # windows without a fault that were rejected


def session(scenario: Scenario) -> SessionOutcome:
    """Run the scenario's simulation to its end, in lock-step."""
    source = simulated(scenario)
    summary = SessionSummary(source=source.text, turbine=source.layout.turbine)
    nodes = [plan.make() for plan in build(source.scenario, source.layout, Outputs())]
    run_lock_step(
        source.messages(),
        [*nodes, summary],
        turbine=source.layout.turbine,
        report=summary.run.fold,
    )
    return outcome(scenario, summary.as_json(wall=1.0))


def outcome(scenario: Scenario, said: dict[str, Any]) -> SessionOutcome:
    """The outcome from a session's summary."""
    posterior = said["posterior"]
    springs = [posterior[name] for name in SPRINGS]
    rejected, faults = said["windows"]["rejected"], scenario.simulation.faults
    warned = {warning["code"] for warning in said["warnings"]}
    window = scenario.oma.window_duration
    return SessionOutcome(
        seed=scenario.seed,
        covered=tuple(
            k["ratio_p05"] is not None and k["ratio_p05"] <= k["truth_ratio"] <= k["ratio_p95"]
            for k in springs
        ),
        off=tuple(
            float("nan") if k["ratio_median"] is None else k["ratio_median"] / k["truth_ratio"] - 1
            for k in springs
        ),
        trusted=bool(posterior["trusted"]),
        n_identified=said["windows"]["identified"],
        unnamed=tuple(f for f in faults if not _is_named(f, rejected, warned, window)),
        falsely_rejected=tuple(
            f"{each['code']} at {each['start']:.0f} s"
            for each in rejected
            if not any(f.start < each["start"] + window and f.end > each["start"] for f in faults)
        ),
    )


def _is_named(
    fault: Fault, rejected: Sequence[dict[str, Any]], warned: set[str], window: float
) -> bool:
    """Whether a window of the fault's time was rejected under its name, or a warning has it."""
    name = NAMES[fault.kind]
    here = [r for r in rejected if fault.start < r["start"] + window and fault.end > r["start"]]
    if any(each["code"] == name for each in here) or FILLED.get(fault.kind) in warned:
        return True
    return name not in REJECTING and name in warned


def print_sessions(names: Sequence[str], seeds: Sequence[int]) -> None:
    """One line a session, and how many hold the truth."""
    for name in names:
        outcomes = []
        for seed in seeds:
            outcomes.append(session(replace(load_scenario(name), seed=seed)))
            print(line(outcomes[-1]), flush=True)
        print(f"{name}: of {len(outcomes)} sessions, seeds {seeds[0]} to {seeds[-1]}:")
        for number, spring in enumerate(SPRINGS):
            held = sum(each.covered[number] for each in outcomes)
            print(f"  {spring}: {held} intervals of 90 % hold the truth")
        print(f"  trusted: {sum(each.trusted for each in outcomes)}")
        print(f"  every fault named: {sum(not each.unnamed for each in outcomes)}")


def line(outcome: SessionOutcome) -> str:
    """A session in a line."""
    springs = "  ".join(
        f"{name} {100 * off:+5.2f} % {'in' if inside else 'OUT'}"
        for name, off, inside in zip(SPRINGS, outcome.off, outcome.covered, strict=True)
    )
    doubts = [f"not named: {fault.kind} at {fault.start:g} s" for fault in outcome.unnamed]
    doubts += [f"rejected without a fault: {each}" for each in outcome.falsely_rejected]
    trusted = "" if outcome.trusted else " not trusted"
    return f"seed {outcome.seed}: {outcome.n_identified} windows{trusted}  {springs}  " + "; ".join(
        doubts
    )
