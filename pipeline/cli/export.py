"""`pilewatch export`: a recording for other programs, as tables or as messages of IMUs."""

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
    imu: Annotated[
        bool,
        typer.Option(
            "--imu",
            help="imu.mcap: samples only, a ROS 2 message each, as Foxglove and PlotJuggler draw.",
        ),
    ] = False,
    out: Annotated[
        Path, typer.Option("-o", "--out", help="The folder of the files; nothing is overwritten.")
    ] = Path("export"),
) -> None:
    """Write a recording's samples and results as CSV or Parquet files, or its samples for viewers.

    `pilewatch identify` reads the samples' CSV again.
    """
    from pipeline.export.export import export as exported
    from pipeline.export.imu import export_imu

    if csv + parquet + imu != 1:
        raise InputError("export needs one of --csv, --parquet and --imu")
    with progress(f"exporting {file}", None) as report:
        if imu:
            files = export_imu(file, out, report=report)
        else:
            files = exported(file, out, "csv" if csv else "parquet", report=report)
    what = "messages" if imu else "rows"
    for each in files:
        output.print(f"{each.path}: {each.rows} {what}", soft_wrap=True, highlight=False)
