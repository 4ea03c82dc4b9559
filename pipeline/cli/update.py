"""`pilewatch update` and `reproduce`: the posterior of a recording, the published example."""

import json
import time
from functools import partial
from pathlib import Path
from typing import Annotated

import typer
from rich.progress import (
    BarColumn,
    Progress,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.cli.console import (
    JsonOption,
    SamplerOption,
    ScenarioOption,
    escape_markup,
    output,
    print_json,
    print_written,
    progress,
    progress_bars,
    require_place,
    stderr,
)
from pipeline.cli.results import print_results
from sensors.errors import InputError

DESIGN_STD = 0.2  # of springs of a design, where none is stated [-]


def update(
    file: Annotated[Path, typer.Argument(help="An MCAP recording, or a session's folder.")],
    sampler: SamplerOption = None,
    scenario: ScenarioOption = None,
    identify: Annotated[
        bool,
        typer.Option(
            "--identify", help="Identify from the accelerations, even where modes were recorded."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Update the foundation's stiffness from a recording; print the misfit of every mode."""
    from pipeline.run.update_recording import holds_estimates, update_from
    from pipeline.sources.sources import replayed_with_structure

    started = time.monotonic()
    source = replayed_with_structure(file, scenario).with_sampler(sampler)
    again = identify or not holds_estimates(file)
    what = "identifying and updating" if again else "updating from recorded modes"
    with progress(f"{what}: {file}", source.duration) as report:
        summary = update_from(source, identify=again, report=report)
    figures = summary.as_json(wall=time.monotonic() - started)
    if as_json:
        output.print_json(json.dumps(figures))
    else:
        if not again:
            stderr.print("From the recorded modes; --identify starts from the accelerations.")
        print_results(
            summary, figures, scenario=source.scenario, layout=source.layout, misfits=True
        )
    if summary.main.posterior is None:
        reason = (
            summary.main.rejected[-1].reason
            if summary.main.rejected
            else "there is no whole window"
        )
        raise InputError(f"{file}: no posterior: {reason}")


FIRST_SEED = 101


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report.")] = Path("reproduction"),
    seeds: Annotated[int, typer.Option(help="Number of seeds; one takes minutes.")] = 1,
    first_seed: Annotated[int, typer.Option(help="The first seed.")] = FIRST_SEED,
    as_json: JsonOption = False,
) -> None:
    """Run the publication's example and write its tables and figure beside ours."""
    from pipeline.reproduction.page import prepared_folder, write_report
    from pipeline.reproduction.study import run_study
    from sensors.structure.foundation import SPRING_SIGNS

    if seeds < 1:
        raise InputError(f"--seeds is {seeds}; at least 1 is needed")
    prepared_folder(out)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.percentage:.0f} %"),
        TimeElapsedColumn(),
        TextColumn("left:"),
        TimeRemainingColumn(),
    )
    with progress_bars(*columns) as bar:
        total = seeds * len(SPRING_SIGNS)
        task = bar.add_task("simulate, identify, update (two processes)", total=total)
        study = run_study(
            range(first_seed, first_seed + seeds), report=partial(_show_progress, bar, task)
        )
    files = write_report(study, out)
    if as_json:
        print_json({"files": [str(path) for path in files]})
    else:
        print_written(files)


def _show_progress(bar: Progress, task: TaskID, done: float) -> None:
    bar.update(task, completed=done)


def calibrate(
    sessions: Annotated[
        list[Path],
        typer.Argument(help="Sessions of one turbine, with modes: best a week or more of tides."),
    ],
    out: Annotated[
        Path, typer.Option("--out", "-o", help="Description with the calibration, TOML.")
    ] = Path("turbine.calibrated.toml"),
    scenario: ScenarioOption = None,
    design: Annotated[
        str | None,
        typer.Option(
            help="Springs of the design: K11,K22,K12 in N/m, N·m/rad, N/rad. They help to tell the "
            "figures from the springs; they are no prior of later sessions."
        ),
    ] = None,
    design_std: Annotated[
        float | None, typer.Option(help="Standard deviation of each, as a share of it; 0.2.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Infer the figures of a structure from its first weeks; later sessions begin with them.

    Give the written file as [turbine] description of the scenario.
    """
    from pipeline.cli.tables.posteriors import calibration_table, unknown_lines
    from pipeline.offline.calibrate_turbine import calibrate_turbine
    from pipeline.updating.structural.periods.calibration import DesignSprings
    from sensors.atomic_write import written_whole

    if out.exists():
        raise InputError(f"{out} exists; -o names another file")
    require_place(out, "-o")
    if design is None and design_std is not None:
        raise InputError(f"--design-std {design_std:g} is for --design K11,K22,K12")
    std = DESIGN_STD if design_std is None else design_std
    springs = None if design is None else DesignSprings(_springs(design), std)
    with stderr.status("fitting springs and figures to all water levels"):
        found = calibrate_turbine(sessions, scenario=scenario, design=springs)
    written_whole(out, found.text.encode())
    if as_json:
        print_json({"file": str(out)} | found.as_json())
        return
    output.print(calibration_table(found))
    for line in unknown_lines(found):
        output.print(escape_markup(line), soft_wrap=True)
    if not found.level_known:
        output.print(
            "No water level was reported: all windows are one group, so that the tide separates "
            "nothing; with `water_level` by SCADA more is learned.",
            soft_wrap=True,
        )
    elif found.n_level_unknown:
        output.print(
            f"Of {found.n_level_unknown} windows nothing reported the water level: they are in no "
            "group.",
            soft_wrap=True,
        )
    last = f'Written: {out}; use it with [turbine] description = "{out}"'
    output.print(last, soft_wrap=True, markup=False)


def _springs(text: str) -> tuple[float, float, float]:
    try:
        k11, k22, k12 = (float(part) for part in text.split(","))
    except ValueError:
        raise InputError(
            f"--design {text!r}: three numbers are needed, K11,K22,K12 in N/m, N·m/rad, N/rad"
        ) from None
    return k11, k22, k12
