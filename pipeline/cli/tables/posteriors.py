"""Tables of posteriors: of one turbine, of many, of a pooled farm."""

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

from collections.abc import Sequence

from pipeline.cli.console import escape_markup
from pipeline.cli.tables.cells import format_short, format_value
from pipeline.farm.farm import Farm
from pipeline.messages import FoundationPosterior
from pipeline.state.phrases import FIGURES_NOTE, count_noun, figure_name
from pipeline.state.posterior_json import ratios
from sensors.json_values import Json


def posterior_table(posterior: Json) -> Table:
    """Return median and 90 % interval of each spring, absolute and ÷ nominal."""
    turbine = f" of {posterior['turbine']}" if "turbine" in posterior else ""
    warning = "" if posterior.get("trusted", True) else ", NOT TRUSTED"
    table = table_of(f"Foundation posterior{turbine}{warning}")
    table.add_column("", justify="right", overflow="fold")
    for title in ("÷ nominal", "90 % interval", "truth", "median", "unit"):
        table.add_column(title, justify="right", no_wrap=True)
    for name in ("k11", "k22", "k12"):
        spring = posterior[name]
        table.add_row(
            name,
            format_value(spring["ratio_median"], ".4f"),
            f"{format_value(spring['ratio_p05'], '.4f')} to "
            f"{format_value(spring['ratio_p95'], '.4f')}",
            format_value(spring["truth_ratio"], ".4f"),
            format_value(spring["median"], ".3e"),
            spring["unit"],
        )
    sigma = posterior["sigma"]
    above = f"below {format_value(sigma['p95'], '.1e')} (95 %)"
    table.add_row("σ", "", above, "", format_value(sigma["median"], ".1e"), "-")
    table.caption = (
        f"{count_noun(posterior['windows'], 'window')}, {posterior['sampler']}: "
        f"{format_value(posterior['ess'], '.0f')} effective draws"
        + (f", R-hat {posterior['rhat']:.3f}" if posterior["rhat"] is not None else "")
        + "; σ: relative discrepancy of the model; probability of a new change: "
        f"{format_value(posterior['change_probability'], '.2f')}"
    )
    return table


def figures_tables(posterior: Json) -> list[Table]:
    """Return the table of the structure's figures; none where they are taken as known.

    Narrowed: by how much the data narrowed the prior's interval; a rough model's, wider, is 0.
    """
    if not posterior["figures"]:
        return []
    table = table_of("Figures of the structure and its sensors")
    table.add_column("", justify="right", overflow="fold")
    for title in ("median", "90 % interval", "unit", "narrowed [%]"):
        table.add_column(escape_markup(title), justify="right", no_wrap=True)
    for name, each in posterior["figures"].items():
        median, low, high = (format_short(each[key]) for key in ("median", "p05", "p95"))
        narrowed = each.get("contraction")  # older summaries have none
        table.add_row(
            figure_name(name),
            median,
            f"{low} to {high}",
            each["unit"],
            format_value(None if narrowed is None else 100 * max(narrowed, 0.0), ".0f"),
        )
    table.caption = (
        f"{FIGURES_NOTE}; narrowed: by how much the data narrowed what was assumed beforehand"
    )
    return [table]


def posteriors_table(posteriors: Sequence[Json]) -> Table:
    """Return the springs of many turbines: median and half the 90 % interval ÷ nominal."""
    headings = ("turbine", "windows", "k11", "k22", "k12", "change", "")
    table = table_of("Foundation posteriors, ÷ nominal", figures=headings, no_wrap=True)
    for each in posteriors:
        springs = [_plus_minus(each[name]) for name in ("k11", "k22", "k12")]
        table.add_row(
            each["turbine"], str(each["windows"]), *springs,
            format_value(each["change_probability"], ".2f"),
            "" if each["trusted"] else "NOT TRUSTED",
            style=None if each["trusted"] else "bold red",
        )  # fmt: skip
    table.caption = "± half a 90 % interval, %; change: probability of a new one"
    return table


def _plus_minus(spring: Json) -> str:
    low, high = spring["ratio_p05"], spring["ratio_p95"]
    half = None if low is None or high is None else 50 * (high - low)
    return f"{format_value(spring['ratio_median'], '.3f')} ± {format_value(half, '.1f')}"


def farm_table(farm: Farm) -> Table:
    """Return every turbine's pooled springs and its probability of being an outlier."""
    title = f"Springs ÷ nominal, {count_noun(len(farm.turbines), 'turbine')} pooled"
    headings = ("turbine", "windows", "k11", "k22", "k12", "outlier")
    table = table_of(title, figures=headings, no_wrap=True)
    for each in farm.turbines:
        springs = [
            f"{median:.3f} ± {50 * (high - low):.1f}"
            for median, low, high in map(ratios, each.pooled)
        ]
        style = "bold red" if each.outlying else None
        probability = f"{each.outlier_probability:.3f}"
        table.add_row(each.turbine, str(each.n_windows), *springs, probability, style=style)
    spreads = ", ".join(
        f"{name} {100 * each.median:.1f} % [{100 * each.p05:.1f}, {100 * each.p95:.1f}]"
        for name, each in zip(("k11", "k22", "k12"), farm.spread, strict=True)
    )
    table.caption = (
        f"± half a 90 % interval, %; turbines differ by {spreads} (standard deviation); outlier: "
        f"probability; R-hat {farm.rhat:.3f}"
    )
    return table


def misfit_table(posterior: FoundationPosterior) -> Table:
    """Return the misfit and information of each paired mode."""
    headings = ("mode", "f [Hz]", "model [Hz]", "apart [%]", "misfit", "MAC", "information")
    table = table_of("Misfit mode by mode", figures=headings, no_wrap=True)
    for pair in sorted(posterior.pairs, key=lambda pair: pair.frequency):
        apart = 100 * (pair.frequency / pair.model_frequency - 1)
        table.add_row(
            pair.model,
            f"{pair.frequency:.4f}",
            f"{pair.model_frequency:.4f}",
            f"{apart:+.2f}",
            f"{pair.misfit:+.1f}",
            f"{pair.mac:.3f}" + ("" if pair.shape_used else " –"),
            f"{100 * pair.information:.0f} %",
        )
    table.caption = (
        f"misfit: in standard deviations of the posterior's prediction; –: shape not used; "
        "information: share of the information on the stiffness; "
        f"{100 * posterior.paired_share:.0f} % of the identified modes paired, "
        f"reduced χ² {posterior.reduced_chi_square:.2f}"
    )
    return table


MOST_UNSEPARATED = 4  # combinations that are listed
SENSOR_UNITS = {"gain": "-", "heading": "deg", "height": "m"}


def calibration_table(found: "TurbineCalibration") -> Table:
    """Return every figure: its prior, what the measurements make of it, what they added."""
    best = found.best
    headings = ("unit", "prior ±", "median", "±", "÷ prior")
    title = f"Figures of the structure, {best.name}"
    table = table_of(title, "figure", figures=headings, no_wrap=True)
    medians, halves = best.departures
    left = np.sqrt(np.diag(best.covariance))
    rows = zip(best.names, found.calibration.stds, medians, halves, left, strict=True)
    for name, std, median, half, deviation in rows:
        table.add_row(
            figure_name(name),
            _unit(name),
            f"{std:.3g}",
            f"{std * median:+.2g}",
            f"{std * half:.2g}",
            f"{100 * deviation:.0f} %",
        )
    logs, stds = best.log_springs
    springs = ", ".join(
        f"{name} {np.exp(log):.3f} ± {100 * HALF_INTERVAL * std:.1f} %"
        for name, log, std in zip(PARAMETER_NAMES, logs, stds, strict=True)
    )
    table.caption = (
        "median: departure from the description, relative where the unit is -; ÷ prior: what is "
        "left of the uncertainty; RNA: rotor and nacelle; "
        f"{escape_markup(found.calibration.source)}; springs ÷ nominal in "
        f"that time, 90 %: {springs}"
    )
    return table


def unknown_lines(found: "TurbineCalibration") -> list[str]:
    """Return what the measurements cannot separate, as sentences."""
    return [_sentence(each) for each in found.best.unseparated[:MOST_UNSEPARATED]]


def _sentence(found: "UnseparatedFigures") -> str:
    words = [
        f"{'more' if part > 0 else 'less'} {figure_name(name)}"
        for name, part in found.parts.items()
    ]
    moved = ", ".join(
        f"{name} by {100 * move:+.1f} %"
        for name, move in zip(PARAMETER_NAMES, found.moved, strict=True)
    )
    return f"Not separated from the springs: {' with '.join(words)} moves {moved}."


def _unit(name: str) -> str:
    return BY_NAME[name].unit if name in BY_NAME else SENSOR_UNITS[name.split()[0]]
