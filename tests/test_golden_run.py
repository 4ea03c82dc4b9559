"""Three lock-step runs whose every message must stay the same, byte by byte.

A change that only moves or renames code leaves the hashes of `golden/runs.json` as they are. A
change that is meant to change numbers renews the file in the same commit and says why:

    python -m tests.test_golden_run

Bytes agree on one processor kind with one set of locked versions, because BLAS kernels differ.
Elsewhere the numbers are compared with tolerances, and a warning reports that.
"""

import hashlib
import json
import platform
import warnings
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from threadpoolctl import threadpool_info

from pipeline.app import Outputs, build
from pipeline.messages import FoundationPosterior, Message, ModalEstimate, NodeStatus
from pipeline.nodes.node import NodeStatistics
from pipeline.runtime.lock_step import run_lock_step
from pipeline.scenario import load_scenario
from pipeline.sources.recorded_stream import Playback
from pipeline.sources.sources import Source, replayed, simulated
from pipeline.streams import STREAMS
from pipeline.transport.codec import encode

GOLDEN = Path(__file__).parent / "golden" / "runs.json"
RECORDING = Path(__file__).parents[1] / "recordings" / "parked.mcap"
DURATIONS = {"parked": 1200.0, "bad-sensors": 1800.0, "tide": 1200.0}  # of each run [s]
VERSIONS = ("numpy", "scipy", "emcee", "protobuf")
FREQUENCY_TOLERANCE = 1e-3  # of another BLAS: rounding moves which pole represents a mode [-]
SAME_POLES = 1e-6  # of all frequencies of a run, by the same poles [-]
MEDIAN_TOLERANCE = {True: 0.05, False: 0.15}  # of another BLAS, of half a 90 % interval, by whether
# all poles are the same: seen .0013, and .08 where one mode's pole was another one [-]

# Windows of the recording that another test has identified are taken from it, to the bit.
pytestmark = pytest.mark.usefixtures("identified_once")


def source_of(name: str) -> Source:
    """The beginning of the recording, or of a scenario."""
    if name == "parked":
        return replace(replayed(RECORDING), playback=Playback(end=DURATIONS[name]))
    scenario = load_scenario(name)
    shortened = replace(scenario.simulation, duration=DURATIONS[name])
    return simulated(replace(scenario, simulation=shortened))


class Witness:
    """A node that hashes every message of a run and keeps its main numbers."""

    name = "witness"
    inputs = tuple(stream.message for stream in STREAMS)
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self._hashes: dict[str, Any] = defaultdict(hashlib.sha256)
        self._counts: Counter[str] = Counter()
        self._frequencies: list[list[float]] = []
        self._medians: list[list[float]] = []
        self._half_widths: list[list[float]] = []

    def handle(self, message: Message) -> Iterable[Message]:
        """Count and hash the message."""
        name = type(message).__name__
        self._counts[name] += 1
        self._hashes[name].update(encode(_without_wall_time(message)))
        if isinstance(message, ModalEstimate):
            self._frequencies.append([mode.frequency for mode in message.modes])
        if isinstance(message, FoundationPosterior):
            self._hashes["draws"].update(np.ascontiguousarray(message.draws).tobytes())
            springs = message.parameters[:3]
            self._medians.append([each.median for each in springs])
            self._half_widths.append([(each.p95 - each.p05) / 2 for each in springs])
        return ()

    def close(self) -> None:
        """Nothing is held."""

    @property
    def record(self) -> dict[str, Any]:
        """What the golden file holds of one run."""
        return {
            "counts": dict(sorted(self._counts.items())),
            "sha256": {name: h.hexdigest() for name, h in sorted(self._hashes.items())},
            "frequencies": self._frequencies,
            "medians": self._medians,
            "half_widths": self._half_widths,
        }


def _without_wall_time(message: Message) -> Message:
    return replace(message, time_ns=0, busy_s=0.0) if isinstance(message, NodeStatus) else message


def run(source: Source) -> dict[str, Any]:
    """A lock-step run without recording and pictures; what its messages were."""
    witness = Witness()
    nodes = [plan.make() for plan in build(source.scenario, source.layout, Outputs())]
    run_lock_step(source.messages(), [*nodes, witness], turbine=source.layout.turbine)
    return witness.record


def machine() -> dict[str, str]:
    """What bit-identical numbers depend on beside the code."""
    kernels = sorted(
        {str(i.get("architecture")) for i in threadpool_info() if i["user_api"] == "blas"}
    )
    vectors = np.show_config(mode="dicts")["SIMD Extensions"]["found"]
    return {
        "processor": platform.machine(),
        "blas": ", ".join(kernels),
        "numpy vectors": vectors[-1] if vectors else "",
        "python": ".".join(platform.python_version_tuple()[:2]),
    } | {name: version(name) for name in VERSIONS}


@pytest.mark.parametrize("name", DURATIONS)
def test_a_run_gives_the_same_messages_as_before(name: str) -> None:
    golden = json.loads(GOLDEN.read_text())
    now, before = run(source_of(name)), golden["runs"][name]
    if machine() == golden["machine"]:
        assert now["counts"] == before["counts"]
        assert now["sha256"] == before["sha256"]
        return
    warnings.warn(f"compared with tolerances: {machine()} is not {golden['machine']}", stacklevel=1)
    assert now["counts"]["ModalEstimate"] == before["counts"]["ModalEstimate"]
    farthest = 0.0
    for ours, theirs in zip(now["frequencies"], before["frequencies"], strict=True):
        nearest = np.array([min(abs(f / g - 1) for g in ours) for f in theirs])
        assert np.mean(nearest < FREQUENCY_TOLERANCE) > 0.9
        farthest = max(farthest, float(nearest.max(initial=0.0)))
    tolerance = MEDIAN_TOLERANCE[farthest < SAME_POLES]
    moved = np.subtract(now["medians"], before["medians"]) / before["half_widths"]
    assert np.abs(moved).max() < tolerance
    np.testing.assert_allclose(
        np.log(now["half_widths"]), np.log(before["half_widths"]), atol=tolerance
    )


def renew() -> None:
    """Write the golden file from today's code."""
    GOLDEN.parent.mkdir(exist_ok=True)
    runs = {name: run(source_of(name)) for name in DURATIONS}
    text = json.dumps({"machine": machine(), "runs": runs}, indent=1)
    GOLDEN.write_text(text + "\n")


if __name__ == "__main__":
    renew()
