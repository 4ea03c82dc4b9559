"""Windows of which nothing reports the turbine's state: which ones are kept from the posterior.

    python -m tests.benchmarks unreported_states [--first-seed 280001] [--records 3] [--keep]

Every seed simulates the scenario `operating` (parked, a start, 80 minutes of operation in 9 m/s, a
stop, idling: 24 windows), `tide` for two hours, `parked` and `bad-sensors`, and six times `paper`,
without SCADA: the blocks alone go through the identification, and each estimate through what the
updating refuses. Modes are sought up to 1 Hz only, which saves most of the time.

refused     of the estimates, by what the turbine truly did and by the code
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import replace

from pipeline.messages import ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.operating_state import usable_estimate
from pipeline.scenario.loading import load_scenario
from pipeline.scenario.settings import Scenario
from pipeline.sources.sources import simulated_tower
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.benchmarks._seeded import report, seeded_options, seeds_of

SHOWN = ("turning-rotor", "non-stationary")  # codes of a state that a window shows
DURATIONS = {"operating": 14_400.0, "tide": 7_200.0, "parked": 3_600.0, "bad-sensors": 12_000.0}
HIGHEST = 1.0  # of the modes sought [Hz]: what is judged here does not depend on them
PAPERS = 6  # seeds of `paper`, of one window each, for one of the others


def scenarios(seed: int) -> Iterator[Scenario]:
    """Every scenario of a seed."""
    for name, duration in DURATIONS.items():
        yield _of(name, seed, duration)
    for number in range(PAPERS):
        yield _of("paper", PAPERS * seed + number, 600.0)


def _of(name: str, seed: int, duration: float) -> Scenario:
    scenario = load_scenario(name)
    return replace(scenario, seed=seed, simulation=replace(scenario.simulation, duration=duration))


def estimates(scenario: Scenario) -> Iterator[tuple[str, ModalEstimate]]:
    """What the turbine did in a window, and its estimate from the blocks alone."""
    tower = simulated_tower(scenario)
    node = IdentificationNode(replace(scenario.oma, highest_frequency=HIGHEST))
    answers = list(node.handle(scenario.layout))
    for message in tower.messages():
        if isinstance(message, AccelerationBlock):
            answers += node.handle(message)
    start_ns = scenario.simulation.start_ns
    for answer in answers:
        if isinstance(answer, ModalEstimate):
            begin, end = (
                (each - start_ns) / NANOSECONDS for each in (answer.start_ns, answer.end_ns)
            )
            states = {tower.schedule.state(begin + 1), tower.schedule.state(end - 1)}
            yield states.pop() if len(states) == 1 else "start or stop", answer


def main(arguments: list[str]) -> None:
    """Print the figures, and keep them where asked."""
    options = seeded_options("unreported_states", first_seed=280_001, records=3).parse_args(
        arguments
    )
    windows: Counter[str] = Counter()
    refused: Counter[str] = Counter()
    codes: Counter[str] = Counter()
    for seed in seeds_of(options):
        for scenario in scenarios(seed):
            for state, estimate in estimates(scenario):
                usable = usable_estimate(estimate, scenario.operation, scenario.layout)
                windows[state] += 1
                if isinstance(usable, WindowRejected):
                    codes[f"{state}: {usable.code}"] += 1
                    refused[state] += usable.code in SHOWN
            print(seed, scenario.name, dict(windows), dict(codes), flush=True)
    figures = {
        state.replace(" ", "_"): {"windows": count, "refused": refused[state]}
        for state, count in sorted(windows.items())
    }
    report(
        "unreported_states",
        figures | {"codes": dict(codes)},
        options,
        seeds=seeds_of(options),
        depends="pipeline/oma/data_quality",
    )
