"""Archives of which the identified windows are drawn: a turbine's history without samples."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path

from pipeline.archive.compact import kept_frames
from pipeline.archive.history.turbine_history import TurbineHistory
from pipeline.archive.identification import IdentificationCall
from pipeline.archive.plan import IdentificationTask, TurbinePlan
from pipeline.archive.posteriors import UpdatingPlan
from pipeline.archive.store import FinishedResults
from pipeline.archive.turbines import TurbineArchive
from pipeline.archive.work import Failed, ThisProcess, Workers
from pipeline.messages import ModalEstimate
from pipeline.scenario import modes_only
from sensors.acquisition.blocks import NANOSECONDS
from sensors.acquisition.layout import SensorLayout

WINDOW = 600 * NANOSECONDS
HOUR = 3600 * NANOSECONDS

Drawn = Callable[[int], ModalEstimate]  # estimate of the window of a number


@dataclass(frozen=True, slots=True, eq=False)
class ModalArchive(TurbineArchive):
    """A turbine's archive whose updating is given."""

    given: UpdatingPlan | None = None

    @property
    def updating(self) -> UpdatingPlan | None:
        """As it was given."""
        return self.given


def time_of(text: str) -> int:
    """2026-01-05T06:00 in UTC [ns]"""
    return round(datetime.fromisoformat(text).replace(tzinfo=UTC).timestamp()) * NANOSECONDS


def task_of(start_ns: int, windows: int, layout: SensorLayout) -> IdentificationTask:
    """A file's windows of ten minutes from then on."""
    return IdentificationTask(
        path=Path(f"{start_ns}.mcap"),
        fingerprints=(str(start_ns),),
        turbine=layout.turbine,
        layout_ids=(layout.layout_id,),
        pieces=(),
        start_ns=start_ns,
        end_ns=start_ns + windows * WINDOW,
        n_windows=windows,
    )


def archive_of(
    tasks: Sequence[IdentificationTask], layout: SensorLayout, updating: UpdatingPlan | None
) -> ModalArchive:
    """The turbine with these files."""
    plan = TurbinePlan(layout.turbine, tuple(tasks), ())
    return ModalArchive(plan, modes_only(layout.turbine), (layout,), given=updating)


def keep_windows(
    finished: FinishedResults, call: IdentificationCall, drawn: Drawn, first: int
) -> None:
    """Put the windows of a task where identification would have; `first` counts them all."""
    task = call.task
    estimates = []
    for number in range(task.n_windows):
        start_ns = task.start_ns + number * WINDOW
        estimate = replace(drawn(first + number), window=number)
        estimates.append(replace(estimate, start_ns=start_ns, end_ns=start_ns + WINDOW))
    finished.put(call.key, kept_frames(estimates))


def made(
    turbine: TurbineArchive,
    results: Path,
    finished: FinishedResults,
    workers: Workers | None = None,
    stop_after: int | None = None,
) -> TurbineHistory:
    """The turbine's history, all that is missing of it done.

    stop_after   calls after which the run ends, as if it was killed
    """
    history = TurbineHistory(turbine, results, finished)
    for done, outcome in enumerate((workers or ThisProcess()).outcomes(history.calls()), start=1):
        failed = isinstance(outcome.result, Failed)
        if not failed:
            finished.put(outcome.call.key, outcome.result)
        history.settle(outcome.call.key, failed=failed)
        if done == stop_after:
            break
    return history
