"""Write report.md, report.html, table1.csv and table2.csv: our figures beside the publication's."""

import csv
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from pipeline.report.canvas import new_figure
from pipeline.report.html import (
    TextTable,
    bullet_list,
    document,
    heading,
    paragraph,
    png,
    table_html,
)
from pipeline.reproduction.deterministic import RIGID
from pipeline.reproduction.example import Example
from pipeline.reproduction.findings import findings, over_seeds
from pipeline.reproduction.paper import MAP_ERRORS, MAP_SIGMA, TABLE_1, TABLE_2
from pipeline.reproduction.study import Study, map_errors
from sensors.atomic_write import require_writable
from sensors.errors import InputError

TITLE = "The publication's numerical example, run again"
PARAMETER_TITLES = ("k11 / K0 [-]", "k22 / K0 [-]", "k12 / K0 [-]", "σ [-]")
SHOWN = 4000  # draws in a cloud
CORNER_DOTS_PER_INCH = 130
PUBLISHED, CORRECTED, TRUTH = "#cc79a7", "#0072b2", "#009e73"  # Okabe and Ito (2008)


def write_report(study: Study, folder: Path) -> tuple[Path, ...]:
    """Write everything into a folder, made where it is missing; gives the files.

    Raises
    ------
    InputError
        If the folder or a file cannot be written.
    """
    prepared_folder(folder)
    figure = folder / "figure3.png"
    draw_figure3(study.first, figure)
    first, second = table1(study.first), table2(study)
    tables = [first, second, *_seed_tables(study)]
    sentences = findings(study)
    written = {
        folder / "report.md": markdown(tables, sentences, study),
        folder / "report.html": page(tables, sentences, study, figure.read_bytes()),
    }
    for path, text in written.items():
        path.write_text(text, encoding="utf-8")
    for name, table in (("table1.csv", first), ("table2.csv", second)):
        with (folder / name).open("w", newline="", encoding="utf-8") as file:
            csv.writer(file).writerows([table.head, *table.rows])
    return (*written, figure, folder / "table1.csv", folder / "table2.csv")


def prepared_folder(folder: Path) -> None:
    """Make the report's folder: before minutes are spent on the study, not after.

    Raises
    ------
    InputError
        If a file has its name, it cannot be made, or nothing can be written into it.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        require_writable(folder)
    except OSError as error:
        raise InputError(
            f"--out {folder}: {error.strerror}; a folder to write to is needed"
        ) from error


def table1(example: Example) -> TextTable:
    """Identified and model modes at K0, printed and ours."""
    head = (
        "mode", "direction", "model f printed [Hz]", "model f ours [Hz]", "identified printed [Hz]",
        "identified ours [Hz]", "std ours [Hz]", "MAC printed [-]", "MAC ours [-]",
    )  # fmt: skip
    rows = tuple(
        (
            printed.label,
            printed.direction,
            f"{printed.model_frequency:.4f}",
            f"{ours.model_frequency:.4f}",
            f"{printed.identified_frequency:.4f}",
            _or_missing(ours.frequency, "{:.4f}"),
            _or_missing(ours.frequency_std, "{:.4f}"),
            f"{printed.mac:.3f}",
            _or_missing(ours.mac, "{:.3f}"),
        )
        for printed, ours in zip(TABLE_1, example.modes, strict=True)
    )
    return TextTable(f"Table 1, seed {example.seed}", head, rows)


def table2(study: Study) -> TextTable:
    """Errors of the deterministic and the Bayesian estimates, printed and ours in both signs."""
    head = ("estimate", "run", "k11 [%]", "k22 [%]", "k12 [%]", "J [-]", "σ [-]")
    rows = []
    for place, printed in enumerate(TABLE_2):
        name = f"Nelder-Mead, γ = {printed.start:g}"
        errors = tuple(f"{error:+.2f}" for error in printed.errors)
        rows.append((name, "printed", *errors, f"{printed.objective:.3f}", ""))
        for example in _first_of_each_sign(study):
            descent = example.descents[place]
            errors = tuple(_error_at_end(ratio) for ratio in descent.end)
            rows.append((name, example.sign, *errors, f"{descent.objective:.3f}", ""))
    errors = tuple(f"{error:+.2f}" for error in MAP_ERRORS)
    rows.append(("MAP, TMCMC", "printed", *errors, "", f"{MAP_SIGMA:.2e}"))
    for example in _first_of_each_sign(study):
        errors = tuple(f"{error:+.2f}" for error in map_errors(example))
        sigma = f"{example.published.highest[3]:.2e}"
        rows.append(("MAP, TMCMC", example.sign, *errors, "", sigma))
    return TextTable(f"Table 2, seed {study.first.seed}", head, tuple(rows))


def _error_at_end(ratio: float) -> str:
    return "to rigid" if ratio > RIGID else f"{100.0 * (ratio - 1):+.2f}"


def _first_of_each_sign(study: Study) -> list[Example]:
    return [example for example in study.examples if example.seed == study.first.seed]


def _seed_tables(study: Study) -> list[TextTable]:
    tables = []
    for sign in dict.fromkeys(example.sign for example in study.examples):
        examples = study.of(sign)
        if len(examples) > 1:
            title = f"{len(examples)} seeds, sign {sign}"
            tables.append(TextTable(title, ("subject", "figures"), tuple(over_seeds(examples))))
    return tables


def _or_missing(value: float, form: str) -> str:
    return form.format(value) if np.isfinite(value) else "not found"


def markdown(tables: Sequence[TextTable], sentences: Sequence[str], study: Study) -> str:
    """Return the whole report as Markdown."""
    parts = [f"# {TITLE}", _introduction(study), "## What agrees and what differs"]
    parts += [f"- {sentence}" for sentence in sentences]
    for table in tables:
        rule = "|".join(["---"] * len(table.head))
        lines = [" | ".join(row) for row in (table.head, *table.rows)]
        parts.append(f"## {table.title}")
        parts.append("\n".join([f"| {lines[0]} |", f"|{rule}|", *(f"| {x} |" for x in lines[1:])]))
    parts += ["## Figure 3", "![Posterior of the springs and σ](figure3.png)"]
    return "\n\n".join(parts) + "\n"


def page(tables: Sequence[TextTable], sentences: Sequence[str], study: Study, figure: bytes) -> str:
    """Return the whole report as one HTML page that needs nothing else."""
    parts = [paragraph(_introduction(study)), heading("What agrees and what differs")]
    parts.append(bullet_list(sentences))
    parts += [heading(each.title) + table_html(replace(each, title="")) for each in tables]
    parts += [heading("Figure 3"), png(figure, "Posterior of the springs and σ")]
    return document(TITLE, "".join(parts))


def _introduction(study: Study) -> str:
    seeds = sorted({example.seed for example in study.examples})
    span = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    return (
        "The numerical example of “Estimating the foundation parameters of offshore wind turbines "
        "through Bayesian model updating”: the parked IEA 15 MW turbine on a monopile, 750 s of "
        "which 150 s are dropped, eight channels, 3 % noise, SSI-cov, deterministic updating from "
        f"three starts, TMCMC with {study.samples} samples a stage. Here: {span}, scenario "
        "“paper”, the structure taken as exactly known, as there; what its loads are and why "
        "stands in the scenario's description."
    )


def draw_figure3(example: Example, path: Path) -> None:
    """Write the corner plot as a PNG.

    Raises
    ------
    InputError
        If it cannot be drawn or written.
    """
    figure = new_figure((9, 9))
    grid = figure.subplots(4, 4, sharex="col")
    clouds = ((example.published, PUBLISHED), (example.corrected, CORRECTED))
    for row in range(4):
        for column in range(4):
            axes = grid[row, column]
            if column > row:
                axes.remove()
                continue
            for posterior, colour in clouds:
                if row == column:
                    _marginal(axes, posterior.draws[:, row], colour)
                else:
                    _cloud(axes, posterior.draws[:, [column, row]], colour)
            _marks(axes, example, row, column)
    _name_axes(grid)
    _legend(figure)
    try:
        figure.savefig(path, dpi=CORNER_DOTS_PER_INCH)
    except OSError as error:
        raise InputError(f"cannot write the figure {path}: {error.strerror or error}") from error


def _marginal(axes: Any, values: np.ndarray, colour: str) -> None:
    axes.hist(values, bins=60, density=True, histtype="step", color=colour)
    axes.set_yticks([])


def _cloud(axes: Any, points: np.ndarray, colour: str) -> None:
    some = points[:: max(1, len(points) // SHOWN)]
    axes.plot(*some.T, ".", markersize=1.2, alpha=0.25, color=colour, rasterized=True)


def _marks(axes: Any, example: Example, row: int, column: int) -> None:
    """Mark the truth (1) and the MAP draw, where the axis is a stiffness."""
    if column < 3:
        axes.axvline(1.0, color=TRUTH, linewidth=1)
    if row < 3 and row != column:
        axes.axhline(1.0, color=TRUTH, linewidth=1)
    if row != column:
        highest = example.published.highest
        axes.plot(highest[column], highest[row], "x", color="black", markersize=6)


def _name_axes(grid: Any) -> None:
    for i in range(4):
        grid[3, i].set_xlabel(PARAMETER_TITLES[i])
        grid[3, i].tick_params(axis="x", rotation=45)
        if i > 0:
            grid[i, 0].set_ylabel(PARAMETER_TITLES[i])
        for j in range(1, i):
            grid[i, j].set_yticklabels([])


def _legend(figure: Any) -> None:
    from matplotlib.lines import Line2D

    handles = [
        Line2D([], [], color=PUBLISHED, label="TMCMC as published"),
        Line2D([], [], color=CORRECTED, label="corrected sampler"),
        Line2D([], [], color=TRUTH, label="truth"),
        Line2D([], [], color="black", marker="x", linestyle="", label="MAP draw"),
    ]
    figure.legend(handles=handles, loc="upper right", fontsize="large")
