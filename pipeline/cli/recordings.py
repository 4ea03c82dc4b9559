"""`pilewatch simulate`, `info` and `salvage`: recordings made, looked at and mended."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import ScenarioOption, escaped, output, people, progress
from sensors.errors import InputError


def simulate(
    scenario: Annotated[
        str | None, typer.Argument(help="A shipped scenario or a TOML file.")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The MCAP file to write.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Duration [s], instead of the scenario's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed, instead of the scenario's.")] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the shipped scenarios.")] = False,
    describe: Annotated[
        str | None, typer.Option(help="Say what a scenario simulates, and simulate nothing.")
    ] = None,
) -> None:
    """Simulate a scenario's turbine and record what its sensors say."""
    from pipeline.cli.tables.recordings import (
        scenario_description,
        scenario_settings,
        scenarios_table,
    )
    from pipeline.scenario import load_scenario, shipped_scenarios, with_overrides
    from pipeline.sources.sources import record_simulation, simulated

    if show_list:
        output.print(scenarios_table([load_scenario(name) for name in shipped_scenarios()]))
        return
    if describe is not None:
        told = load_scenario(describe)
        output.print(escaped(scenario_description(told)), highlight=False)
        output.print(f"\n{escaped(scenario_settings(told))}", highlight=False, soft_wrap=True)
        return
    if scenario is None or out is None:
        raise InputError(
            "simulate needs a scenario and -o FILE.mcap; `pilewatch simulate --list` shows the "
            "scenarios that come with it"
        )
    chosen = with_overrides(load_scenario(scenario), duration=duration, seed=seed)
    source = simulated(chosen)
    with progress(source.text, source.duration) as report:
        record_simulation(source, out, report=report)
    output.print(f"{out}: {out.stat().st_size / 1e6:.2f} MB", soft_wrap=True)


def info(
    file: Annotated[Path, typer.Argument(help="An MCAP recording.")],
) -> None:
    """Show what a recording holds: channels, duration, gaps, scenario, truth."""
    from pipeline.cli.tables.recordings import recording_tables
    from pipeline.recording.info import recording_info

    with people.status(f"reading {file}"):
        found = recording_info(file)
    for table in recording_tables(found):
        output.print(table)
    for section, texts in found.metadata.items():
        for key, text in texts.items():
            if "\n" not in text:
                output.print(f"{section}.{key} = {escaped(text)}", soft_wrap=True)


def salvage(
    file: Annotated[Path, typer.Argument(help="A cut or damaged recording; it stays as it is.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The file to write; FILE.salvaged.mcap unless given."),
    ] = None,
) -> None:
    """Bring back every complete chunk of a recording that was cut off or damaged."""
    from pipeline.recording.salvage import salvage as salvaged
    from pipeline.recording.salvage import salvaged_name

    target = salvaged_name(file) if out is None else out
    with people.status(f"reading {file}"):
        remains = salvaged(file, target)
    output.print(f"{target}: {remains.recovered}", soft_wrap=True)


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
