"""`pilewatch describe`: a structure of one's own, checked before anything is built on it."""

import json
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import JsonOption, output, people


def describe(
    turbine: Annotated[
        str, typer.Argument(help="A shipped turbine or a TOML description of your own.")
    ] = "iea15mw_monopile",
    template: Annotated[
        bool, typer.Option("--template", help="Print it as TOML, to start one's own from.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the structure and its first modes as a PNG.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check the description of a structure; print its key figures and first modes."""
    from pipeline.offline.describe_structure import structure_figures
    from pipeline.report.structure import draw_structure
    from pipeline.tables.modes import structure_tables
    from sensors.structure.description import load_turbine, turbine_text

    if template:
        typer.echo(turbine_text(turbine), nl=False)
        return
    with people.status("solving the model"):
        figures = structure_figures(load_turbine(turbine))
    if plot is not None:
        draw_structure(figures, plot)
        people.print(f"Drawn: {plot}", soft_wrap=True)
    if as_json:
        output.print_json(json.dumps(figures.as_json()))
    else:
        for table in structure_tables(figures):
            output.print(table)
