"""Short forms of the studies of whole scenarios (`python -m tests.benchmarks scenarios`)."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.scenario import load_scenario
from sensors.simulation.faults import Fault
from tests.benchmarks import scenarios
from tests.benchmarks._sessions import NAMES, SPRINGS, outcome, session

BAD_SENSORS = load_scenario("bad-sensors")


@pytest.mark.nightly
def test_what_is_identified_in_ten_minutes_of_the_papers_example_are_modes_of_the_structure() -> (
    None
):
    """Seed 3, chosen before looking; the full study of twenty seeds found nothing spurious."""
    found = scenarios.found_modes(scenarios.changed(load_scenario("paper")), [3])
    assert found.spurious == 0
    assert {"2", "4", "5", "6", "9", "10"} <= set(found.counts)
    assert found.others > 15


@pytest.mark.nightly
def test_a_session_with_faults_names_each_and_holds_the_truth() -> None:
    """A sound window, a dead channel, and a gap and blocks that come twice. Seed 7."""
    faults = (
        Fault("dead", start=700.0, duration=60.0, channel="z80-ss"),
        Fault("dropped", start=1300.0, duration=4.0),
        Fault("repeated", start=1500.0, duration=10.0),
    )
    simulation = replace(BAD_SENSORS.simulation, duration=1800.0, faults=faults)
    said = session(replace(BAD_SENSORS, seed=7, simulation=simulation))
    assert said.unnamed == ()
    assert said.falsely_rejected == ()
    assert said.n_identified == 2  # the gap of 4 s is filled, and named
    assert said.trusted
    assert np.abs(said.off).max() < 0.05


def summary(codes: list[tuple[float, str]], warnings: list[str]) -> dict[str, object]:
    """As much of a session's summary as the study reads."""
    spring = {"ratio_p05": 0.98, "ratio_median": 1.0, "ratio_p95": 1.01, "truth_ratio": 1.005}
    return {
        "posterior": dict.fromkeys(SPRINGS, spring) | {"trusted": True},
        "windows": {
            "identified": 1,
            "rejected": [{"start": start, "code": code} for start, code in codes],
        },
        "warnings": [{"code": code} for code in warnings],
    }


@pytest.mark.parametrize(
    ("codes", "warnings", "named"),
    [
        ([(1200.0, "constant")], [], True),
        ([(600.0, "constant")], [], False),  # another window's: the fault itself was missed
        ([(1200.0, "gap")], [], False),  # under a wrong name
        ([], ["constant"], False),  # its window must not be used
    ],
)
def test_a_fault_counts_as_named_only_in_its_own_window(
    codes: list[tuple[float, str]], warnings: list[str], named: bool
) -> None:
    fault = Fault("dead", start=1300.0, duration=200.0, channel="z80-ss")
    scenario = replace(BAD_SENSORS, simulation=replace(BAD_SENSORS.simulation, faults=(fault,)))
    said = outcome(scenario, summary(codes, warnings))
    assert (said.unnamed == ()) is named
    assert all(said.covered)


def test_every_kind_of_fault_is_in_the_scenario_and_has_a_name() -> None:
    assert {fault.kind for fault in BAD_SENSORS.simulation.faults} == set(NAMES)
