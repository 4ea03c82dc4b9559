"""An archive of recordings, reprocessed: `pilewatch reprocess`.

    every file ─► [survey] ─► parts                        parallel
    parts ─► chains ─► tasks ─► [identification]           parallel, one a file and turbine
    days in order ─► [tracking, sums, anchors]             parallel over turbines, a day each
                     [posteriors]                          parallel, some windows each
    months ─► Parquet                                      a row group each day

Every result is kept by the fingerprint of what it was made from: what has been finished is not done
again. A day's pass begins from the state that the day before has left, so that a new day costs the
same after ten years as after one (`history`). The same archive and settings give the same numbers
bit by bit, however many workers there are, in whatever order they finish and however often they are
interrupted.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.archive.access.remote import name_of
from pipeline.archive.history.months import tables_in
from pipeline.archive.history.turbine_history import TurbineHistory
from pipeline.archive.identification import identified_frames
from pipeline.archive.store import FinishedResults, StoredFrame
from pipeline.archive.survey import FileSurvey, SurveyCache, surveyed, without_copies
from pipeline.archive.turbines import archived_turbines
from pipeline.archive.work import Call, Failed, Workers
from sensors.atomic_write import written_whole
from sensors.errors import InputError
from sensors.json_values import fields_of

FINISHED = ".finished"  # folder of what is kept from run to run, within the results
SURVEYS = "surveys.pw"  # file of what is known of the recordings, in that folder
SUMMARY = "reprocess.json"

ProgressReport = Callable[[str, int, int], None]  # phase, done, of how many


@dataclass(frozen=True, slots=True)
class FileFailure:
    """A file, or windows of one, that gave nothing, and why."""

    path: str
    text: str


@dataclass(frozen=True, slots=True)
class CopiedFile:
    """A file whose bytes another one has; it is skipped."""

    path: str
    original: str
    """Path of the other one, which is used."""


@dataclass(frozen=True, slots=True)
class TurbineWarning:
    """What recordings of a turbine do not have in common, and what was made of it."""

    turbine: str
    text: str


@dataclass(slots=True)
class ArchiveReport:
    """What became of an archive."""

    files: int = 0
    turbines: int = 0
    identified: int = 0
    rejected: int = 0
    posteriors: int = 0
    events: int = 0
    found_finished: int = 0
    """Results that an earlier run had left."""
    done_now: int = 0
    copies: tuple[CopiedFile, ...] = ()
    failures: list[FileFailure] = field(default_factory=list)
    salvaged: list[FileFailure] = field(default_factory=list)
    """Files that are used in part."""
    warnings: list[TurbineWarning] = field(default_factory=list)
    tables: tuple[Path, ...] = ()


def reprocessed(
    files: Sequence[Path],
    out: Path,
    workers: Workers,
    *,
    scenario: str | None = None,
    sampler: str | None = None,
    report: ProgressReport = lambda phase, done, total: None,
) -> ArchiveReport:
    """Identify and update everything that the files hold; results as Parquet in `out`.

    Parameters
    ----------
    files : sequence of Path
        Of the archive. One that cannot be read is a failure in the report, and the
        rest goes on.
    out : Path
        Folder of the results.
    workers : Workers
        Where the windows are computed.
    scenario : str, optional
        Name or path, of all turbines; None: of each the one that its newest file was made under.
    sampler : str, optional
        Of the posterior; None: the scenario's.
    report : callable, optional
        Called as things get done, with the phase, how many are done, and how many there are.

    Raises
    ------
    InputError
        If the scenario or the folder is wrong.
    """
    return _Reprocessing(out, workers, report).run(files, scenario, sampler)


def _in_turn(histories: Sequence[TurbineHistory]) -> Iterator[Call | None]:
    """Yield a call of each turbine in turn, as long as any has one; None where all wait."""
    active = [history.calls() for history in histories]
    while active:
        found = False
        for calls in list(active):
            try:
                call = next(calls)
            except StopIteration:
                active.remove(calls)
                found = True
                continue
            if call is not None:
                found = True
                yield call
        if not found:
            yield None


class _Reprocessing:
    """One run over an archive."""

    def __init__(self, out: Path, workers: Workers, report: ProgressReport) -> None:
        try:
            (out / FINISHED).mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise InputError(f"-o {out}: {error.strerror}; a folder is needed") from error
        self._out = out
        self._finished = FinishedResults(out / FINISHED)
        self._workers = workers
        self._report_progress = report
        self._report = ArchiveReport()

    def run(
        self, files: Sequence[Path], scenario: str | None, sampler: str | None
    ) -> ArchiveReport:
        surveys = self._surveys(files)
        turbines = archived_turbines(surveys, scenario, sampler)
        self._report.turbines = len(turbines)
        self._report.warnings = [
            TurbineWarning(each.plan.turbine, text) for each in turbines for text in each.warnings
        ]
        histories = [TurbineHistory(each, self._out, self._finished) for each in turbines]
        self._identify(histories)
        self._update(histories)
        self._count(histories)
        self._report.tables = tuple(tables_in(self._out))
        self._write_summary()
        return self._report

    def _surveys(self, files: Sequence[Path]) -> list[FileSurvey]:
        self._report.files = len(files)
        cache = SurveyCache(self._out / FINISHED / SURVEYS)
        known = {path: cache.get(path) for path in files}
        found = [survey for survey in known.values() if survey is not None]
        calls = (Call(f"survey-{path}", surveyed, path) for path in files if known[path] is None)
        for done, outcome in enumerate(self._workers.outcomes(calls), start=len(found) + 1):
            if isinstance(outcome.result, Failed):
                self._fail(name_of(outcome.call.argument), outcome.result)
            else:
                found.append(outcome.result)
                cache.put(outcome.result.path, outcome.result)
            self._report_progress("reading", done, len(files))
        cache.close()
        found.sort(key=lambda survey: survey.path)
        originals, copies = without_copies(found)
        self._report.salvaged += [
            FileFailure(name_of(survey.path), survey.damage)
            for survey in originals
            if survey.damage
        ]
        used = {survey.fingerprint: name_of(survey.path) for survey in originals}
        self._report.copies = tuple(
            CopiedFile(name_of(copy.path), used[copy.fingerprint]) for copy in copies
        )
        return originals

    def _identify(self, histories: Sequence[TurbineHistory]) -> None:
        """Every task that is not finished yet."""
        missing = [call for history in histories for call in history.missing]
        total = sum(history.n_tasks for history in histories)
        done = total - len(missing)
        self._report.found_finished += done
        self._report_progress("identifying", done, total)
        for outcome in self._workers.outcomes(
            Call(call.key, identified_frames, call) for call in missing
        ):
            done += 1
            if isinstance(outcome.result, Failed):
                self._fail(str(outcome.call.argument.task.path), outcome.result)
            else:
                self._keep(outcome.call.key, outcome.result)
            self._report_progress("identifying", done, total)

    def _update(self, histories: Sequence[TurbineHistory]) -> None:
        """Tracking, sums and posteriors of every turbine, months written as they are whole."""
        total = sum(history.n_days for history in histories)
        for outcome in self._workers.outcomes(_in_turn(histories)):
            failed = isinstance(outcome.result, Failed)
            if failed:
                self._fail("posteriors of some windows", outcome.result)
            else:
                self._keep(outcome.call.key, outcome.result)
            for history in histories:
                if history.settle(outcome.call.key, failed=failed):
                    break
            self._report_progress("updating", sum(history.done for history in histories), total)
        self._report_progress("updating", sum(history.done for history in histories), total)

    def _count(self, histories: Sequence[TurbineHistory]) -> None:
        """What the tables hold now."""
        for history in histories:
            self._report.found_finished += history.found
            for day in history.written:
                self._report.identified += day.identified
                self._report.rejected += day.rejected
                self._report.posteriors += day.posteriors
                self._report.events += day.events

    def _keep(self, key: str, frames: tuple[StoredFrame, ...]) -> None:
        self._finished.put(key, frames)
        self._report.done_now += 1

    def _fail(self, path: str, failed: Failed) -> None:
        self._report.failures.append(FileFailure(path, failed.text))

    def _write_summary(self) -> None:
        report = self._report
        summary = {
            "files": report.files,
            "copies": [{"file": each.path, "original": each.original} for each in report.copies],
            **fields_of(report, "turbines", "identified", "rejected", "posteriors", "events"),
            "failures": [{"file": each.path, "reason": each.text} for each in report.failures],
            "salvaged": [{"file": each.path, "damage": each.text} for each in report.salvaged],
            "warnings": [fields_of(each, "turbine", "text") for each in report.warnings],
            "tables": [path.name for path in report.tables],
        }
        text = json.dumps(summary, indent=1, ensure_ascii=False) + "\n"
        written_whole(self._out / SUMMARY, text.encode())
