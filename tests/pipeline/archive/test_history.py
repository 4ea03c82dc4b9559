"""A new day continues a turbine's history: the bits of a run from scratch, the work of a day."""

from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from shutil import copytree
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

from pipeline.archive.history import day_pass
from pipeline.archive.history.months import partition, written_months
from pipeline.archive.history.turbine_history import TurbineHistory
from pipeline.archive.store import FinishedResults
from pipeline.archive.work import Call, Failed, Outcome, ThisProcess
from pipeline.messages import ModalEstimate
from tests.pipeline.archive.archives import tables_of
from tests.pipeline.archive.modal_archives import (
    HOUR,
    ModalArchive,
    archive_of,
    keep_windows,
    made,
    task_of,
    time_of,
)
from tests.pipeline.archive.test_posteriors import AFTER, BEFORE, PLAN
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

# A posterior of the same plan and sums is computed once: other sums are another question.
pytestmark = pytest.mark.usefixtures("identified_once")

DATES = ("2026-01-30", "2026-01-31", "2026-02-01", "2026-02-02")
TASKS, WINDOWS = 2, 2  # of a day; of a task
CHANGED_AT = 9  # window, on the third day


@pytest.fixture(scope="module", autouse=True)
def calls_of_one_window() -> Iterator[None]:
    """A short day has several calls then, as one of 144 windows has."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.archive.posteriors.WINDOWS_OF_CALL", 1)
        yield


def drawn(window: int) -> ModalEstimate:
    generator = np.random.default_rng([78, window])
    truth = BEFORE if window < CHANGED_AT else AFTER
    return drawn_estimate(truth, generator, window=window, tower=LinearTower())


def archive_until(finished: FinishedResults, days: int, *, without: int = -1) -> ModalArchive:
    """The first days, their windows identified but for those of one task."""
    starts = [time_of(date) + n * HOUR for date in DATES[:days] for n in range(TASKS)]
    turbine = archive_of([task_of(each, WINDOWS, LAYOUT) for each in starts], LAYOUT, PLAN)
    for number, call in enumerate(turbine.identification):
        if number != without and call.key not in finished:
            keep_windows(finished, call, drawn, number * WINDOWS)
    return turbine


class Counted(ThisProcess):
    """Counts what is called."""

    def __init__(self) -> None:
        self.calls: Counter[str] = Counter()

    def outcomes(self, calls: Any) -> Iterator[Outcome]:
        for outcome in super().outcomes(calls):
            self.calls[outcome.call.function.__name__] += 1
            yield outcome


@pytest.fixture(scope="module")
def scratch(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All days in one run."""
    results = tmp_path_factory.mktemp("scratch")
    finished = FinishedResults(results / ".finished")
    made(archive_until(finished, 4), results, finished)
    return results


@pytest.fixture(scope="module")
def day_by_day(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Counted]:
    """A run a day, and what the last of them called."""
    results = tmp_path_factory.mktemp("days")
    finished = FinishedResults(results / ".finished")
    for days in range(1, 4):
        made(archive_until(finished, days), results, finished)
    workers = Counted()
    made(archive_until(finished, 4), results, finished, workers)
    return results, workers


@pytest.fixture
def copied(scratch: Path, tmp_path: Path) -> Path:
    """All days in one run, in a folder that a test may damage."""
    return Path(copytree(scratch, tmp_path / "copied"))


def rows(results: Path, table: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = parquet.read_table(results / table).to_pylist()
    return found


def test_days_that_come_one_by_one_give_the_bits_of_one_run(
    scratch: Path, day_by_day: tuple[Path, Counted]
) -> None:
    results, _ = day_by_day

    assert tables_of(results) == tables_of(scratch)


def test_a_new_day_is_one_pass_and_its_own_posteriors(day_by_day: tuple[Path, Counted]) -> None:
    _, workers = day_by_day

    assert workers.calls["day_frames"] == 1
    assert workers.calls["posteriors"] <= TASKS * WINDOWS


def test_every_window_is_in_the_tables_once_in_order(scratch: Path) -> None:
    posterior = rows(scratch, "posterior")

    assert [row["window"] for row in posterior] == list(range(4 * TASKS * WINDOWS))
    assert [row["month"] for row in posterior] == ["2026-01"] * 8 + ["2026-02"] * 8
    assert {row["turbine"] for row in posterior} == {"small"}
    assert len(rows(scratch, "events")) == 1


@pytest.mark.parametrize("stop_after", [1, 2, 5, 9])
def test_a_run_that_is_killed_continues_to_the_same_bits(
    scratch: Path, tmp_path: Path, stop_after: int
) -> None:
    finished = FinishedResults(tmp_path / ".finished")
    turbine = archive_until(finished, 4)

    made(turbine, tmp_path, finished, stop_after=stop_after)
    made(turbine, tmp_path, finished)

    assert tables_of(tmp_path) == tables_of(scratch)


def test_an_unchanged_archive_is_not_touched(scratch: Path) -> None:
    finished, workers = FinishedResults(scratch / ".finished"), Counted()
    before = {path: path.stat().st_mtime_ns for path in scratch.rglob("*.parquet")}

    history = made(archive_until(finished, 4), scratch, finished, workers)

    assert not workers.calls
    assert {path: path.stat().st_mtime_ns for path in scratch.rglob("*.parquet")} == before
    assert sum(day.posteriors for day in history.written) == 4 * TASKS * WINDOWS


def test_what_only_led_to_the_tables_is_not_kept(scratch: Path) -> None:
    """Beside the identified windows, states: of each day of the newest month, of the last day of
    each older one."""
    kept = list((scratch / ".finished").rglob("*.pw"))

    assert len(kept) == 4 * TASKS + 2 + 1


def test_a_task_that_comes_late_changes_what_follows_it_and_nothing_before(
    scratch: Path, tmp_path: Path
) -> None:
    finished, workers = FinishedResults(tmp_path / ".finished"), Counted()
    made(archive_until(finished, 4, without=2 * TASKS), tmp_path, finished)
    january = partition(tmp_path, "posterior", "small", "2026-01").read_bytes()

    made(archive_until(finished, 4), tmp_path, finished, workers)

    assert tables_of(tmp_path) == tables_of(scratch)
    assert partition(tmp_path, "posterior", "small", "2026-01").read_bytes() == january
    assert workers.calls["day_frames"] == 2


def test_a_lost_file_and_a_lost_state_are_made_again(scratch: Path, copied: Path) -> None:
    finished = FinishedResults(copied / ".finished")
    partition(copied, "pairs", "small", "2026-02").unlink()
    for path in (copied / ".finished").rglob("*.pw"):
        content = finished.get(path.stem)
        if content is not None and content[-1][0] == day_pass.TRACKED:
            path.write_bytes(path.read_bytes()[:-2])

    made(archive_until(finished, 4), copied, finished)

    assert tables_of(copied) == tables_of(scratch)


def test_posteriors_that_fail_leave_their_day_to_the_next_run(
    scratch: Path, tmp_path: Path
) -> None:
    class Failing(ThisProcess):
        def outcomes(self, calls: Any) -> Iterator[Outcome]:
            left = 1
            for outcome in super().outcomes(calls):
                if outcome.call.function.__name__ == "posteriors" and left:
                    left -= 1
                    yield Outcome(outcome.call, Failed("of no memory"))
                else:
                    yield outcome

    finished = FinishedResults(tmp_path / ".finished")
    turbine = archive_until(finished, 4)
    made(turbine, tmp_path, finished, Failing())
    assert len(rows(tmp_path, "posterior")) < 4 * TASKS * WINDOWS

    made(turbine, tmp_path, finished)

    assert tables_of(tmp_path) == tables_of(scratch)


def test_a_month_that_the_archive_has_no_more_goes(copied: Path) -> None:
    finished = FinishedResults(copied / ".finished")

    made(archive_until(finished, 2), copied, finished)

    assert set(written_months(copied, "small")) == {"2026-01"}
    assert not partition(copied, "modes", "small", "2026-02").exists()


def test_calls_of_turbines_wait_for_no_other_turbine(tmp_path: Path) -> None:
    """A pass waits for the one of the day before; what may be done is given out meanwhile."""
    finished = FinishedResults(tmp_path / ".finished")
    turbine = archive_until(finished, 2)
    calls = TurbineHistory(turbine, tmp_path, finished).calls()
    first, second = next(calls), next(calls)

    assert isinstance(first, Call)
    assert second is None
