"""What one fixed session publishes, word for word and figure for figure.

The session is of made-up messages, so that nothing here depends on a sampler or a processor. A
change that is meant renews the file in the same commit and says why:

    python -m tests.pipeline.test_published
"""

import io
import json
import tempfile
from collections.abc import Iterable, Iterator
from dataclasses import MISSING, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any

import pytest
import typer
from prometheus_client import generate_latest
from prometheus_client.registry import CollectorRegistry
from rich.console import Console
from rich.table import Table
from typer.main import get_command

from pipeline.cli import app, results
from pipeline.cli.tables.modes import identified_modes_table
from pipeline.cli.tables.posteriors import figures_tables, posterior_table, posteriors_table
from pipeline.cli.tables.recordings import (
    info_json,
    recording_tables,
    scenario_settings,
    scenarios_table,
)
from pipeline.cli.tables.running import status_tables
from pipeline.export.export import export
from pipeline.messages import Message, QualityWarning, WindowRejected
from pipeline.monitoring.alarms.outbox import DeliveryState
from pipeline.monitoring.alarms.settings import (
    AlarmLogSettings,
    AlarmSettings,
    HeartbeatSettings,
    MailSettings,
    MqttSettings,
    WebhookSettings,
)
from pipeline.monitoring.metrics import MetricsNode, delivery_families
from pipeline.monitoring.status import StatusNode
from pipeline.monitoring.summary import SessionSummary
from pipeline.recording.info import recording_info
from pipeline.report.figures_json import session_json
from pipeline.report.recorded_session import read_session
from pipeline.scenario import load_scenario, scenario_from_text, shipped_scenarios
from pipeline.state.run_modes import CombinedTracks
from pipeline.updating.structural.sensors.figures import sensor_figures
from pipeline.updating.structural.settings import OTHERS, UNCERTAIN
from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.payloads.mapping import PayloadMapping
from sensors.files.layout_file import LayoutFile, MappedChannel
from sensors.files.table import TimeColumn
from sensors.json_values import with_nulls
from sensors.settings import constants_of
from sensors.structure.calibration import Calibration
from sensors.structure.components import Blades, PointMass, RigidBody, RotorNacelle, Tube, Water
from sensors.structure.description import TurbineDescription, load_turbine
from sensors.structure.foundation import FoundationSprings
from tests.pipeline.example_messages import LAYOUT, START_NS, block, status
from tests.pipeline.report.example_session import estimate, posterior, recorded, session

WRITTEN_BY_HAND = (  # sections of descriptions, layouts, mappings and of where notices go
    *(TurbineDescription, Calibration, Blades, PointMass, RigidBody, RotorNacelle, Tube, Water),
    *(FoundationSprings, LayoutFile, MappedChannel, TimeColumn, PayloadMapping),
    *(AlarmSettings, AlarmLogSettings, HeartbeatSettings, MailSettings, MqttSettings),
    WebhookSettings,
)
GOLDEN = Path(__file__).parents[1] / "golden" / "published.json"
FIGURES = {
    "added_mass": {"median": 0.012, "p05": -0.1, "p95": 0.12, "unit": "-"},
    "gain z145-fa": {"median": 1.0, "p05": 0.98, "p95": 1.02, "unit": "[m]"},
}
DELIVERY = DeliveryState("webhook-1", 1, 2, 3, 4, 5, 6.0, START_NS, "away")


class Clock:
    """A second later with every message."""

    now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


def messages() -> list[Message]:
    """The example's, some blocks that come twice, and what nodes count and warn of."""
    doubted = (QualityWarning("unfit-blocks", "3 blocks were refused"),)
    node = status("identification", last_sequence=7, received={"AccelerationBlock": 5}, lost=3)
    node = replace(node, late=1, duplicate=2, malformed=4, busy_s=2.5, warnings=doubted)
    beyond = WindowRejected("t1", 7, START_NS, START_NS + NANOSECONDS, "nan", "no numbers")
    return [*session()[:3], block(1), block(2), block(2), *session()[3:], node, beyond]


def printed(tables: Iterable[Table | str]) -> list[str]:
    """What a terminal of 110 columns shows."""
    text = io.StringIO()
    console = Console(file=text, width=110)
    for table in tables:
        console.print(table)
    return [line.rstrip() for line in text.getvalue().splitlines()]


@cache
def published() -> dict[str, Any]:
    """Everything, by where it is published."""
    clock, own = Clock(), load_scenario("parked")
    node, metrics, summary = (
        StatusNode("live", clock),
        MetricsNode(clock),
        SessionSummary("s", "t1"),
    )
    metrics.parts.append(lambda: delivery_families([DELIVERY]))
    for message in messages():
        clock.now_ns += NANOSECONDS
        for sink in (node, metrics, summary):
            sink.handle(message)
    figures = summary.as_json(wall=2.0)
    with tempfile.TemporaryDirectory() as folder:
        path = recorded(Path(folder) / "session.mcap", messages(), pilewatch={"version": "1"})
        info, machine = recording_info(path), session_json(read_session(path))
        files = export(path, Path(folder) / "tables", "csv")
        rows = {each.path.name: each.path.read_text("utf-8").splitlines()[:40] for each in files}
    modes = CombinedTracks([estimate(0), estimate(1)]).modes(posterior(1))
    registry = CollectorRegistry()
    registry.register(metrics)
    answers = node.as_json()["posteriors"]
    found = {
        "status": node.as_json(),
        "summary": figures,
        "metrics": generate_latest(registry).decode().splitlines(),
        "report": {k: v for k, v in machine.items() if k != "files"},
        "export": rows,
        "info": {k: v for k, v in info_json(info).items() if k not in ("file", "size_bytes")},
        "tables": {
            "status": printed(status_tables(node.as_json())),
            "posterior": printed([posterior_table(answers[0]), posteriors_table(answers * 2)]),
            "figures": printed(figures_tables(answers[0] | {"figures": FIGURES})),
            "modes": printed([identified_modes_table(modes, 2), identified_modes_table([], 0)]),
            "scenarios": printed([scenarios_table([*map(load_scenario, shipped_scenarios())])]),
            "results": _results(summary, figures),
            "recording": printed(recording_tables(info))[2:],
        },
        "priors": _priors(),
        "scenario": scenario_settings(own).splitlines(),
        "defaults": dict(_defaults(scenario_from_text("", "own.toml"), "")),
        "commands": dict(_options()),
        "files": {k.__name__: dict(_unstated(k)) for k in WRITTEN_BY_HAND},
    }
    return dict(json.loads(json.dumps(with_nulls(found))))


def _priors() -> dict[str, float]:
    """Standard deviations of what is not known exactly, by name, in its own unit."""
    turbine = load_turbine("iea15mw_monopile")
    structure = {each.name: each.std for each in UNCERTAIN.prior(turbine).figures}
    return structure | dict(OTHERS) | {each.name: each.std for each in sensor_figures(LAYOUT)}


def _defaults(settings: Any, prefix: str) -> Iterator[tuple[str, str]]:
    """ "oma.hop" → "600.0": every key that nothing sets, and the constants beside them."""
    constants = constants_of(type(settings))
    names = {each.name for each in fields(settings)} | constants.keys()
    for name in sorted(names - {"text", "origin", "files"}):
        value = getattr(settings, name, constants.get(name))
        if is_dataclass(value):
            yield from _defaults(value, f"{prefix}{name}.")
        else:
            yield prefix + name, repr(value)


def _options() -> Iterator[tuple[str, str]]:
    """ "run --speed" → "'max'": what every command takes where nothing is said."""
    group: Any = get_command(app)
    context = typer.Context(group, info_name="pilewatch")
    for name in group.list_commands(context):
        for each in group.get_command(context, name).params:
            default = each.default
            yield f"{name} {each.opts[0]}", "" if callable(default) else repr(default)


def _unstated(kind: Any) -> Iterator[tuple[str, str]]:
    """Every key that a file may leave out, and what it is then."""
    for each in fields(kind):
        if each.default is not MISSING:
            yield each.name, repr(each.default)


def _results(summary: SessionSummary, figures: Any) -> list[str]:
    """What a run prints at its end."""
    scenario, written = load_scenario("parked"), io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(results, "output", Console(file=written, width=110))
        results.print_results(summary, figures, scenario=scenario, layout=scenario.layout)
    return [line.rstrip() for line in written.getvalue().splitlines()]


def differences(one: Any, other: Any, place: str = "") -> list[str]:
    """Where two of them differ; numbers by more than rounding."""
    if isinstance(one, dict) and isinstance(other, dict):
        keys = sorted(one.keys() | other.keys())
        return [
            line
            for key in keys
            for line in differences(one.get(key), other.get(key), f"{place}.{key}")
        ]
    if isinstance(one, list) and isinstance(other, list) and len(one) == len(other):
        pairs = enumerate(zip(one, other, strict=True))
        return [line for n, pair in pairs for line in differences(*pair, f"{place}[{n}]")]
    if isinstance(one, float) and isinstance(other, float):
        return [] if one == pytest.approx(other, rel=1e-9) else [f"{place}: {one}, not {other}"]
    return [] if one == other else [f"{place}: {one!r}, not {other!r}"]


@pytest.mark.parametrize("place", sorted(json.loads(GOLDEN.read_text()) if GOLDEN.exists() else []))
def test_what_is_published_is_what_was(place: str) -> None:
    golden = json.loads(GOLDEN.read_text(encoding="utf-8"))
    assert published().keys() == golden.keys()
    assert differences(published()[place], golden[place], place) == []


if __name__ == "__main__":
    GOLDEN.write_text(json.dumps(published(), indent=1, ensure_ascii=False) + "\n", "utf-8")
