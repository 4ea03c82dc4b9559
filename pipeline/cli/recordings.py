"""`pilewatch simulate`, `info`, `salvage`, `import`, `export`: work with recordings."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.console import (
    DatesOption,
    JsonOption,
    ScenarioOption,
    ZoneOption,
    escape_markup,
    no_longer_than,
    output,
    print_json,
    progress,
    stderr,
)
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.scenario import Scenario


def simulate(
    scenario: Annotated[
        str | None, typer.Argument(help="A shipped scenario or a TOML file.")
    ] = None,
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The MCAP file to write.")] = None,
    duration: Annotated[
        float | None, typer.Option(help="Duration [s]; default: the scenario's.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="Seed; default: the scenario's.")] = None,
    show_list: Annotated[bool, typer.Option("--list", help="List the shipped scenarios.")] = False,
    describe: Annotated[
        str | None, typer.Option(help="Describe a scenario without simulating it.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Simulate a scenario's turbine and record its sensors."""
    from pipeline.cli.tables.recordings import (
        scenario_description,
        scenario_settings,
        scenarios_table,
    )
    from pipeline.scenario import load_scenario, shipped_scenarios, with_overrides
    from pipeline.sources.sources import record_simulation, simulated

    if show_list and as_json:
        print_json([_scenario_json(load_scenario(name)) for name in shipped_scenarios()])
        return
    if describe is not None and as_json:
        described = _with_its_files(load_scenario(describe))
        print_json(_scenario_json(described) | {"toml": described.text})
        return
    if show_list:
        output.print(scenarios_table([load_scenario(name) for name in shipped_scenarios()]))
        return
    if describe is not None:
        described = _with_its_files(load_scenario(describe))
        output.print(escape_markup(scenario_description(described)), highlight=False)
        output.print(
            f"\n{escape_markup(scenario_settings(described))}", highlight=False, soft_wrap=True
        )
        return
    if scenario is None or out is None:
        raise InputError(
            "simulate needs a scenario and -o FILE.mcap; `pilewatch simulate --list` lists the "
            "shipped scenarios"
        )
    chosen = with_overrides(load_scenario(scenario), duration=duration, seed=seed)
    source = simulated(chosen)
    with progress(source.text, source.duration) as report:
        record_simulation(source, out, report=report)
    _print_written(out, as_json)


def _with_its_files(scenario: "Scenario") -> "Scenario":
    """Return a scenario whose files can be read: who asks what it says would run it next."""
    if scenario.has_structure:
        _ = scenario.structure
    _ = scenario.population
    return scenario


def _scenario_json(scenario: "Scenario") -> dict[str, Any]:
    """Return what `simulate --list` prints of a scenario."""
    return {
        "name": scenario.name,
        "title": scenario.title,
        "duration_s": scenario.simulation.duration,
        "has_structure": scenario.has_structure,
    }


def _print_written(file: Path, as_json: bool) -> None:
    size = file.stat().st_size
    if as_json:
        print_json({"file": str(file), "size_bytes": size})
    else:
        output.print(f"{escape_markup(str(file))}: {size / 1e6:.2f} MB", soft_wrap=True)


def info(
    file: Annotated[
        Path, typer.Argument(help="An MCAP recording, or a session's folder with one.")
    ],
    as_json: JsonOption = False,
) -> None:
    """List what a recording holds: channels, duration, gaps, scenario, truth."""
    from pipeline.cli.tables.recordings import (
        info_json,
        metadata_lines,
        recording_tables,
        span_line,
    )
    from pipeline.recording.info import recording_info
    from pipeline.sources.session_files import one_recording

    file = one_recording(file)
    with stderr.status(escape_markup(f"reading {file}")):
        found = recording_info(file)
    if as_json:
        output.print_json(json.dumps(info_json(found)))
        return
    for table in recording_tables(found):
        output.print(table)
    if span := span_line(found):
        output.print(span, soft_wrap=True, highlight=False)
    for line in metadata_lines(found):
        output.print(escape_markup(line), soft_wrap=True)


def salvage(
    file: Annotated[Path, typer.Argument(help="A cut or damaged recording; it is not changed.")],
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", help="The file to write; default: FILE.salvaged.mcap."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Recover every complete chunk of a cut or damaged recording."""
    from pipeline.recording.salvage import how_to_use, salvaged_name
    from pipeline.recording.salvage import salvage as salvaged
    from pipeline.sources.session_files import is_of_session

    target = salvaged_name(file) if out is None else out
    with stderr.status(escape_markup(f"reading {file}")):
        salvaged_content = salvaged(file, target)
    if as_json:
        print_json({"file": str(target), "recovered": salvaged_content.recovered})
    else:
        output.print(escape_markup(f"{target}: {salvaged_content.recovered}"), soft_wrap=True)
        if is_of_session(file):
            use = escape_markup(how_to_use(file, target))
            output.print(f"Use: {use}", soft_wrap=True, highlight=False)


def import_files(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="CSV, TSV, Parquet, NPZ, HDF5, MATLAB, OpenFAST, TDMS, miniSEED or UFF; several "
            "are joined in order of time."
        ),
    ],
    out: Annotated[Path | None, typer.Option("-o", "--out", help="The MCAP file to write.")] = None,
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file: position, quantity and unit of each channel."),
    ] = None,
    template: Annotated[
        bool, typer.Option("--template", help="Print a layout file of the channels, to fill in.")
    ] = False,
    sampling_rate: Annotated[
        float | None,
        typer.Option(help="[Hz]; where the files have no time stamps that increase."),
    ] = None,
    reader: Annotated[
        str | None,
        typer.Option(help="package.module:function that reads a file to SEP005 channels."),
    ] = None,
    dates: DatesOption = None,
    zone: ZoneOption = "",
    at_most: Annotated[
        float, typer.Option("--at-most", help="Give up after so many seconds.")
    ] = 3600.0,
    scenario: ScenarioOption = None,
    as_json: JsonOption = False,
) -> None:
    """Make a recording of files of measurements.

    Without a scenario, running it tracks modes only.
    """
    from pipeline.scenario import load_scenario
    from pipeline.sources.import_files import open_measurement, record_measurement
    from sensors.files.formats import channels_in, constant_channels
    from sensors.files.layout_file import layout_template, load_layout
    from sensors.files.table import EVERYTHING, FileError, TimeColumn, dated

    time = TimeColumn(dates=dates, zone=zone)
    if template:
        # a layout may state which column is the time
        everything = replace(dated(EVERYTHING, time), rate_known=True)
        table = channels_in(files[0], reader, everything)
        try:
            constant = constant_channels(files[0], reader, everything)
        except FileError:  # of a column that the layout may leave out
            constant = ()
        typer.echo(layout_template(table, constant), nl=False)
        return
    if out is None:
        raise InputError("import needs -o FILE.mcap, the recording to write")
    chosen = None if scenario is None else load_scenario(scenario)
    with no_longer_than(at_most):
        measurement = open_measurement(
            files,
            layout=None if layout is None else load_layout(layout),
            turbine="turbine" if chosen is None else chosen.turbine.id,
            sampling_rate=sampling_rate,
            reader=reader,
            time=time,
        )
        with progress(f"importing {len(files)} files", None) as report:
            record_measurement(measurement, out, scenario=chosen, report=report)
    _print_written(out, as_json)


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
            help="imu.mcap: samples only, one ROS 2 message each, for Foxglove and PlotJuggler.",
        ),
    ] = False,
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", help="Folder of the files; existing files are not overwritten."
        ),
    ] = Path("export"),
    as_json: JsonOption = False,
) -> None:
    """Write a recording's samples and results as CSV or Parquet files, or its samples for viewers.

    `pilewatch identify` reads the CSV of the samples.
    """
    from pipeline.export.export import export as exported
    from pipeline.export.imu import export_imu
    from pipeline.state.phrases import count_noun

    if csv + parquet + imu != 1:
        raise InputError("export needs one of --csv, --parquet and --imu")
    with progress(f"exporting {file}", None) as report:
        if imu:
            files = export_imu(file, out, report=report)
        else:
            files = exported(file, out, "csv" if csv else "parquet", report=report)
    what = "message" if imu else "row"
    if as_json:
        print_json([{"file": str(each.path), f"{what}s": each.rows} for each in files])
        return
    for each in files:
        content = count_noun(each.rows, what)
        output.print(escape_markup(f"{each.path}: {content}"), soft_wrap=True, highlight=False)
