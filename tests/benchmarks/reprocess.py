"""An archive of many files: in series, by two processes, with a worker killed, stopped and resumed.

python -m tests.benchmarks reprocess [--files 240] [--minutes 10] [--workers 2] [--folder FOLDER]
                                     [--part series parallel trouble] [--limit SECONDS]

The archive is one simulation of the parked turbine cut into files; windows are as long as a file.
`parallel` must give the tables of `series` byte by byte, and so must `trouble`: a worker is killed
when a quarter of the files are identified, the run is stopped at half of them and begun again.
Results in FOLDER are found again: parts may be run one after the other, and a run that `--limit`
ends goes on with the same command, its costs added up. Wall time depends on what else the machine
does: CPU and load are told beside it.

What it gave with --files 60 on two quiet cores: 161 s in series, 93 s by two processes, 1.73 times
as fast, 177 s CPU against 161 s; the tables equal byte by byte.
"""

import argparse
import json
import os
import resource
import signal
import tempfile
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path

from pipeline.archive.cluster import local_workers
from pipeline.archive.reprocessing import ArchiveReport, ProgressReport, reprocessed
from pipeline.archive.work import ThisProcess, Workers
from pipeline.scenario import scenario_from_text
from pipeline.sources.sources import record_simulation, simulated
from tests.pipeline.archive.archives import cut_into_files, tables_of

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
    """What a part took, in all its runs."""

    wall: float = 0.0  # [s]
    cpu: float = 0.0  # of this process and all its workers [s]
    own: float = 0.0  # of this process [s]
    load: float = 0.0  # of the machine over the last minute, the largest at the end of a run
    memory: float = 0.0  # the largest worker's peak [MB]

    def __add__(self, other: "Cost") -> "Cost":
        return Cost(
            self.wall + other.wall,
            self.cpu + other.cpu,
            self.own + other.own,
            max(self.load, other.load),
            max(self.memory, other.memory),
        )


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
    parser.add_argument("--limit", type=float, default=float("inf"), help="of this run [s]")
    options = parser.parse_args(arguments)
    until = time.monotonic() + options.limit
    folder = options.folder or Path(tempfile.mkdtemp(prefix="reprocess-"))
    archive = made_archive(folder / "archive", options.files, options.minutes)
    print(f"{len(archive)} files of {options.minutes:g} minutes in {folder}", flush=True)
    costs = {}
    for part in options.part:
        run = {"series": _series, "parallel": _parallel, "trouble": _trouble}[part]
        try:
            report = _measured(folder / f"{part}.json", run, archive, folder / part, options, until)
        except _Stopped:
            print(f"{part}: stopped by --limit; the same command goes on", flush=True)
            return
        costs[part] = _cost_in(folder / f"{part}.json")
        _print(part, costs[part], report)
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


def _series(archive: list[Path], out: Path, _: int, follow: ProgressReport) -> ArchiveReport:
    return reprocessed(archive, out, ThisProcess(), report=follow)


def _parallel(archive: list[Path], out: Path, count: int, follow: ProgressReport) -> ArchiveReport:
    with local_workers(count) as workers:
        return reprocessed(archive, out, workers, report=follow)


def _trouble(archive: list[Path], out: Path, count: int, follow: ProgressReport) -> ArchiveReport:
    try:
        with local_workers(count) as workers:
            reprocessed(archive, out, workers, report=_troubled(workers))
    except _Stopped:
        print("  stopped; begun again", flush=True)
    return _parallel(archive, out, count, follow)


def _troubled(workers: Workers) -> ProgressReport:
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


def _measured(
    kept: Path,
    run: Callable[[list[Path], Path, int, ProgressReport], ArchiveReport],
    archive: list[Path],
    out: Path,
    options: argparse.Namespace,
    until: float,
) -> ArchiveReport:
    """What the run reports; its cost goes to the file of its part."""

    def follow(phase: str, done: int, total: int) -> None:
        if time.monotonic() > until:
            raise _Stopped

    wall, own, children = time.monotonic(), time.process_time(), _children()
    try:
        return run(archive, out, options.workers, follow)
    finally:
        own = time.process_time() - own
        cost = Cost(
            wall=time.monotonic() - wall,
            cpu=own + _children() - children,
            own=own,
            load=os.getloadavg()[0],
            memory=resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss / 1024,
        )
        kept.write_text(json.dumps(asdict(_cost_in(kept) + cost)))


def _cost_in(kept: Path) -> Cost:
    return Cost(**json.loads(kept.read_text())) if kept.exists() else Cost()


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
