"""`pilewatch identify`, `modes` and `describe`: measured modes, modes of a model."""

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer

from pipeline.cli.console import (
    DatesOption,
    JsonOption,
    ScenarioOption,
    ZoneOption,
    escape_markup,
    output,
    require_place,
    stderr,
)
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.offline.identify_file import FileIdentification


def identify(
    file: Annotated[
        Path,
        typer.Argument(
            help="An MCAP recording or a file of measurements: CSV, TSV, Parquet, NPZ, HDF5, "
            "MATLAB, OpenFAST, TDMS, miniSEED or UFF. A CSV has a header row; a time column called "
            "t, time or timestamp, its unit in brackets; channel units in brackets."
        ),
    ],
    sampling_rate: Annotated[
        float | None,
        typer.Option(help="[Hz]; where the file has no time stamps that increase."),
    ] = None,
    window: Annotated[
        float | None, typer.Option(help="Length of a window [s]; default: the whole file.")
    ] = None,
    lowest_frequency: Annotated[
        float | None,
        typer.Option(help="Lowest frequency of a mode [Hz]; default: from the record."),
    ] = None,
    highest_frequency: Annotated[
        float | None,
        typer.Option(help="Highest frequency of a mode [Hz]; default: from the sampling rate."),
    ] = None,
    layout: Annotated[
        Path | None,
        typer.Option(help="TOML file of the channels to use, as for `pilewatch import`."),
    ] = None,
    dates: DatesOption = None,
    zone: ZoneOption = "",
    rotor_speed: Annotated[
        float | None,
        typer.Option(
            help="Mean speed of a turning rotor [rpm], whose harmonics are then no modes; default: "
            "a recording's SCADA, or a column such as 'rotor speed [rpm]'."
        ),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(
            help="Draw the stabilisation diagram over the spectra as a PNG; of several windows, "
            "the first identified one."
        ),
    ] = None,
    why: Annotated[
        bool,
        typer.Option("--why", help="List also what looked like a mode and was refused, and why."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Identify the modes of the structure in a file; needs no turbine."""
    from pipeline.cli.tables.modes import identified_modes_table, refused_table
    from pipeline.offline.identify_file import identify_file
    from pipeline.oma.settings import OmaSettings, OmaSettingsError
    from pipeline.sources.session_files import one_recording
    from pipeline.state.run_modes import CombinedTracks
    from sensors.files.layout_file import load_layout
    from sensors.files.table import TimeColumn

    if plot is not None:
        require_place(plot, "--plot")
    file = one_recording(file) if file.is_dir() else file
    try:
        with stderr.status(escape_markup(f"identifying {file}")):
            found = identify_file(
                file,
                sampling_rate=sampling_rate,
                window=window,
                layout=None if layout is None else load_layout(layout),
                time=TimeColumn(dates=dates, zone=zone),
                rotor_speed=rotor_speed,
                settings=OmaSettings(
                    lowest_frequency=lowest_frequency, highest_frequency=highest_frequency
                ),
            )
    except OmaSettingsError as error:
        raise InputError(_with_options(str(error))) from error
    rejected = (replace(each, reason=_with_options(each.reason)) for each in found.rejected)
    found = replace(found, rejected=tuple(rejected))
    if plot is not None:
        _draw(found, file, plot)
    modes = CombinedTracks(found.estimates).modes()
    if not modes and not as_json:
        if why and found.candidates:
            output.print(refused_table(found.candidates))
        raise InputError(f"{file}: {_why_no_modes(found)}")
    for warning in found.warnings:
        stderr.print(f"[yellow]{warning.code}[/]: {escape_markup(warning.text)}", soft_wrap=True)
    if as_json:
        figures = {
            "modes": [
                mode.as_json() | {"cross_check": _check_as_json(found, mode.name)} for mode in modes
            ],
            "warnings": [{"code": each.code, "text": each.text} for each in found.warnings],
            "windows": found.windows_json(),
            "sampling_rate_hz": found.sampling_rate,
            "duration_s": found.duration,
            "channels": list(found.channels),
        }
        if why:
            figures["refused"] = [each.as_json() for each in found.candidates]
        output.print_json(json.dumps(figures))
        if not modes:
            raise InputError(f"{file}: {_why_no_modes(found)}")
    else:
        output.print(identified_modes_table(modes, len(found.estimates), found.cross_checks))
        if why:
            output.print(refused_table(found.candidates))


def _with_options(text: str) -> str:
    """Return a text about settings with the options' names: here no scenario sets them."""
    for end in ("lowest", "highest"):
        text = text.replace(f"[oma] {end}_frequency", f"--{end}-frequency")
        text = text.replace(f"{end}_frequency", f"--{end}-frequency")
    return text


def _check_as_json(found: "FileIdentification", name: str) -> dict[str, float] | None:
    """Return what the second estimator finds of a mode; None where its spectrum has no peak."""
    check = found.cross_checks.get(name)
    if check is None:
        return None
    return {"frequency_hz": check.frequency, "damping_ratio": check.damping_ratio}


def _why_no_modes(found: "FileIdentification") -> str:
    """Return the reason of the first rejected window, or that no pole was stable."""
    if not found.rejected:
        return "no mode was identified: no pole is stable over the model orders"
    windows = len(found.rejected) + len(found.estimates)
    reason = found.rejected[0].reason
    return reason if windows == 1 else f"none of {windows} windows was identified: {reason}"


def _draw(found: "FileIdentification", file: Path, plot: Path) -> None:
    from pipeline.report.stabilisation import draw_stabilisation

    window = found.first_identified
    if window is None:
        text = f"{plot} was not drawn: no window of {file} was identified"
        stderr.print(escape_markup(text), soft_wrap=True)
        return
    title = f"{file.name}, window {window.number + 1}"
    draw_stabilisation(
        window.identification, window.samples, found.sampling_rate, plot, title=title
    )
    stderr.print(escape_markup(f"Drawn: {plot} ({title})"), soft_wrap=True)


def modes(
    theta: Annotated[
        str | None,
        typer.Option(help="k11,k22,k12 as ratios to nominal, e.g. 1,0.9,1."),
    ] = None,
    sign: Annotated[
        Literal["published", "embedded-pile"] | None,
        typer.Option(help="Sign convention of k12; default: the scenario's."),
    ] = None,
    structure: Annotated[
        str | None, typer.Option(help="A shipped description or a TOML file.")
    ] = None,
    scenario: ScenarioOption = None,
    as_json: JsonOption = False,
) -> None:
    """Print the model's modes: Table 1's eleven first, then the others that the sensors measure."""
    from pipeline.cli.tables.modes import model_modes_table
    from pipeline.offline.model_modes import model_modes

    with stderr.status("solving the model"):
        found = model_modes(theta=theta, sign=sign, turbine=structure, scenario=scenario)
    if as_json:
        output.print_json(json.dumps({"modes": found.as_json()}))
    else:
        output.print(model_modes_table(found))


def describe(
    turbine: Annotated[
        str, typer.Argument(help="A shipped turbine or a TOML description.")
    ] = "iea15mw_monopile",
    template: Annotated[
        bool, typer.Option("--template", help="Print it as TOML, to start a description from.")
    ] = False,
    plot: Annotated[
        Path | None, typer.Option(help="Draw the structure and its first modes as a PNG.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Check the description of a structure; print its key figures and first modes."""
    from pipeline.cli.tables.modes import structure_tables
    from pipeline.offline.describe_structure import structure_figures
    from pipeline.report.structure import draw_structure
    from sensors.structure.description import load_turbine, turbine_text

    if template:
        typer.echo(turbine_text(turbine), nl=False)
        return
    with stderr.status("solving the model"):
        figures = structure_figures(load_turbine(turbine))
    if plot is not None:
        draw_structure(figures, plot)
        stderr.print(escape_markup(f"Drawn: {plot}"), soft_wrap=True)
    if as_json:
        output.print_json(json.dumps(figures.as_json()))
    else:
        for table in structure_tables(figures):
            output.print(table)
