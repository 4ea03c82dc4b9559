"""An archive of recordings, reprocessed: `pilewatch reprocess`.

    every file ─► [survey] ─► parts                        parallel
    parts ─► chains ─► tasks ─► [identification]           parallel, one a file and turbine
    windows in order ─► [tracking] ─► [sums, anchors]      serial, milliseconds a window
                                      [posteriors]         parallel, some windows each
    all in order ─► Parquet

Every result is kept by the fingerprint of what it was made from: what has been finished is not done
again. The same archive and settings give the same numbers bit by bit, however many workers there
are, in whatever order they finish and however often they are interrupted.
"""

import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from pipeline.archive.identification import identified_frames
from pipeline.archive.posteriors import PosteriorPass
from pipeline.archive.store import (
    FinishedResults,
    StoredFrame,
    messages_in,
)
from pipeline.archive.survey import FileSurvey, SurveyCache, surveyed, without_copies
from pipeline.archive.tables import ArchiveTables, ReprocessingRecord
from pipeline.archive.tracking import ArchiveTracking
from pipeline.archive.turbines import TurbineArchive, archived_turbines
from pipeline.archive.work import Call, Failed, Workers
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.recording.atomic_write import written_whole
from sensors.errors import InputError

FINISHED = ".finished"  # folder of what is kept from run to run, within the results
SURVEYS = ".surveys"  # the same for what is known of files that have not changed
SUMMARY = "reprocess.json"

ProgressReport = Callable[[str, int, int], None]  # phase, done, of how many


@dataclass(frozen=True, slots=True)
class FileFailure:
    """A file, or windows of one, that gave nothing, and why."""

    path: str
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
    found_finished: int = 0  # results that an earlier run had left
    done_now: int = 0
    copies: tuple[Path, ...] = ()  # files whose bytes another one has
    failures: list[FileFailure] = field(default_factory=list)
    salvaged: list[FileFailure] = field(default_factory=list)  # files that are used in part
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

    scenario   name or path, of all turbines; None: of each the one that its newest file was made
               under
    report     called as things get done

    A file that cannot be read is a failure in the report, and the rest goes on. Raises InputError
    where the scenario or the folder is wrong.
    """
    return _Reprocessing(out, workers, report).run(files, scenario, sampler)


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
        self._say = report
        self._report = ArchiveReport()

    def run(
        self, files: Sequence[Path], scenario: str | None, sampler: str | None
    ) -> ArchiveReport:
        surveys = self._surveys(files)
        turbines = archived_turbines(surveys, scenario, sampler)
        self._report.turbines = len(turbines)
        self._identify(turbines)
        tables = ArchiveTables(self._out)
        self._write_histories(turbines, tables)
        self._report.tables = tables.finished()
        self._write_summary()
        return self._report

    def _surveys(self, files: Sequence[Path]) -> list[FileSurvey]:
        self._report.files = len(files)
        cache = SurveyCache(FinishedResults(self._out / SURVEYS))
        known = {path: cache.get(path) for path in files}
        found = [survey for survey in known.values() if survey is not None]
        calls = (Call(f"survey-{path}", surveyed, path) for path in files if known[path] is None)
        for done, outcome in enumerate(self._workers.outcomes(calls), start=len(found) + 1):
            if isinstance(outcome.result, Failed):
                self._fail(str(outcome.call.argument), outcome.result)
            else:
                found.append(outcome.result)
                cache.put(outcome.result.path, outcome.result)
            self._say("reading", done, len(files))
        found.sort(key=lambda survey: survey.path)
        originals, copies = without_copies(found)
        self._report.salvaged += [
            FileFailure(str(survey.path), survey.damage) for survey in originals if survey.damage
        ]
        self._report.copies = tuple(copy.path for copy in copies)
        return originals

    def _identify(self, turbines: Sequence[TurbineArchive]) -> None:
        """Every task that is not finished yet."""
        total = sum(len(turbine.plan.tasks) for turbine in turbines)
        done = 0
        calls = []
        for turbine in turbines:
            for call in turbine.identification:
                if call.key in self._finished:
                    done += 1
                else:
                    calls.append(Call(call.key, identified_frames, call))
        self._report.found_finished += done
        self._say("identifying", done, total)
        for outcome in self._workers.outcomes(calls):
            done += 1
            if isinstance(outcome.result, Failed):
                self._fail(str(outcome.call.argument.task.path), outcome.result)
            else:
                self._keep(outcome.call.key, outcome.result)
            self._say("identifying", done, total)

    def _write_histories(self, turbines: Sequence[TurbineArchive], tables: ArchiveTables) -> None:
        """Tracking, sums and posteriors of every turbine; everything in order into the tables."""
        ledger = ReprocessingRecord(self._counted(tables))
        total = sum(turbine.n_windows for turbine in turbines)
        calls = self._history_calls(turbines, ledger, total)
        for outcome in self._workers.outcomes(calls):
            if isinstance(outcome.result, Failed):
                self._fail("posteriors of some windows", outcome.result)
                ledger.settle(outcome.call.key, ())
            else:
                self._keep(outcome.call.key, outcome.result)
                ledger.settle(outcome.call.key, tuple(messages_in(outcome.result)))
            self._say("updating", ledger.windows, total)

    def _history_calls(
        self, turbines: Sequence[TurbineArchive], ledger: ReprocessingRecord, total: int
    ) -> Iterator[Call]:
        """What is still to be done; everything known already goes to the ledger."""
        for turbine in turbines:
            for each in self._history(turbine):
                if not isinstance(each, Call):
                    ledger.add(each)
                    continue
                known = self._finished.get(each.key)
                ledger.wait_for(each.key)
                if known is None:
                    yield each
                else:
                    self._report.found_finished += 1
                    ledger.settle(each.key, tuple(messages_in(known)))
                    self._say("updating", ledger.windows, total)

    def _history(self, turbine: TurbineArchive) -> Iterator[Message | Call]:
        tracking = ArchiveTracking(turbine.channels, turbine.scenario.oma.hop)
        followed = tracking.followed(self._identified(turbine))
        plan = turbine.updating
        if plan is None:
            yield from followed
        else:
            yield from PosteriorPass(plan, self._remembered).answers(followed)
        yield from turbine.plan.gaps

    def _identified(self, turbine: TurbineArchive) -> Iterator[Message]:
        """What the tasks gave, in order of time; those that failed are left out."""
        for call in turbine.identification:
            frames = self._finished.get(call.key)
            yield from messages_in(frames or ())

    def _remembered(
        self, key: str, make: Callable[[], tuple[StoredFrame, ...]]
    ) -> tuple[StoredFrame, ...]:
        known = self._finished.get(key)
        if known is not None:
            self._report.found_finished += 1
            return known
        made = make()
        self._keep(key, made)
        return made

    def _keep(self, key: str, frames: tuple[StoredFrame, ...]) -> None:
        self._finished.put(key, frames)
        self._report.done_now += 1

    def _fail(self, path: str, failed: Failed) -> None:
        self._report.failures.append(FileFailure(path, failed.text))

    def _counted(self, tables: ArchiveTables) -> Callable[[Message], None]:
        """What takes a message of the history: it is counted and written."""

        def take(message: Message) -> None:
            match message:
                case ModalEstimate():
                    self._report.identified += 1
                case WindowRejected():
                    self._report.rejected += 1
                case FoundationPosterior():
                    self._report.posteriors += 1
                case FoundationEvent():
                    self._report.events += 1
            tables.add(message)

        return take

    def _write_summary(self) -> None:
        report = self._report
        summary = {
            "files": report.files,
            "copies": [str(path) for path in report.copies],
            "turbines": report.turbines,
            "identified": report.identified,
            "rejected": report.rejected,
            "posteriors": report.posteriors,
            "events": report.events,
            "failures": [{"file": each.path, "reason": each.text} for each in report.failures],
            "salvaged": [{"file": each.path, "damage": each.text} for each in report.salvaged],
            "tables": [path.name for path in report.tables],
        }
        text = json.dumps(summary, indent=1, ensure_ascii=False) + "\n"
        written_whole(self._out / SUMMARY, text.encode())
