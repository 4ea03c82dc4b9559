"""`pilewatch import`: files of measurements become a recording."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import ScenarioOption, output, progress
from sensors.errors import InputError


def import_files(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="CSV, TSV, Parquet, NPZ, HDF5, TDMS or miniSEED; several are joined in order of "
            "time."
        ),
    ],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The MCAP file to write.")] = None,
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file: where each channel was, what it measured, in what unit."),
    ] = None,
    template: Annotated[
        bool, typer.Option("--template", help="Print a layout file of the channels, to fill in.")
    ] = False,
    sampling_rate: Annotated[
        float | None,
        typer.Option(help="[Hz]; count the samples by it, whatever time stamps there are."),
    ] = None,
    reader: Annotated[
        str | None,
        typer.Option(help="package.module:function that reads a file to SEP005 channels."),
    ] = None,
    scenario: ScenarioOption = None,
) -> None:
    """Make a recording of files of measurements. Without a scenario, running it tracks modes."""
    from pipeline.scenario import load_scenario
    from pipeline.sources.import_files import open_measurement, record_measurement
    from sensors.files.formats import channels_in
    from sensors.files.layout_file import layout_template, load_layout

    if template:
        typer.echo(layout_template(channels_in(files[0], reader)), nl=False)
        return
    if out is None:
        raise InputError("import needs -o FILE.mcap, the recording to write")
    chosen = None if scenario is None else load_scenario(scenario)
    measurement = open_measurement(
        files,
        layout=None if layout is None else load_layout(layout),
        turbine="turbine" if chosen is None else chosen.turbine.id,
        sampling_rate=sampling_rate,
        reader=reader,
    )
    with progress(f"importing {len(files)} files", None) as report:
        record_measurement(measurement, out, scenario=chosen, report=report)
    output.print(f"{out}: {out.stat().st_size / 1e6:.2f} MB", soft_wrap=True)
