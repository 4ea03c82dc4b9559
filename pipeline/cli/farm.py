"""`pilewatch farm` and `reprocess`: pool a farm's turbines, process an archive."""

import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, closing, contextmanager, nullcontext
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from pipeline.cli.console import (
    JsonOption,
    SamplerOption,
    ScenarioOption,
    ZenohConfigOption,
    escape_markup,
    output,
    print_json,
    progress_bars,
    stderr,
    stop_on_signals,
    zenoh_settings,
)
from pipeline.state.phrases import count_noun
from sensors.errors import InputError

if TYPE_CHECKING:
    from pipeline.archive.reprocessing import ArchiveReport
    from pipeline.archive.work import Workers
    from pipeline.farm.farm import Farm
    from pipeline.farm.sources import FarmMessage

HIGHEST_RHAT = 1.1  # R-hat of a pooling above which a warning is printed


def farm(
    files: Annotated[
        list[Path] | None,
        typer.Argument(
            help="Sessions or recordings with posteriors, or folders of them: of each turbine the "
            "latest by time; without any, the running session of --out or --connect."
        ),
    ] = None,
    connect: Annotated[
        str | None, typer.Option(help="Zenoh endpoint of a running session or router.")
    ] = None,
    zenoh_config: ZenohConfigOption = None,
    out: Annotated[Path, typer.Option(help="Folder of the running session.")] = Path("out"),
    prior: Annotated[
        Path | None,
        typer.Option(
            help="Write the farm's prior of a further turbine, for [updating] population."
        ),
    ] = None,
    table: Annotated[
        Path | None, typer.Option(help="Write a Parquet table, one row per turbine and spring.")
    ] = None,
    follow: Annotated[
        bool,
        typer.Option(
            "--follow", help="Pool again with every new posterior and publish, until stopped."
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Pool the posteriors of similar turbines: narrower intervals, and outliers."""
    if files and (connect or zenoh_config or follow):
        raise InputError(
            "FILES are recordings; --connect, --zenoh-config and --follow exclude them"
        )
    if files:
        from pipeline.farm.sources import recorded_turbines

        _pool_and_print(recorded_turbines(files), prior, table, as_json)
        return
    _pool_running_sessions(
        _farm_endpoint(connect, zenoh_config, out), follow, prior, table, as_json
    )


def _farm_endpoint(connect: str | None, zenoh_config: Path | None, out: Path) -> Any:
    """Return how the running sessions are reached."""
    from pipeline.monitoring.status import endpoint_of

    if zenoh_config is not None:
        return zenoh_settings("peer", None, None, zenoh_config)
    endpoint = endpoint_of(out) if connect is None else connect
    return zenoh_settings("client", None, [endpoint], None)


def _pool_running_sessions(
    settings: Any, follow: bool, prior: Path | None, parquet: Path | None, as_json: bool
) -> None:
    from pipeline.farm.results import pooled_posterior
    from pipeline.farm.settings import FarmError
    from pipeline.farm.sources import RunningFarm
    from pipeline.transport.zenoh_bus import ZenohBus

    with closing(ZenohBus(settings)) as bus, closing(RunningFarm(bus)) as running:
        if not follow:
            _pool_and_print(running.messages(), prior, parquet, as_json)
            return
        with stop_on_signals() as stopping:
            for messages in running.rounds(stopping):
                try:
                    found = _pool_and_print(messages, prior, parquet, as_json)
                except FarmError as error:  # too few as yet
                    stderr.print(escape_markup(str(error)), soft_wrap=True)
                    continue
                for turbine in found.turbines:
                    bus.publish(pooled_posterior(found, turbine))


def _pool_and_print(
    messages: "Sequence[FarmMessage]",
    prior: Path | None,
    parquet: Path | None,
    as_json: bool,
) -> "Farm":
    from pipeline.farm.farm import pooled_farm
    from pipeline.farm.results import farm_json, write_parquet
    from sensors.arrays import one_blas_thread

    with one_blas_thread():
        found = pooled_farm(messages)
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
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise InputError(f"cannot write {path}: {error.strerror}") from error


def _print(found: "Farm") -> None:
    from pipeline.cli.tables.posteriors import farm_table

    output.print(farm_table(found))
    for turbine in found.turbines:
        if turbine.outlying:
            output.print(f"[bold red]outlier:[/] {escape_markup(turbine.text)}", soft_wrap=True)
    if not found.rhat <= HIGHEST_RHAT:
        text = f"the chains of the pooling disagree (R-hat {found.rhat:.2f}): intervals are rough"
        output.print(f"[yellow]{text}[/]", soft_wrap=True)
    for each in found.left_out:
        output.print(
            f"{escape_markup(each.turbine)} left out: {escape_markup(each.reason)}", soft_wrap=True
        )


PHASES = {"reading": "files read", "identifying": "files identified", "updating": "windows updated"}


def reprocess(
    archive: Annotated[
        list[str],
        typer.Argument(
            help="Recordings: files, folders, patterns in quotes ('archive/**/*.mcap')."
        ),
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", help="Folder of results and intermediate files.")
    ] = Path("results"),
    cluster: Annotated[
        str | None,
        typer.Option(help="A Dask scheduler (tcp://HOST:8786) whose workers can read the archive."),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine; default: as many as it has cores."),
    ] = None,
    serial: Annotated[
        bool, typer.Option("--serial", help="In this process only; the results are bit-identical.")
    ] = False,
    sampler: SamplerOption = None,
    scenario: ScenarioOption = None,
    as_json: JsonOption = False,
) -> None:
    """Identify and update years of recordings in parallel; a repeated call continues."""
    from pipeline.archive.reprocessing import reprocessed
    from pipeline.archive.survey import archive_files

    files = archive_files(archive)
    try:
        with _workers(cluster, workers, serial) as chosen, _progress_bars() as bars:
            report = reprocessed(
                files, out, chosen, scenario=scenario, sampler=sampler, report=bars
            )
    except KeyboardInterrupt:
        text = f"Stopped. Finished results are kept in {out}; the same command continues."
        stderr.print(escape_markup(text))
        raise typer.Exit(130) from None
    if as_json:
        print_json(asdict(report) | {"out": out})
    else:
        _print_report(report, out)
    if report.failures or report.salvaged:
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
def _progress_bars() -> Iterator[Callable[[str, int, int], None]]:
    """Draw one progress bar per phase on the error stream."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with progress_bars(*columns) as progress:
        tasks = {phase: progress.add_task(text, total=None) for phase, text in PHASES.items()}
        yield lambda phase, done, total: progress.update(tasks[phase], completed=done, total=total)


def _print_report(report: "ArchiveReport", out: Path) -> None:
    text = (
        f"{report.files - len(report.failures)} of {report.files} files, "
        f"{count_noun(report.turbines, 'turbine')}: {report.identified} windows "
        f"identified, {report.rejected} rejected, {report.posteriors} posteriors, "
        f"{report.events} events"
    )
    if report.files > len(report.failures):
        output.print(text)
        names = ", ".join(path.name for path in report.tables)
        output.print(escape_markup(f"in {out}: {names}"))
    if report.found_finished:
        output.print(f"{report.found_finished} results existed already, {report.done_now} are new")
    for copy in report.copies:
        text = f"{copy.path} is a copy of {copy.original} and was skipped"
        stderr.print(escape_markup(text), soft_wrap=True)
    for warning in report.warnings:
        text = f"{warning.turbine}: {warning.text}"
        stderr.print(f"[bold yellow]pilewatch:[/] {escape_markup(text)}", soft_wrap=True)
    for each in report.salvaged:
        text = f"{each.path} {each.text}"
        stderr.print(f"[bold yellow]pilewatch:[/] {escape_markup(text)}", soft_wrap=True)
    for failure in report.failures:
        text = failure.text if failure.path in failure.text else f"{failure.path}: {failure.text}"
        stderr.print(f"[bold red]pilewatch:[/] {escape_markup(text)}", soft_wrap=True)
