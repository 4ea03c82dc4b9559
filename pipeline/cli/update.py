"""`pilewatch update`: the posterior that a recording gives, without a session round it."""

import json
import time
from pathlib import Path
from typing import Annotated

import typer

from pipeline.cli.console import JsonOption, ScenarioOption, output, people, progress
from pipeline.cli.results import print_results


def update(
    file: Annotated[Path, typer.Argument(help="An MCAP recording or session.")],
    sampler: Annotated[
        str | None,
        typer.Option(help="importance (default), emcee, tmcmc or tmcmc-published."),
    ] = None,
    scenario: ScenarioOption = None,
    identify: Annotated[
        bool,
        typer.Option("--identify", help="From the accelerations, even where modes were recorded."),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Update the foundation's stiffness from a recording, and say how every mode fits."""
    from pipeline.offline.update_recording import holds_estimates, recorded_source, updated_from

    started = time.monotonic()
    source = recorded_source(file, scenario=scenario, sampler=sampler)
    again = identify or not holds_estimates(file)
    what = "identifying and updating" if again else "updating from recorded modes"
    with progress(f"{what}: {file}", source.duration) as report:
        summary = updated_from(source, identify=again, report=report)
    figures = summary.as_json(wall=time.monotonic() - started)
    if as_json:
        output.print_json(json.dumps(figures))
        return
    if not again:
        people.print("From the modes that were recorded; --identify begins with the accelerations.")
    print_results(summary, figures, scenario=source.scenario, misfits=True)
