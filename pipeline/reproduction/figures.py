"""Draw Figure 3: marginals and pairs of the posterior by both samplers, with MAP and truth."""

from pathlib import Path
from typing import Any

import numpy as np

from pipeline.report.canvas import new_figure
from pipeline.reproduction.example import Example
from sensors.errors import InputError

PARAMETER_TITLES = ("k11 / K0 [-]", "k22 / K0 [-]", "k12 / K0 [-]", "σ [-]")
PUBLISHED, CORRECTED, TRUTH = "#cc79a7", "#0072b2", "#009e73"  # Okabe and Ito (2008)
SHOWN = 4000  # draws in a cloud
CORNER_DOTS_PER_INCH = 130


def draw_figure3(example: Example, path: Path) -> None:
    """Write the corner plot as a PNG.

    Raises
    ------
    InputError
        If it cannot be drawn or written.
    """
    figure = new_figure((9, 9), str(path))
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
