"""What a session says at its end stays readable, however much there was to say."""

import io

import pytest
from rich.console import Console

from pipeline.cli import results
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
