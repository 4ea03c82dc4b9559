"""One window of every turbine of a recorded farm: what it costs, and what pooling makes of it.

blocks ─► decoding ─► identification ─► updating ─► recording      one thread, CPU by step
"""

import tempfile
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from pipeline.app import Outputs, build
from pipeline.farm.farm import Farm, pooled_farm
from pipeline.farm.settings import FarmError
from pipeline.messages import FoundationPosterior, FoundationTruth, Message, ModalEstimate
from pipeline.nodes.node import Node
from pipeline.recording.reader import decoded, read_messages, recorded_messages
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.scenario import Scenario
from pipeline.sources.sources import replayed
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray, one_blas_thread
from tests.benchmarks._drawn import PAPERS_MODES

WINDOW = 600.0  # [s]
STEPS = ("decode blocks", "collect samples", "identify", "update", "encode and record")


@dataclass(slots=True, eq=False)
class Costs:
    """CPU seconds by step, over `windows` windows."""

    seconds: defaultdict[str, float] = field(default_factory=lambda: defaultdict(float))
    windows: int = 0

    @contextmanager
    def of(self, step: str) -> Iterator[None]:
        """Counts what is done inside."""
        began = time.process_time()
        yield
        self.seconds[step] += time.process_time() - began

    def a_window(self, step: str) -> float:
        """[s]"""
        return self.seconds[step] / self.windows


def first_windows(recording: Path, turbines: Sequence[str], costs: Costs) -> list[ModalEstimate]:
    """The first window of each of these turbines, identified."""
    source = replayed(recording)
    graph = build(source.scenario, source.layout, Outputs(), source.layouts)
    (node,) = (plan.make() for plan in graph if plan.name == "identification")
    for layout in source.layouts.values():
        list(node.handle(layout))
    found: dict[str, ModalEstimate] = {}
    wanted = set(turbines)
    for each in recorded_messages(recording):
        if each.message_type is not AccelerationBlock or each.key.split("/")[1] not in wanted:
            continue
        with costs.of("decode blocks"):
            block = decoded(recording, each)
        answers = _handled(node, block, costs)
        for answer in answers:
            if isinstance(answer, ModalEstimate):
                found[answer.turbine] = answer
                wanted.discard(answer.turbine)
        if not wanted:
            break
    return [found[name] for name in turbines]


def _handled(node: Node, block: Message, costs: Costs) -> list[Message]:
    began = time.process_time()
    answers = list(node.handle(block))
    spent = time.process_time() - began
    identified = any(isinstance(each, ModalEstimate) for each in answers)
    costs.seconds["identify" if identified else "collect samples"] += spent
    costs.windows += identified
    return answers


def posteriors(
    recording: Path, estimates: Sequence[ModalEstimate], costs: Costs, change: "Change"
) -> list[FoundationPosterior]:
    """Of each estimate by itself, under the recording's scenario, changed."""
    source = replayed(recording)
    graph = build(change(source.scenario), source.layout, Outputs(), source.layouts)
    (node,) = (plan.make() for plan in graph if plan.name == "updating")
    found = []
    for estimate in estimates:
        began = time.process_time()
        answers = list(node.handle(estimate))
        costs.seconds["update"] += time.process_time() - began
        found += [each for each in answers if isinstance(each, FoundationPosterior)]
    return found


Change = Callable[[Scenario], Scenario]


def as_recorded(scenario: Scenario) -> Scenario:
    """All modes that the sensors see."""
    return scenario


def papers_modes(scenario: Scenario) -> Scenario:
    """The likelihood of the paper's eleven modes alone."""
    likelihood = replace(scenario.updating.likelihood, modes=PAPERS_MODES)
    return replace(scenario, updating=replace(scenario.updating, likelihood=likelihood))


def recorded_again(recording: Path, turbine: str, costs: Costs) -> None:
    """The turbine's first window of blocks written once more."""
    with tempfile.TemporaryDirectory() as folder:
        recorder = SessionRecorder(
            Path(folder) / "again.mcap", metadata={}, clock=time.time_ns, settings=None
        )
        blocks = [
            each
            for each in _first(recording, turbine)
            if isinstance(each, AccelerationBlock | SensorLayout)
        ]
        with costs.of("encode and record"):
            for block in blocks:
                encode(block)
                recorder.handle(block)
            recorder.close()


def _first(recording: Path, turbine: str) -> Iterator[Message]:
    count = 0
    for message in read_messages(recording, (SensorLayout, AccelerationBlock)):
        if message.turbine == turbine:
            count += isinstance(message, AccelerationBlock)
            if count > WINDOW:
                return
            yield message


def truths_of(recording: Path) -> dict[str, FloatArray]:
    """turbine → (3,) k11 [N/m], k22 [N·m/rad], k12 [N/rad]"""
    found = {}
    for truth in read_messages(recording, (FoundationTruth,)):
        assert isinstance(truth, FoundationTruth)
        found.setdefault(truth.turbine, np.array([truth.k11, truth.k22, truth.k12]))
    return found


def print_simulated(recording: Path) -> None:
    """CPU by step, then the farm of one window a turbine, by all modes and by the paper's."""
    truths, costs = truths_of(recording), Costs()
    with one_blas_thread():
        estimates = first_windows(recording, tuple(truths), costs)
        everything = posteriors(recording, estimates, costs, as_recorded)
        recorded_again(recording, estimates[0].turbine, costs)
    costs.seconds["encode and record"] *= costs.windows  # measured on one
    total = sum(costs.a_window(step) for step in STEPS)
    parts = ", ".join(f"{step} {costs.a_window(step):.2f}" for step in STEPS)
    print(f"CPU s a window, one thread: {parts}; together {total:.2f}:")
    print(f"{WINDOW / total:.0f} turbines a core at real time", flush=True)
    print_gain("all modes, one window", everything, truths)
    with one_blas_thread():
        eleven = posteriors(recording, estimates, Costs(), papers_modes)
    print_gain("the paper's eleven, one window", eleven, truths)


def print_gain(
    name: str, found: Sequence[FoundationPosterior], truths: dict[str, FloatArray]
) -> None:
    """How much less wrong the turbines are by pooling, and who is told as an outlier."""
    try:
        farm = pooled_farm(found)
    except FarmError as error:
        print(f"{name}: {error}", flush=True)
        return
    true = np.array([truths[each.turbine] for each in farm.turbines])
    own, pooled = (errors(farm, true, own=which) for which in (True, False))
    alone, helped = np.median(own, axis=0), np.median(pooled, axis=0)
    overall = 1 - np.median(pooled) / np.median(own)
    widths = [_three(100 * _half_widths(farm, own=which)) for which in (True, False)]
    print(f"{name}, {len(farm.turbines)} turbines, k11 k22 k12:")
    print(
        f"  median error % alone {_three(100 * alone)}, pooled {_three(100 * helped)}; falls by "
        f"{_three(100 * (1 - helped / alone), 0)} %, all springs together {100 * overall:.0f} %"
    )
    print(f"  half width of 90 % intervals, %: alone {widths[0]}, pooled {widths[1]}")
    outlying = [each.text for each in farm.turbines if each.outlying]
    print(f"  outliers: {'; '.join(outlying) or 'none'}", flush=True)
    for each in farm.left_out:
        print(f"  {each.turbine} left out: {each.reason}", flush=True)


def errors(farm: Farm, truths: FloatArray, *, own: bool) -> FloatArray:
    """(n_turbines, 3) |median / truth − 1|."""
    medians = [[k.median for k in (each.own if own else each.pooled)] for each in farm.turbines]
    return np.abs(np.array(medians) / truths - 1)


def _half_widths(farm: Farm, *, own: bool) -> FloatArray:
    """(3,) medians over the turbines, shares of nominal."""
    springs = [each.own if own else each.pooled for each in farm.turbines]
    widths = [[abs((k.p95 - k.p05) / 2 / k.nominal) for k in three] for three in springs]
    return np.median(np.array(widths), axis=0)


def _three(values: FloatArray, digits: int = 2) -> str:
    return " ".join(f"{value:.{digits}f}" for value in values)
