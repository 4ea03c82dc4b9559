"""`pilewatch export`: a recording as tables for other programs."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import output, progress
from sensors.errors import InputError


def export(
    file: Annotated[
        Path, typer.Argument(help="An MCAP recording, or a session's folder with all its parts.")
    ],
    csv: Annotated[bool, typer.Option("--csv", help="Text with a header row.")] = False,
    parquet: Annotated[bool, typer.Option("--parquet", help="Parquet, times UTC.")] = False,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The folder of the files; nothing is overwritten.")
    ] = Path("export"),
) -> None:
    """Write a recording's samples and results as CSV or Parquet files.

    `pilewatch identify` reads the samples' CSV again.
    """
    from pipeline.export.exporting import export as exported

    if csv == parquet:
        raise InputError("export needs one of --csv and --parquet")
    with progress(f"exporting {file}", None) as report:
        files = exported(file, out, "csv" if csv else "parquet", report=report)
    for each in files:
        output.print(f"{each.path}: {each.rows} rows", soft_wrap=True, highlight=False)
