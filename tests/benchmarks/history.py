"""A new day into ten years of one turbine: `python -m tests.benchmarks history`.

    [--years 10] [--new-day 2026-01-13] [--files-a-day 24] [--posteriors 2] [--seed 9001]

Modal estimates are drawn about the turbine's modes as ten minutes give them, 40 modes each with
the covariance of 40 blocks; no samples are simulated. All files of the ten years are there by name,
with their surveys, tasks and fingerprints. The days of the last month are passed and written in
full; of the 119 months before, Parquet files without rows and the list of their days stand for what
a new day does not read. The state after a day does not grow with the days before it.

Measured is the second run, with one more day of 144 windows: a look at all files, their plan, the
day's pass (tracking, sums, anchors) and the month's tables. The posteriors between anchors go to
workers and cost what they cost in a session; some of them are timed by themselves.
"""

import argparse
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass
from datetime import date, timedelta
from functools import cache
from pathlib import Path

import numpy as np

from pipeline.archive.history.months import MonthWriter, WrittenMonth
from pipeline.archive.history.turbine_history import (
    TurbineHistory,
    days_of,
    history_plan,
    state_key,
)
from pipeline.archive.posteriors import posteriors
from pipeline.archive.reprocessing import FINISHED, SURVEYS
from pipeline.archive.store import FinishedResults
from pipeline.archive.survey import FileSurvey, Part, SurveyCache, archive_files, surveyed
from pipeline.archive.turbines import TurbineArchive, archived_turbines
from pipeline.archive.work import Call, Outcome
from pipeline.messages import ModalEstimate, Mode
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout
from sensors.arrays import FloatArray
from sensors.dynamics.modal_model import ModalModel
from sensors.structure.description import load_turbine
from tests.benchmarks._drawn import TrueModes
from tests.benchmarks._results import keep
from tests.pipeline.archive.modal_archives import WINDOW, keep_windows, time_of

RECORDING = Path(__file__).parents[2] / "recordings" / "parked.mcap"  # its layout and scenario
NEW_DAY = "2026-01-13"
RATE = 40.0  # of the samples that were never drawn [Hz]
BLOCKS = 40  # of a covariance
MODES = 40


@dataclass(frozen=True, slots=True)
class NewDay:
    """What one more day costs."""

    windows: int
    """Of all days, the new one among them."""
    files: int
    days_passed: int
    """By the new run."""
    survey_ms_a_file: float
    """Of an unchanged file, the file of surveys read and the folder listed. [ms CPU]"""
    look_cpu: float
    """Listing, surveys, plan, fingerprints. [s]"""
    pass_cpu: float
    """Tracking, sums and anchors of the new day. [s]"""
    anchors: int
    """Posteriors that the pass itself draws."""
    tables_cpu: float
    """The month's Parquet files and what is kept. [s]"""
    cpu: float
    """Of the run but for posteriors between anchors. [s]"""
    posteriors_left: int
    """To workers."""
    posterior_cpu: float
    """Of one of these. [s]"""
    kept_bytes_a_window: float
    """Identified windows, states and surveys, without the tables."""
    table_bytes_a_window: float
    """Of modes, shapes and anchors' posteriors."""


class Drawn:
    """Estimates of windows, drawn about the turbine's modes."""

    def __init__(self, layout: SensorLayout, seed: int) -> None:
        model = ModalModel(load_turbine("iea15mw_monopile"), layout)
        self._true = TrueModes.of(model, np.ones(3), layout)
        self._layout, self._seed = layout, seed

    def __call__(self, window: int) -> ModalEstimate:
        generator, true, layout = (
            np.random.default_rng([self._seed, window]),
            self._true,
            self._layout,
        )
        values = true.values + true.deviations * generator.standard_normal(true.values.shape)
        modes = [
            _mode(row, deviations, generator)
            for row, deviations in zip(values[:MODES], true.deviations[:MODES], strict=True)
        ]
        return ModalEstimate(
            turbine=layout.turbine,
            window=0,
            start_ns=0,
            end_ns=WINDOW,
            layout_id=layout.layout_id,
            channels=layout.channel_names,
            modes=tuple(sorted(modes, key=lambda mode: mode.frequency)),
        )


def _mode(values: FloatArray, deviations: FloatArray, generator: np.random.Generator) -> Mode:
    shape = np.where(deviations[1:] > 0, np.clip(values[1:], -0.999, 0.999), values[1:])
    scale = np.concatenate([[deviations[0], 0.001], deviations[1:]])
    factor = generator.standard_normal((len(scale), BLOCKS)) * scale[:, None] / np.sqrt(BLOCKS)
    return Mode(
        name="",
        frequency=float(values[0]),
        frequency_std=float(np.linalg.norm(factor[0])),
        damping_ratio=0.008,
        damping_ratio_std=0.001,
        shape=shape,
        covariance_factor=factor,
        n_block_columns=BLOCKS,
    )


@cache
def shipped() -> FileSurvey:
    """Layout and scenario of the shipped recording."""
    return surveyed(RECORDING)


def file_surveys(folder: Path, first: date, days: int, files_a_day: int) -> list[FileSurvey]:
    """Files that join: each has a name, a size and a time, but no samples."""
    folder.mkdir(parents=True, exist_ok=True)
    (layout,) = shipped().layouts
    length = round(86_400 / files_a_day * RATE)
    blocks, begin = round(length / RATE), time_of(first.isoformat())
    surveys = []
    for number in range(days * files_a_day):
        path = folder / f"{number:06d}.mcap"
        path.touch()
        part = Part(
            path=path,
            fingerprint=f"{number:032x}",
            turbine=layout.turbine,
            unit=layout.unit,
            session="s",
            layout_id=layout.layout_id,
            sampling_rate=RATE,
            n_channels=len(layout.channels),
            n_blocks=blocks,
            gaps=(),
            first_sample=number * length,
            next_sample=(number + 1) * length,
            first_sequence=number * blocks,
            last_sequence=(number + 1) * blocks - 1,
            start_ns=begin + number * blocks * NANOSECONDS,
            end_ns=begin + (number + 1) * blocks * NANOSECONDS,
        )
        surveys.append(FileSurvey(path, part.fingerprint, (part,), (layout,), shipped().scenario))
    return surveys


class Workers:
    """Does the passes; the posteriors of windows between anchors are noted and left empty."""

    def __init__(self) -> None:
        self.passes = 0
        self.cpu = 0.0  # of passes [s]
        self.left: list[Call] = []

    def outcomes(self, calls: Iterable[Call | None]) -> Iterator[Outcome]:
        """Yield the outcome of each call."""
        for call in calls:
            if call is not None and call.function is posteriors:
                self.left.append(call)
                yield Outcome(call, ())
            elif call is not None:
                started = time.process_time()
                result = call.function(call.argument)
                self.cpu += time.process_time() - started
                self.passes += 1
                yield Outcome(call, result)


def run(history: TurbineHistory, finished: FinishedResults) -> Workers:
    """Do all that is missing of the history."""
    workers = Workers()
    for outcome in workers.outcomes(history.calls()):
        finished.put(outcome.call.key, outcome.result)
        history.settle(outcome.call.key, failed=False)
    return workers


def stand_in(turbine: TurbineArchive, results: Path, finished: FinishedResults, month: str) -> None:
    """Days before that month as if they had been written, without rows and with no state."""
    plan = history_plan(turbine)
    key, writers = plan.key, dict[str, MonthWriter]()
    for day in days_of(turbine.identification, turbine.plan.gaps):
        if day.month < month:
            key = day.key(key, [True] * len(day.calls))
            if day.month not in writers:
                before = WrittenMonth()
                writers[day.month] = MonthWriter(results, plan.turbine, day.month, before)
            writers[day.month].add(day.date, key, (), whole=True)
    for writer in writers.values():
        writer.finished()
    finished.put(state_key(key), ())


def identify(turbine: TurbineArchive, finished: FinishedResults, drawn: Drawn, since: str) -> int:
    """Put drawn windows where identification would, from that day on; how many there are."""
    first = windows = 0
    for day in days_of(turbine.identification, turbine.plan.gaps):
        for call in day.calls:
            if day.date >= since:
                windows += call.task.n_windows
                if call.key not in finished:
                    keep_windows(finished, call, drawn, first)
            first += call.task.n_windows
    return windows


def looked_at(results: Path, archive: Path, files: int) -> tuple[list[FileSurvey], float]:
    """The surveys of unchanged files, and the time that they take [s CPU]."""
    started = time.process_time()
    paths = archive_files([str(archive)])[:files]
    cache = SurveyCache(results / FINISHED / SURVEYS)
    found = [survey for path in paths if (survey := cache.get(path)) is not None]
    if len(found) != files:
        raise RuntimeError(f"{files - len(found)} unchanged files were not found again")
    return found, time.process_time() - started


def measured(folder: Path, chosen: argparse.Namespace) -> NewDay:
    """An archive up to the new day, then the new day."""
    results, month = folder / "results", chosen.new_day[:7]
    new_day = date.fromisoformat(chosen.new_day)
    month_begins = new_day.replace(day=1)
    finished = FinishedResults(results / FINISHED)
    first = month_begins - timedelta(days=round(365.25 * chosen.years))
    surveys = file_surveys(
        folder / "archive", first, (new_day - first).days + 1, chosen.files_a_day
    )
    cached = SurveyCache(results / FINISHED / SURVEYS)
    for survey in surveys:
        cached.put(survey.path, survey)
    cached.close()
    drawn = Drawn(shipped().layouts[0], chosen.seed)

    old, _ = looked_at(results, folder / "archive", len(surveys) - chosen.files_a_day)
    (turbine,) = archived_turbines(old, None, None)
    stand_in(turbine, results, finished, month)
    identify(turbine, finished, drawn, month_begins.isoformat())
    run(TurbineHistory(turbine, results, finished), finished)
    (turbine,) = archived_turbines(surveys, None, None)
    written = identify(turbine, finished, drawn, month_begins.isoformat())

    started = time.process_time()
    found, survey_cpu = looked_at(results, folder / "archive", len(surveys))
    (turbine,) = archived_turbines(found, None, None)
    history = TurbineHistory(turbine, results, finished)
    missing = history.missing
    look_cpu = time.process_time() - started
    workers = run(history, finished)
    cpu = time.process_time() - started
    if missing:
        raise RuntimeError(f"{len(missing)} tasks would be identified again")

    started = time.process_time()
    timed = workers.left[: chosen.posteriors]
    windows_timed = sum(len(call.argument.estimates) for call in timed)
    for call in timed:
        posteriors(call.argument)
    posterior_cpu = (time.process_time() - started) / max(1, windows_timed)
    left = sum(len(call.argument.estimates) for call in workers.left)
    kept = _size(results / FINISHED, "??/*.pw") / written
    kept += (results / FINISHED / SURVEYS).stat().st_size / turbine.n_windows
    return NewDay(
        windows=turbine.n_windows,
        files=len(found),
        days_passed=workers.passes,
        survey_ms_a_file=1000 * survey_cpu / len(found),
        look_cpu=look_cpu,
        pass_cpu=workers.cpu,
        anchors=workers.passes * 144 - left,
        tables_cpu=cpu - look_cpu - workers.cpu,
        cpu=cpu,
        posteriors_left=left,
        posterior_cpu=posterior_cpu,
        kept_bytes_a_window=kept,
        table_bytes_a_window=_size(results, f"*/*/month={month}/*.parquet") / written,
    )


def _size(folder: Path, pattern: str) -> int:
    return sum(path.stat().st_size for path in folder.glob(pattern))


def arguments_of(arguments: Sequence[str]) -> argparse.Namespace:
    """What was chosen."""
    parser = argparse.ArgumentParser(prog="python -m tests.benchmarks history")
    parser.add_argument("--years", type=float, default=10.0)
    parser.add_argument("--new-day", default=NEW_DAY, help="its month is written in full before it")
    parser.add_argument("--files-a-day", type=int, default=24)
    parser.add_argument("--posteriors", type=int, default=2, help="calls of some windows timed")
    parser.add_argument("--seed", type=int, default=9001)
    return parser.parse_args(arguments)


def main(arguments: Sequence[str]) -> None:
    """Measure, print, write the result."""
    chosen = arguments_of(arguments)
    with tempfile.TemporaryDirectory() as name:
        found = measured(Path(name), chosen)
    print(found)
    keep(
        "history",
        asdict(found),
        command=f"python -m tests.benchmarks history --years {chosen.years:g} "
        f"--new-day {chosen.new_day} --files-a-day {chosen.files_a_day} "
        f"--posteriors {chosen.posteriors} --seed {chosen.seed}",
        seeds=[chosen.seed],
        depends=["pipeline/archive", "pipeline/oma/tracking.py", "pipeline/updating"],
    )
