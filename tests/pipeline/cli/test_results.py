"""What a session says at its end stays readable, however much there was to say."""

import io
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from rich.console import Console
from typer.testing import CliRunner

from pipeline.cli import app, results
from pipeline.messages import WindowRejected
from pipeline.monitoring.status import ENDPOINT_FILE
from pipeline.monitoring.summary import SessionSummary
from pipeline.scenario import load_scenario
from pipeline.transport import zenoh_bus
from tests.pipeline.example_estimates import estimate, mode

SHAPE = np.linspace(0.2, 1.0, 8)


def test_of_many_warnings_of_a_kind_some_are_printed_and_the_rest_counted(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    result = io.StringIO()
    monkeypatch.setattr(results, "output", Console(file=result, width=100))
    summary = SessionSummary("live", "t1")
    warnings = [{"code": "mode-birth", "text": f"m{number}"} for number in range(20)]
    gaps = [{"code": "gap", "start": 600.0 * k, "reason": "gap of [2 s]"} for k in range(4)]
    figures = summary.as_json(wall=1.0) | {
        "warnings": [*warnings, {"code": "clipped", "text": "z41-fa"}],
        "windows": {"identified": 0, "rejected": gaps},
    }
    scenario = load_scenario("parked")
    results.print_results(summary, figures, scenario=scenario, layout=scenario.layout)
    lines = result.getvalue().splitlines()
    assert sum(line.startswith("mode-birth: m") for line in lines) == 3
    assert "… and 17 more mode-birth" in lines
    assert "clipped: z41-fa" in lines
    assert sum("rejected: gap of [2 s]" in line for line in lines) == 3
    assert "… and 1 more rejected (gap)" in lines


def test_a_rejection_before_anything_was_measured_is_a_line(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A listener may hear of a window before it hears a block."""
    written = io.StringIO()
    monkeypatch.setattr(results, "output", Console(file=written, width=100))
    summary = SessionSummary("live", "t1", live=True)
    summary.handle(WindowRejected("t1", 3, 10**18, 10**18 + 1, "gap", "gap of 2 s"))
    scenario = load_scenario("parked")
    figures = summary.as_json(wall=1.0)
    results.print_results(summary, figures, scenario=scenario, layout=scenario.layout)
    assert "window rejected: gap of 2 s" in written.getvalue().splitlines()


def test_modes_without_a_posterior_stand_beside_the_models_nearest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Else nobody could tell a wrong description from a window that was spoilt."""
    written = io.StringIO()
    monkeypatch.setattr(results, "output", Console(file=written, width=100))
    scenario = load_scenario("parked")
    found = estimate(mode(0.25, SHAPE))
    summary = SessionSummary("live", "t1", live=True)
    summary.handle(replace(found, channels=scenario.layout.channel_names))
    figures = summary.as_json(wall=1.0)
    results.print_results(summary, figures, scenario=scenario, layout=scenario.layout)
    text = written.getvalue()
    assert "the model's nearest mode" in text
    assert "No posterior: no window could be used." in text


@pytest.mark.parametrize("named", [True, False])
def test_the_status_is_asked_where_the_command_says_or_else_where_the_folder_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, named: bool
) -> None:
    (tmp_path / ENDPOINT_FILE).write_text("tcp/127.0.0.1:7001\n")
    asked: list[object] = []
    monkeypatch.setattr(zenoh_bus, "asked", lambda whom, _: asked.append(whom) or [b'{"a": 1}'])
    options = ["--connect", "tcp/127.0.0.1:7002"] if named else ["--out", str(tmp_path)]
    done = CliRunner().invoke(app, ["status", *options, "--json"])
    assert done.exit_code == 0, done.output
    assert json.loads(done.stdout) == [{"a": 1}]
    assert asked == ["tcp/127.0.0.1:7002" if named else "tcp/127.0.0.1:7001"]
