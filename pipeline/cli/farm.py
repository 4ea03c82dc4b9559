"""`pilewatch farm`: what the turbines of a farm say of each other."""

import json
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from pipeline.cli.console import (
    JsonOption,
    ZenohConfigOption,
    escaped,
    output,
    people,
    stopped_by_signals,
    zenoh_settings,
)

if TYPE_CHECKING:
    from pipeline.farm.farm import Farm
    from pipeline.messages import FoundationPosterior
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import TYPE_CHECKING

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.cli.console import ScenarioOption
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.archive.reprocessing import ArchiveReport
    from pipeline.archive.work import Workers

ROUGH = 1.1  # R-hat of a pooling beyond which its intervals are called rough


def farm(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Sessions or recordings with posteriors, or folders of them; without any, the "
            "session that runs in --out or at --connect."
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Zenoh endpoint of a session or router that runs.")
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the session that runs.")] = Path("out"),
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Write what the farm says of one more turbine, for [updating] population."
        ),
    ] = None,
    parquet: Annotated[
        Path | None, typer.Option(help="Write a table, one row a turbine and spring.")
    ] = None,
    follow: Annotated[
        bool,
        typer.Option(
            "--follow", help="Pool again when posteriors come, and publish, until stopped."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Pool the posteriors of turbines alike: sharper springs, and those unlike the others."""
    from sensors.errors import InputError

    if files and (connect or zenoh_config or follow):
        raise InputError("FILES are recordings; --connect, --zenoh-config and --follow need none")
    if files:
        from pipeline.farm.sources import recorded_posteriors

        _tell(recorded_posteriors(files), prior, parquet, as_json)
        return
    _of_running_sessions(_whom(connect, zenoh_config, out), follow, prior, parquet, as_json)


def _whom(connect: str | None, zenoh_config: Path | None, out: Path) -> Any:
    """How the sessions that run are reached."""
    from pipeline.monitoring.status import endpoint_of

    if zenoh_config is not None:
        return zenoh_settings("peer", None, None, zenoh_config)
    endpoint = endpoint_of(out) if connect is None else connect
    return zenoh_settings("client", None, [endpoint], None)


def _of_running_sessions(
    settings: Any, follow: bool, prior: Path | None, parquet: Path | None, as_json: bool
) -> None:
    from pipeline.farm.results import pooled_posterior
    from pipeline.farm.settings import FarmError
    from pipeline.farm.sources import RunningFarm
    from pipeline.transport.zenoh_bus import ZenohBus

    with closing(ZenohBus(settings)) as bus, closing(RunningFarm(bus)) as running:
        if not follow:
            _tell(running.posteriors(), prior, parquet, as_json)
            return
        with stopped_by_signals() as stopping:
            for posteriors in running.rounds(stopping):
                try:
                    found = _tell(posteriors, prior, parquet, as_json)
                except FarmError as error:  # too few as yet
                    people.print(escaped(str(error)), soft_wrap=True)
                    continue
                for turbine in found.turbines:
                    bus.publish(pooled_posterior(found, turbine))


def _tell(
    posteriors: "Sequence[FoundationPosterior]",
    prior: Path | None,
    parquet: Path | None,
    as_json: bool,
) -> "Farm":
    from pipeline.farm.farm import pooled_farm
    from pipeline.farm.results import farm_json, write_parquet
    from pipeline.runtime.runner import one_blas_thread

    with one_blas_thread():
        found = pooled_farm(posteriors)
    if prior is not None:
        _write(prior, found.population.as_json())
    if parquet is not None:
        write_parquet(found, parquet)
    if as_json:
        output.print_json(json.dumps(farm_json(found), allow_nan=False))
    else:
        _print(found)
    return found


def _write(path: Path, text: str) -> None:
    from sensors.errors import InputError

    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error


def _print(found: "Farm") -> None:
    from pipeline.cli.tables.posteriors import farm_table

    output.print(farm_table(found))
    for turbine in found.turbines:
        if turbine.outlying:
            output.print(f"[bold red]unlike:[/] {escaped(turbine.text)}", soft_wrap=True)
    if not found.rhat <= ROUGH:
        text = f"the chains of the pooling disagree (R-hat {found.rhat:.2f}): intervals are rough"
        output.print(f"[yellow]{text}[/]", soft_wrap=True)
    for each in found.left_out:
        output.print(f"{escaped(each.turbine)} left out: {escaped(each.reason)}", soft_wrap=True)


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
