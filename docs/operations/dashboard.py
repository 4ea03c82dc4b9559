"""Write grafana.json, the dashboard of pilewatch's figures: python docs/operations/dashboard.py."""

import json
from pathlib import Path
from typing import Any

SOURCE = {"type": "prometheus", "uid": "${source}"}
TURBINE = 'turbine=~"$turbine"'
# title, unit (of Grafana), width of 24, [(query, legend)]
PANELS: tuple[tuple[str, str, int, list[tuple[str, str]]], ...] = (
    ("Trusted", "none", 4, [(f"min(pilewatch_posterior_trusted{{{TURBINE}}})", "")]),
    ("Changes found", "none", 4, [(f"sum(pilewatch_events_total{{{TURBINE}}})", "")]),
    ("Highest probability of a change", "percentunit", 4,
     [(f"max(pilewatch_change_probability{{{TURBINE}}})", "")]),
    ("Largest lag", "s", 4, [(f"max(pilewatch_lag_seconds{{{TURBINE}}})", "")]),
    ("Nodes down", "none", 4, [(f"count(pilewatch_node_up{{{TURBINE}}} == 0) or vector(0)", "")]),
    ("Alarm messages waiting", "none", 4, [("sum(pilewatch_alarm_waiting)", "")]),
    *(
        (f"{spring} ÷ nominal", "none", 8,
         [(f'pilewatch_stiffness_ratio{{{TURBINE},spring="{spring}"}}', "{{turbine}} q{{level}}")])
        for spring in ("k11", "k22", "k12")
    ),
    ("First frequency", "hertz", 12,
     [(f"pilewatch_first_frequency_hertz{{{TURBINE}}}", "{{turbine}}")]),
    ("Frequencies over their mean of a day", "percentunit", 12,
     [(f"pilewatch_mode_frequency_hertz{{{TURBINE}}} / avg_over_time("
       f"pilewatch_mode_frequency_hertz{{{TURBINE}}}[1d]) - 1", "{{turbine}} {{mode}}")]),
    ("Damping ratios", "percentunit", 12,
     [(f"pilewatch_mode_damping_ratio{{{TURBINE}}}", "{{turbine}} {{mode}}")]),
    ("Probability of a change", "percentunit", 12,
     [(f"pilewatch_change_probability{{{TURBINE}}}", "{{turbine}}")]),
    ("Age of the newest sample", "s", 8,
     [(f"pilewatch_lag_seconds{{{TURBINE}}}", "{{turbine}}/{{unit}}")]),
    ("Missing time in an hour", "s", 8,
     [(f"increase(pilewatch_missing_seconds_total{{{TURBINE}}}[1h])", "{{turbine}}/{{unit}}")]),
    ("Windows rejected in a day", "none", 8,
     [(f"increase(pilewatch_windows_rejected_total{{{TURBINE}}}[1d])", "{{turbine}} {{code}}")]),
    ("Share of a core by node", "percentunit", 12,
     [(f"rate(pilewatch_node_busy_seconds_total{{{TURBINE}}}[5m])", "{{turbine}} {{node}}")]),
    ("Samples a second", "none", 12,
     [(f"rate(pilewatch_samples_total{{{TURBINE}}}[5m])", "{{turbine}}/{{unit}}")]),
)  # fmt: skip


def dashboard() -> dict[str, Any]:
    """The dashboard as Grafana imports it; it asks for the data source."""
    panels, x, y, row_height = [], 0, 0, 0
    for number, (title, unit, width, queries) in enumerate(PANELS, start=1):
        height = 4 if width == 4 else 8
        if x + width > 24:
            x, y = 0, y + row_height
        row_height = height
        panels.append(
            {
                "id": number,
                "title": title,
                "type": "stat" if width == 4 else "timeseries",
                "datasource": SOURCE,
                "gridPos": {"x": x, "y": y, "w": width, "h": height},
                "fieldConfig": {"defaults": {"unit": unit}, "overrides": []},
                "targets": [
                    {"refId": chr(65 + i), "expr": query, "legendFormat": legend}
                    for i, (query, legend) in enumerate(queries)
                ],
            }
        )
        x += width
    return {
        "title": "pilewatch",
        "uid": "pilewatch",
        "schemaVersion": 39,
        "time": {"from": "now-7d", "to": "now"},
        "refresh": "1m",
        "templating": {"list": [_source_variable(), _turbine_variable()]},
        "panels": panels,
    }


def _source_variable() -> dict[str, Any]:
    return {"name": "source", "type": "datasource", "query": "prometheus"}


def _turbine_variable() -> dict[str, Any]:
    query = "label_values(pilewatch_messages_total, turbine)"
    return {
        "name": "turbine",
        "type": "query",
        "datasource": SOURCE,
        "query": {"query": query, "refId": "turbines"},
        "multi": True,
        "includeAll": True,
        "allValue": ".*",
        "current": {"text": "All", "value": "$__all"},
    }


if __name__ == "__main__":
    path = Path(__file__).with_name("grafana.json")
    path.write_text(json.dumps(dashboard(), indent=1) + "\n", encoding="utf-8")
