"""An archive of many files: in series, by two processes, with a worker killed, stopped and resumed.

python -m tests.benchmarks reprocess [--files 240] [--minutes 10] [--workers 2] [--folder FOLDER]
                                     [--part series parallel trouble]

The archive is one simulation of the parked turbine cut into files; windows are as long as a file.
`parallel` must give the tables of `series` byte by byte, and so must `trouble`: a worker is killed
when a quarter of the files are identified, the run is stopped at half of them and begun again.
Results in FOLDER are found again, so that parts may be run one after the other. Wall time depends
on what else the machine does: CPU and load are told beside it.
"""

import argparse
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from pipeline.fleet.archive import ArchiveReport, reprocessed
from pipeline.fleet.archive_dask import local_workers
from pipeline.fleet.archive_work import ThisProcess, Workers
from pipeline.scenario import scenario_from_text
from pipeline.sources import record_simulation, simulated
from tests.pipeline.fleet.archives import cut_into_files

SCENARIO = """
title = "An archive to reprocess"
seed = 11

[simulation]
duration = {duration}
[oma]
window_duration = {window}
hop = {window}
"""


@dataclass(frozen=True, slots=True)
class Cost:
    """What one run took."""

    wall: float  # [s]
    cpu: float  # of this process and all its workers [s]
    own: float  # of this process [s]
    load: float  # of the machine over the last minute, at the end
    memory: float  # the largest worker's peak [MB]


class _Stopped(Exception):  # noqa: N818  # as if by Ctrl-C
    pass


def main(arguments: list[str]) -> None:
    """Print wall and CPU time of every part, and whether the tables are the same."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks reprocess")
    parser.add_argument("--files", type=int, default=240)
    parser.add_argument("--minutes", type=float, default=10.0, help="of each file")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--folder", type=Path, help="for archive and results; kept")
    parser.add_argument("--part", nargs="+", default=["series", "parallel", "trouble"])
    options = parser.parse_args(arguments)
    folder = options.folder or Path(tempfile.mkdtemp(prefix="reprocess-"))
    archive = made_archive(folder / "archive", options.files, options.minutes)
    print(f"{len(archive)} files of {options.minutes:g} minutes in {folder}", flush=True)
    costs = {}
    for part in options.part:
        runs = {"series": _series, "parallel": _parallel, "trouble": _trouble}
        cost, report = runs[part](archive, folder / part, options.workers)
        costs[part] = cost
        _print(part, cost, report)
        if part != "series":
            same = tables_of(folder / part) == tables_of(folder / "series")
            print(f"  tables {'equal those in series, byte by byte' if same else 'DIFFER'}")
    if {"series", "parallel"} <= costs.keys():
        series, parallel = costs["series"], costs["parallel"]
        print(
            f"in series / by {options.workers} processes: wall {series.wall / parallel.wall:.2f}, "
            f"CPU {series.cpu / parallel.cpu:.2f}"
        )


def made_archive(folder: Path, files: int, minutes: float) -> list[Path]:
    """The files, made where they are not there yet."""
    if folder.is_dir() and len(found := sorted(folder.glob("*.mcap"))) == files:
        return found
    seconds = 60.0 * minutes
    text = SCENARIO.format(duration=files * seconds, window=seconds)
    with tempfile.TemporaryDirectory() as made:
        whole = Path(made) / "whole.mcap"
        record_simulation(simulated(scenario_from_text(text, "reprocess.toml")), whole)
        return cut_into_files(whole, folder, seconds)


def tables_of(results: Path) -> dict[str, bytes]:
    """Every table's bytes."""
    return {path.name: path.read_bytes() for path in sorted(results.glob("*.parquet"))}


def _series(archive: list[Path], out: Path, _: int) -> tuple[Cost, ArchiveReport]:
    return _measured(lambda: reprocessed(archive, out, ThisProcess()))


def _parallel(archive: list[Path], out: Path, count: int) -> tuple[Cost, ArchiveReport]:
    def run() -> ArchiveReport:
        with local_workers(count) as workers:
            return reprocessed(archive, out, workers)

    return _measured(run)


def _trouble(archive: list[Path], out: Path, count: int) -> tuple[Cost, ArchiveReport]:
    def run() -> ArchiveReport:
        try:
            with local_workers(count) as workers:
                reprocessed(archive, out, workers, report=_troubled(workers))
        except _Stopped:
            print("  stopped; begun again", flush=True)
        with local_workers(count) as workers:
            return reprocessed(archive, out, workers)

    return _measured(run)


def _troubled(workers: Workers) -> Callable[[str, int, int], None]:
    """Kills a worker at a quarter of the identification and stops it at half."""
    killed: list[int] = []

    def follow(phase: str, done: int, total: int) -> None:
        if phase != "identifying":
            return
        if not killed and done >= total // 4:
            pids = workers._client.run(os.getpid)  # type: ignore[attr-defined]
            killed.append(next(iter(pids.values())))
            os.kill(killed[0], signal.SIGKILL)
            print(f"  worker {killed[0]} killed at {done} of {total}", flush=True)
        if done >= total // 2:
            raise _Stopped

    return follow


def _measured(run: Callable[[], ArchiveReport]) -> tuple[Cost, ArchiveReport]:
    wall, own, children = time.monotonic(), time.process_time(), _children()
    report = run()
    own = time.process_time() - own
    cost = Cost(
        wall=time.monotonic() - wall,
        cpu=own + _children() - children,
        own=own,
        load=os.getloadavg()[0],
        memory=resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
    )
    return cost, report


def _children() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _print(part: str, cost: Cost, report: ArchiveReport) -> None:
    print(
        f"{part}: {cost.wall:.0f} s wall, {cost.cpu:.0f} s CPU ({cost.own:.0f} s of it in this "
        f"process), load {cost.load:.1f}; largest worker {cost.memory:.0f} MB"
    )
    print(
        f"  {report.identified} windows identified, {report.rejected} rejected, "
        f"{report.posteriors} posteriors, {report.events} events, {len(report.failures)} failures; "
        f"{report.found_finished} results found finished, {report.done_now} made",
        flush=True,
    )
