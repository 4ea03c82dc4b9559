"""Draw a described structure to scale beside its first modes."""

from pathlib import Path
from typing import Any

from pipeline.offline.describe_structure import StructureFigures
from pipeline.report.canvas import DOTS_PER_INCH, new_figure
from sensors.errors import InputError
from sensors.structure.description import TurbineDescription

STEEL, SEA, GROUND, ROTOR = "#56B4E9", "#0072B2", "#8C8C8C", "#E69F00"  # colour-blind safe
SEA_DEPTH = 0.25  # transparency of the water [-]
MODE_PANELS = 6  # of modes, beside the structure


def draw_structure(figures: StructureFigures, path: Path) -> None:
    """Write the picture of a structure and its first modes.

    On the left tubes, rotor, water and mudline to scale; then a panel for each of the first modes
    with the tower's shape, its largest component 1.

    Raises
    ------
    InputError
        If the file cannot be written.
    """
    figure = new_figure((13, 7))
    modes = figures.first[:MODE_PANELS]
    widths = [2.2] + [1.0] * len(modes)
    structure_axes, *mode_axes = figure.subplots(1, len(widths), sharey=True, width_ratios=widths)
    _draw_structure(structure_axes, figures.description)
    for number, (axes, mode) in enumerate(zip(mode_axes, modes, strict=True)):
        frequency, direction, blades = mode
        axes.plot(figures.shape(number), figures.elevations, color=STEEL)
        axes.axvline(0.0, color=GROUND, linewidth=0.6)
        axes.set_xlim(-1.2, 1.2)
        axes.set_title(f"{frequency:.4g} Hz {direction}\nblades {100 * blades:.0f} %", fontsize=9)
        axes.set_xlabel("shape [-]")
    title = figures.description.title or figures.description.name
    figure.suptitle(f"{title}: as described, and its first modes (share of the blades' energy)")
    try:
        figure.savefig(path, dpi=DOTS_PER_INCH, format=path.suffix[1:] or "png")
    except (OSError, ValueError) as error:  # ValueError: a suffix that no picture has
        reason = getattr(error, "strerror", None) or error
        raise InputError(f"cannot write the figure {path}: {reason}") from error


def _draw_structure(axes: Any, described: TurbineDescription) -> None:
    for tube in described.tubes:
        half = tube.diameter / 2
        axes.fill_betweenx([tube.bottom, tube.top], -half, half, facecolor=STEEL, edgecolor="black")
    axes.axhline(described.mudline, color=GROUND, linewidth=3)
    axes.annotate("mudline", (0.02, described.mudline), xycoords=("axes fraction", "data"),
                  xytext=(0, 4), textcoords="offset points")  # fmt: skip
    if described.water is not None and described.water.level > described.mudline:
        axes.axhspan(described.mudline, described.water.level, color=SEA, alpha=SEA_DEPTH)
    _draw_rotor(axes, described)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_ylabel("above mean water level [m]")
    axes.set_xlabel("fore-aft [m], wind from the left")


def _draw_rotor(axes: Any, described: TurbineDescription) -> None:
    """Draw the bodies on the top by their centres, and the blades as seen from the side."""
    top, rotor = described.tower_top, described.rotor_nacelle
    for number, body in enumerate(rotor.bodies):
        x, _, z = body.centre
        axes.plot(x, top + z, "s", color=ROTOR)
        place = (24, 14 - 14 * number)  # one under the other: centres lie close together
        axes.annotate(body.name, (x, top + z), xytext=place, textcoords="offset points")
    if described.blades is None:
        return
    apex = (rotor.overhang, top + rotor.tower_to_shaft)
    length = described.blades.hub_radius + described.blades.elements[-1].outer
    axes.plot(*apex, "o", color=ROTOR)
    for reach in (length, -length / 2):  # one blade up; the other two hang to the sides
        axes.plot([apex[0]] * 2, [apex[1], apex[1] + reach], color=ROTOR)
