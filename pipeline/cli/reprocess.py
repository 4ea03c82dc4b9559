"""`pilewatch reprocess`: an archive of recordings, from accelerations to posteriors."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.cli.console import ScenarioOption, escaped, output, people
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.archive.reprocessing import ArchiveReport
    from pipeline.archive.work import Workers

PHASES = {"reading": "files read", "identifying": "files identified", "updating": "windows updated"}


def reprocess(
    archive: Annotated[
        list[str],
        typer.Argument(
            help="Recordings: files, folders, patterns in quotes ('archive/**/*.mcap')."
        ),
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder of the results, and of what is finished.")
    ] = Path("results"),
    cluster: Annotated[
        str | None,
        typer.Option(help="A Dask scheduler (tcp://HOST:8786) whose workers read the archive too."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes of this machine; as many as it has cores, else."),
    ] = None,
    serial: Annotated[
        bool, typer.Option("--serial", help="In this process alone; the same numbers bit by bit.")
    ] = False,
    sampler: Annotated[
        str | None,
        typer.Option(help="importance (default), emcee, tmcmc or tmcmc-published."),
    ] = None,
    scenario: ScenarioOption = None,
) -> None:
    """Identify and update years of recordings in parallel; what is finished is not done again."""
    from pipeline.archive.reprocessing import reprocessed
    from pipeline.archive.survey import archive_files

    files = archive_files(archive)
    try:
        with _workers(cluster, workers, serial) as chosen, _bars() as bars:
            report = reprocessed(
                files, out, chosen, scenario=scenario, sampler=sampler, report=bars
            )
    except KeyboardInterrupt:
        people.print(f"Stopped. What is finished is kept in {out}; the same command goes on there.")
        raise typer.Exit(130) from None
    _print_report(report, out)
    if report.failures:
        raise typer.Exit(2)


def _workers(
    cluster: str | None, count: int | None, serial: bool
) -> AbstractContextManager["Workers"]:
    from pipeline.archive.cluster import cluster_workers, local_workers, usable_cores
    from pipeline.archive.work import ThisProcess

    if sum((cluster is not None, count is not None, serial)) > 1:
        raise InputError("--cluster, --workers and --serial exclude each other")
    if serial:
        return nullcontext(ThisProcess())
    return cluster_workers(cluster) if cluster else local_workers(count or usable_cores())


@contextmanager
def _bars() -> Iterator[Callable[[str, int, int], None]]:
    """A bar a phase with the time that is left, on the error stream."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=people, transient=True) as progress:
        tasks = {phase: progress.add_task(text, total=None) for phase, text in PHASES.items()}
        yield lambda phase, done, total: progress.update(tasks[phase], completed=done, total=total)


def _print_report(report: "ArchiveReport", out: Path) -> None:
    said = (
        f"{report.files - len(report.failures)} of {report.files} files, "
        f"{report.turbines} turbine{'s' * (report.turbines != 1)}: {report.identified} windows "
        f"identified, {report.rejected} rejected, {report.posteriors} posteriors, "
        f"{report.events} events"
    )
    output.print(said)
    if report.found_finished:
        output.print(f"{report.found_finished} results were finished before, {report.done_now} now")
    for copy in report.copies:
        people.print(f"{copy} is a copy of another file and was not used twice")
    for failure in report.failures:
        text = failure.text if failure.path in failure.text else f"{failure.path}: {failure.text}"
        people.print(f"[bold red]pilewatch:[/] {escaped(text)}", soft_wrap=True)
    output.print(f"in {out}: {', '.join(path.name for path in report.tables)}")
