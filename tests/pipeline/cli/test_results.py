"""What a session says at its end stays readable, however much there was to say."""

import io

import pytest
from rich.console import Console

from pipeline.cli import results
from pipeline.messages import WindowRejected
from pipeline.monitoring.summary import SessionSummary
from pipeline.scenario import load_scenario


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
