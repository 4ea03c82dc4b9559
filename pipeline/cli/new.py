"""`pilewatch new`: from files of measurements to a folder in which a run starts."""

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline.cli.console import DatesOption, JsonOption, escape_markup, output, print_json, stderr
from pipeline.cli.tables.cells import count_noun
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.offline.new_project import NewProject
    from sensors.structure.foundation import FoundationSprings


def new(
    files: Annotated[
        list[Path], typer.Argument(help="Files of one measurement, in any format `import` reads.")
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The folder; the first file's name.")
    ] = None,
    name: Annotated[str, typer.Option(help="Of the turbine; the first file's name.")] = "",
    structure: Annotated[
        str,
        typer.Option(
            help="A shipped description, a TOML file, OpenFAST's NAME_ElastoDyn.dat, a WindIO "
            'NAME.yaml, a BModes NAME.bmi, or "none": modes alone.'
        ),
    ] = "none",
    subdyn: Annotated[
        Path | None, typer.Option(help="SubDyn's file of the monopile below an ElastoDyn tower.")
    ] = None,
    springs: Annotated[
        str | None,
        typer.Option(
            help="k11,k22,k12 at the mudline [N/m, N·m/rad, N/rad], for files of other "
            "programs; of an embedded "
            "pile k12 < 0."
        ),
    ] = None,
    mudline: Annotated[
        float | None,
        typer.Option(
            help="Elevation at which a WindIO monopile ends, or a BModes tower begins [m]."
        ),
    ] = None,
    sampling_rate: Annotated[
        float | None, typer.Option(help="[Hz]; where the files have no time stamps.")
    ] = None,
    dates: DatesOption = None,
    as_json: JsonOption = False,
) -> None:
    """Start from your own files: guess the layout, write scenario, layout and recording."""
    from pipeline.offline.new_project import start_project

    folder = out or Path(files[0].stem)
    with stderr.status(f"reading {', '.join(str(file) for file in files)}"):
        project = start_project(
            files,
            folder,
            name=name,
            structure=structure,
            subdyn=subdyn,
            mudline=mudline,
            springs=None if springs is None else _springs(springs),
            sampling_rate=sampling_rate,
            dates=dates,
        )
    drawing = _drawn(project)
    if as_json:
        channels = [asdict(each) for each in project.channels]
        print_json(
            {
                "folder": str(project.folder),
                "recording": str(project.recording),
                "sampling_rate_hz": project.sampling_rate,
                "structure": project.structure,
                "complete": project.complete,
                "channels": channels,
                "left_out": [asdict(each) for each in project.left_out],
                "conditions": list(project.conditions),
            }
        )
        return
    number = count_noun(len(project.channels), "channel")
    output.print(f"{number} at {project.sampling_rate:g} Hz:")
    for each in project.channels:
        output.print(f"  {escape_markup(each.name)}: {escape_markup(each.reason)}", highlight=False)
    if project.left_out:
        listed = ", ".join(str(each) for each in project.left_out)
        output.print(f"Not among the motions: {escape_markup(listed)}", soft_wrap=True)
    if project.conditions:
        listed = escape_markup(", ".join(project.conditions))
        output.print(f"Recorded beside the motions as SCADA: {listed}", soft_wrap=True)
    if not project.complete:
        layout, scenario = folder / "layout.toml", folder / "scenario.toml"
        rate = "" if sampling_rate is None else f"--sampling-rate {sampling_rate:g} "
        again = (
            f"rm {project.recording} && pilewatch import {' '.join(map(str, files))} {rate}"
            f"--layout {layout} --scenario {scenario} -o {project.recording}"
        )
        output.print(
            escape_markup(
                "What the names do not have is a guess. Where heights and axes matter (mode "
                f"shapes, a structure), correct {layout} and make the recording again:  {again}"
            ),
            soft_wrap=True,
        )
    if drawing:
        output.print(_structure_line(drawing[0]), soft_wrap=True, highlight=False)
    where = escape_markup(str(folder))
    written = [f"{where}/layout.toml", f"{where}/scenario.toml", *drawing, project.recording]
    output.print(f"Written: {', '.join(map(str, written))}", soft_wrap=True)
    output.print(f"Next:  cd {where} && pilewatch run && pilewatch report out", soft_wrap=True)


def _springs(text: str) -> "FoundationSprings":
    from sensors.structure.foundation import FoundationSprings

    try:
        k11, k22, k12 = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--springs {text!r}: three numbers are needed, k11,k22,k12") from None
    return FoundationSprings(k11, k22, abs(k12), "embedded-pile" if k12 < 0 else "published")


def _structure_line(described: Path) -> str:
    """Return where the structure stands: what a deck without its substructure gets wrong."""
    from sensors.structure.description import load_turbine

    turbine = load_turbine(described)
    water = "no water" if turbine.water is None else f"water to {turbine.water.level:g} m"
    return (
        f"Structure: springs at {turbine.mudline:g} m, {water}, tower top at "
        f"{turbine.tower_top:g} m"
    )


def _drawn(project: "NewProject") -> list[Path]:
    """The description that was written into the folder, and its drawing where matplotlib is."""
    from pipeline.offline.describe_structure import structure_figures
    from pipeline.offline.new_project import STRUCTURE_FILE
    from pipeline.report.structure import draw_structure
    from sensors.structure.description import load_turbine

    if project.structure != STRUCTURE_FILE:
        return []
    described = project.folder / STRUCTURE_FILE
    picture = described.with_suffix(".png")
    try:
        draw_structure(structure_figures(load_turbine(described)), picture)
    except InputError as error:  # matplotlib is an extra; the folder is complete without a drawing
        stderr.print(f"no drawing: {escape_markup(str(error))}", soft_wrap=True)
        return [described]
    return [described, picture]
