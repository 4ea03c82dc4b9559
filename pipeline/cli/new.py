"""`pilewatch new`: from files of measurements to a folder in which a run starts."""

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import JsonOption, escape_markup, output, print_json, stderr


def new(
    files: Annotated[
        list[Path], typer.Argument(help="Files of one measurement, in any format `import` reads.")
    ],
    out: Annotated[
        Path | None, typer.Option("-o", "--out", help="The folder; the first file's name.")
    ] = None,
    name: Annotated[str, typer.Option(help="Of the turbine; the first file's name.")] = "",
    structure: Annotated[
        str, typer.Option(help='A shipped description, a file, or "none": modes alone.')
    ] = "none",
    sampling_rate: Annotated[
        float | None, typer.Option(help="[Hz]; where the files have no time stamps.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Start from your own files: guess the layout, write scenario, layout and recording."""
    from pipeline.offline.new_project import start_project

    folder = out or Path(files[0].stem)
    with stderr.status(f"reading {', '.join(str(file) for file in files)}"):
        project = start_project(
            files, folder, name=name, structure=structure, sampling_rate=sampling_rate
        )
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
            }
        )
        return
    output.print(f"{len(project.channels)} channels at {project.sampling_rate:g} Hz:")
    for each in project.channels:
        output.print(f"  {escape_markup(each.name)}: {escape_markup(each.reason)}", highlight=False)
    if not project.complete:
        output.print(
            f"What the names do not have is a guess: correct {folder / 'layout.toml'} and import "
            "again where heights and axes matter (mode shapes, a structure).",
            soft_wrap=True,
        )
    where = escape_markup(str(folder))
    output.print(f"Written: {where}/layout.toml, {where}/scenario.toml, {project.recording}")
    output.print(f"Next:  cd {where} && pilewatch run && pilewatch report out", soft_wrap=True)
