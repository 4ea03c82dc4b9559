"""`pilewatch simulate`, `info` and `salvage`: recordings made, looked at and mended."""

from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import escaped, output, people, progress
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
    from pipeline.scenario import load_scenario, shipped_scenarios, with_overrides
    from pipeline.sources.sources import record_simulation, simulated
    from pipeline.tables.recordings import scenario_description, scenario_settings, scenarios_table

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
    from pipeline.recording.info import recording_info
    from pipeline.tables.recordings import recording_tables

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
