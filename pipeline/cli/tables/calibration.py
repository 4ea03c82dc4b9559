"""Tables of a calibration: every figure before and after, the springs, what stays unknown."""

from typing import TYPE_CHECKING

import numpy as np
from rich.table import Table

from pipeline.cli.tables.cells import table_of
from pipeline.messages import HALF_INTERVAL
from pipeline.updating.prior import PARAMETER_NAMES
from sensors.structure.figures import BY_NAME

if TYPE_CHECKING:
    from pipeline.offline.calibrate_turbine import TurbineCalibration
    from pipeline.updating.structural.periods.calibration import UnseparatedFigures

MOST_UNSEPARATED = 4  # combinations that are listed
SENSOR_UNITS = {"gain": "-", "heading": "deg", "height": "m"}


def calibration_table(found: "TurbineCalibration") -> Table:
    """Return every figure: its prior, what the measurements make of it, what they added."""
    best = found.best
    table = table_of(f"Figures of the structure, {best.name}")
    table.add_column("figure", no_wrap=True)
    for title in ("unit", "prior ±", "median", "±", "÷ prior"):
        table.add_column(title, justify="right", no_wrap=True)
    medians, halves = best.departures
    left = np.sqrt(np.diag(best.covariance))
    rows = zip(best.names, found.calibration.stds, medians, halves, left, strict=True)
    for name, std, median, half, deviation in rows:
        table.add_row(
            name,
            _unit(name),
            f"{std:.3g}",
            f"{std * median:+.2g}",
            f"{std * half:.2g}",
            f"{deviation:.0%}",
        )
    logs, stds = best.log_springs
    springs = ", ".join(
        f"{name} {np.exp(log):.3f} ± {100 * HALF_INTERVAL * std:.1f} %"
        for name, log, std in zip(PARAMETER_NAMES, logs, stds, strict=True)
    )
    table.caption = (
        f"median: departure from the description; ÷ prior: what is left of the uncertainty; "
        f"{found.calibration.source}; springs ÷ nominal in "
        f"that time, 90 %: {springs}"
    )
    return table


def unknown_lines(found: "TurbineCalibration") -> list[str]:
    """Return what the measurements cannot separate, as sentences."""
    return [_sentence(each) for each in found.best.unseparated[:MOST_UNSEPARATED]]


def _sentence(found: "UnseparatedFigures") -> str:
    words = [f"{'more' if part > 0 else 'less'} {name}" for name, part in found.parts.items()]
    moved = ", ".join(
        f"{name} by {move:+.1%}" for name, move in zip(PARAMETER_NAMES, found.moved, strict=True)
    )
    return f"Not separated from the springs: {' with '.join(words)} moves {moved}."


def _unit(name: str) -> str:
    return BY_NAME[name].unit if name in BY_NAME else SENSOR_UNITS[name.split()[0]]
