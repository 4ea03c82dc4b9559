"""Write foxglove.json, a layout for a session's recording: python docs/operations/foxglove.py.

Topics have the turbine's id in them; another turbine is named as the argument.
"""

import json
import sys
from pathlib import Path
from typing import Any

TURBINE = "iea15mw"
# title → paths below `pilewatch/{turbine}/`: topic, field
PLOTS: dict[str, list[tuple[str, str]]] = {
    "k11 [N/m]": [("foundation-posterior", f"parameters[0].{q}") for q in ("p05", "median", "p95")],
    "k22 [N·m/rad]": [
        ("foundation-posterior", f"parameters[1].{q}") for q in ("p05", "median", "p95")
    ],
    "k12 [N/rad]": [
        ("foundation-posterior", f"parameters[2].{q}") for q in ("p05", "median", "p95")
    ],
    "Lowest frequencies [Hz]": [("modal-estimate", f"modes[{i}].frequency") for i in range(3)],
    "Damping ratios [-]": [("modal-estimate", f"modes[{i}].damping_ratio") for i in range(3)],
    "Probability of a change [-]": [("foundation-posterior", "change_probability")],
}


def layout(turbine: str = TURBINE) -> dict[str, Any]:
    """The layout as Foxglove imports it: plots above, raw messages below."""
    panels: dict[str, Any] = {
        f"Plot!{number}": _plot(title, turbine, paths)
        for number, (title, paths) in enumerate(PLOTS.items())
    }
    panels["RawMessages!events"] = {"topicPath": f'"pilewatch/{turbine}/window-rejected"'}
    names = list(panels)
    columns = [_stack(names[:3], "column"), _stack(names[3:], "column")]
    return {
        "configById": panels,
        "globalVariables": {},
        "userNodes": {},
        "playbackConfig": {"speed": 1},
        "layout": {"first": columns[0], "second": columns[1], "direction": "row"},
    }


def _plot(title: str, turbine: str, paths: list[tuple[str, str]]) -> dict[str, Any]:
    series = [
        {
            "value": f'"pilewatch/{turbine}/{topic}".{field}',
            "enabled": True,
            "timestampMethod": "publishTime",
        }
        for topic, field in paths
    ]
    return {"title": title, "paths": series, "showLegend": True, "xAxisVal": "timestamp"}


def _stack(names: list[str], direction: str) -> Any:
    """Panels one below the other, of equal height."""
    if len(names) == 1:
        return names[0]
    share = 100 / len(names)
    return {
        "first": names[0],
        "second": _stack(names[1:], direction),
        "direction": direction,
        "splitPercentage": round(share, 1),
    }


if __name__ == "__main__":
    path = Path(__file__).with_name("foxglove.json")
    chosen = layout(*sys.argv[1:2])
    path.write_text(json.dumps(chosen, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
