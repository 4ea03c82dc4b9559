"""`pilewatch reproduce`: the publication's example, run again."""

from pathlib import Path
from typing import Annotated

import typer
from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

from pipeline.cli.console import output, people
from sensors.errors import InputError

FIRST_SEED = 101


def reproduce(
    out: Annotated[Path, typer.Option(help="Folder for the report.")] = Path("reproduction"),
    seeds: Annotated[int, typer.Option(help="How many seeds; one takes minutes.")] = 1,
    first_seed: Annotated[int, typer.Option(help="The first of them.")] = FIRST_SEED,
) -> None:
    """Run the publication's example and write its tables and figure beside ours."""
    from pipeline.reproduction.page import write_report
    from pipeline.reproduction.study import run_study
    from sensors.structure.foundation import SPRING_SIGNS

    if seeds < 1:
        raise InputError(f"--seeds is {seeds}; at least 1 is needed")
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed} of {task.total}"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=people, transient=True) as bar:
        total = seeds * len(SPRING_SIGNS)
        task = bar.add_task("simulate, identify, update (two processes)", total=total)
        study = run_study(range(first_seed, first_seed + seeds), report=lambda: bar.advance(task))
    files = write_report(study, out)
    output.print("Written: " + ", ".join(str(path) for path in files), soft_wrap=True)
