"""A window is updated with the layout that its own recording states, not with the newest."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

from pipeline.archive.history.layout_periods import Renamed, layout_history
from pipeline.archive.identification import IdentificationCall
from pipeline.archive.plan import IdentificationTask
from pipeline.archive.posteriors import UpdatingPlan
from pipeline.archive.store import FinishedResults
from pipeline.archive.survey import FileSurvey
from pipeline.messages import ModalEstimate
from sensors.acquisition.layout import SensorLayout
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
from tests.pipeline.archive.test_posteriors import BEFORE, PLAN
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

pytestmark = pytest.mark.usefixtures("identified_once")

RAISED = replace(
    LAYOUT,
    layout_id="raised",
    channels=(replace(LAYOUT.channels[0], elevation=60.0), *LAYOUT.channels[1:]),
)
NOON = time_of("2026-01-30T12:00")


def survey_of(path: Path, *layouts: SensorLayout) -> FileSurvey:
    return FileSurvey(path, str(path), (), layouts)


def archive(layouts: list[SensorLayout]) -> ModalArchive:
    """A file of two windows an hour from noon on, one with each layout."""
    tasks = [task_of(NOON + n * HOUR, 2, each) for n, each in enumerate(layouts)]
    surveys = [survey_of(t.path, each) for t, each in zip(tasks, layouts, strict=True)]
    plan: UpdatingPlan = replace(PLAN, layout=layouts[-1])
    stated = layout_history(tasks, surveys)
    found = replace(
        archive_of(tasks, layouts[-1], plan),
        layouts=tuple({each.layout_id: each for each in layouts}.values()),
        periods=stated.periods,
        period_of_task=stated.period_of_task,
        renamed=stated.renamed,
    )
    return replace(found, given=replace(plan, layout=found.layout))


def unchanged(window: int) -> ModalEstimate:
    generator = np.random.default_rng([79, window])
    return drawn_estimate(BEFORE, generator, window=window, tower=LinearTower())


def posteriors(
    turbine: ModalArchive, results: Path, stop_after: int | None = None
) -> list[dict[str, object]]:
    finished = FinishedResults(results / ".finished")
    for number, call in enumerate(turbine.identification):
        keep_windows(finished, call, unchanged, 2 * number)
    made(turbine, results, finished, stop_after=stop_after)
    table = results / "posterior"
    return parquet.read_table(table).to_pylist() if table.exists() else []


def test_windows_before_a_change_of_layout_have_the_posterior_of_their_recordings_alone(
    tmp_path: Path,
) -> None:
    """The change is at two o'clock: a day has windows of both."""
    alone = posteriors(archive([LAYOUT, LAYOUT]), tmp_path / "alone")
    both = archive([LAYOUT, LAYOUT, RAISED, RAISED])
    found = posteriors(both, tmp_path / "both")

    assert [row["windows"] for row in found] == [1, 2, 3, 4, 1, 2, 3, 4]
    assert found[:4] == alone
    assert [plan.layout for plan in both.updating_by_period] == [LAYOUT, RAISED]


def test_a_run_that_is_stopped_at_a_change_of_layout_goes_on_with_the_same_bits(
    tmp_path: Path,
) -> None:
    layouts = [LAYOUT, RAISED, LAYOUT]
    at_once, stopped = tmp_path / "at once", tmp_path / "stopped"
    posteriors(archive(layouts), at_once)
    for calls in (1, 2, None):
        posteriors(archive(layouts), stopped, stop_after=calls)
    posteriors(archive(layouts[:2]), tmp_path / "later")
    posteriors(archive(layouts), tmp_path / "later")

    assert tables_of(at_once)
    assert tables_of(stopped) == tables_of(tmp_path / "later") == tables_of(at_once)


def test_a_day_after_a_change_of_layout_goes_on_in_its_period(tmp_path: Path) -> None:
    layouts = [LAYOUT, *[RAISED] * 13]  # past midnight
    found = posteriors(archive(layouts), tmp_path)
    assert [row["windows"] for row in found] == [1, 2, *range(1, 27)]


def test_one_line_names_the_channel_and_the_files_on_both_sides_of_a_change() -> None:
    turbine = archive([LAYOUT, LAYOUT, RAISED])
    files = [str(task.path) for task in turbine.plan.tasks]
    assert turbine.warnings == (
        f"channel z52-fa is at 52 m in {files[1]}, is at 60 m in {files[2]}; each window is "
        f"updated with its own recording's layout, and the posterior begins again with {files[2]}",
    )
    assert archive([LAYOUT, LAYOUT]).warnings == ()
    often = archive([LAYOUT, RAISED] * 5).warnings
    assert (len(often), often[-1]) == (6, "and 4 more changes of the layout")


def test_a_turbine_whose_modes_alone_are_tracked_has_no_change_to_report() -> None:
    turbine = replace(archive([LAYOUT, RAISED]), given=None)
    assert (turbine.updating_by_period, turbine.warnings) == ((), ())


def test_a_layout_of_another_name_that_says_the_same_goes_on() -> None:
    turbine = archive([LAYOUT, replace(LAYOUT, layout_id="renamed")])
    assert len(turbine.periods) == 1
    assert [call.period for call in turbine.identification] == [0, 0]


def test_fewer_channels_are_read_at_the_layout_that_has_all() -> None:
    fewer = replace(LAYOUT, layout_id="fewer", channels=LAYOUT.channels[1:])
    for layouts in ([LAYOUT, fewer], [fewer, LAYOUT]):
        turbine = archive(layouts)
        (period,) = turbine.periods
        assert period.layout == turbine.layout == LAYOUT


def test_a_name_that_two_layouts_share_stands_for_each_files_own() -> None:
    turbine = archive([LAYOUT, replace(RAISED, layout_id=LAYOUT.layout_id)])
    assert [period.layout.channels for period in turbine.periods] == [
        LAYOUT.channels, RAISED.channels,
    ]  # fmt: skip


def test_a_file_without_its_layout_takes_the_one_of_that_name() -> None:
    tasks = [task_of(NOON + n * HOUR, 2, LAYOUT) for n in range(2)]
    surveys = [survey_of(tasks[0].path), survey_of(tasks[1].path, LAYOUT)]
    stated = layout_history(tasks, surveys)
    assert [each.layout for each in stated.periods] == [LAYOUT]
    assert stated.period_of_task == (0, 0)
    assert layout_history(tasks, [survey_of(tasks[0].path)]).periods == ()


def test_a_unit_that_comes_later_is_in_the_layout_from_the_beginning() -> None:
    lower = replace(LAYOUT, unit="lower", layout_id="low", channels=LAYOUT.channels[:2])
    upper = replace(LAYOUT, unit="upper", layout_id="high", channels=LAYOUT.channels[2:])
    first = task_of(NOON, 2, lower)
    second = replace(task_of(NOON + HOUR, 2, lower), layout_ids=("low", "high"))
    surveys = [survey_of(first.path, lower), survey_of(second.path, lower, upper)]
    stated = layout_history([first, second], surveys)
    assert [each.layout.unit for each in stated.periods] == ["lower+upper"]
    assert stated.period_of_task == (0, 0)


def test_a_logger_that_is_replaced_under_another_name_goes_on_with_the_same_channels(
    tmp_path: Path,
) -> None:
    """A session that is started again with the new unit does so too: windows of one unit have its
    channels' own names."""
    other = replace(LAYOUT, unit="daq2", layout_id="t1-daq2")
    turbine = archive([LAYOUT, LAYOUT, other, other])

    assert posteriors(turbine, tmp_path / "replaced") == posteriors(
        archive([LAYOUT] * 4), tmp_path / "same"
    )
    assert [period.layout.channel_names for period in turbine.periods] == [LAYOUT.channel_names]
    assert turbine.renamed == ((),) * 4


def test_a_logger_that_took_anothers_place_with_moved_sensors_begins_again() -> None:
    other = replace(RAISED, unit="daq2", layout_id="t1-daq2")
    turbine = archive([LAYOUT, other])
    assert [period.layout for period in turbine.periods] == [LAYOUT, other]


LOWER, UPPER = (
    replace(LAYOUT, unit=unit, layout_id=unit, channels=(replace(channel, name="x"),))
    for unit, channel in zip(("lower", "upper"), LAYOUT.channels[:2], strict=True)
)


@pytest.mark.parametrize("alone", [0, 1, 2])
def test_a_file_without_one_of_two_loggers_of_the_same_names_calls_the_others_as_the_rest(
    alone: int,
) -> None:
    """Wherever in the archive it lies: identified alone, its channels have no unit's name."""
    together = replace(task_of(NOON, 2, LOWER), layout_ids=("lower", "upper"))
    tasks = [replace(together, path=Path(f"{n}.mcap")) for n in range(3)]
    layouts: list[tuple[SensorLayout, ...]] = [(LOWER, UPPER)] * 3
    tasks[alone] = replace(tasks[alone], layout_ids=("upper",))
    layouts[alone] = (UPPER,)
    surveys = [survey_of(task.path, *own) for task, own in zip(tasks, layouts, strict=True)]

    stated = layout_history(tasks, surveys)
    renamed: list[Renamed] = [(), (), ()]
    renamed[alone] = (("x", "upper/x"),)
    assert [period.layout.channel_names for period in stated.periods] == [("lower/x", "upper/x")]
    assert list(stated.renamed) == renamed
    # where its file states the other's layout, it is identified with the units' names
    surveys[alone] = survey_of(tasks[alone].path, LOWER, UPPER)
    assert layout_history(tasks, surveys).renamed == ((),) * 3


def test_a_unit_that_has_a_layout_and_never_a_block_gives_the_others_no_names() -> None:
    stated = layout_history(
        [task_of(NOON, 2, UPPER)], [survey_of(Path(f"{NOON}.mcap"), LOWER, UPPER)]
    )
    assert [period.layout for period in stated.periods] == [UPPER]
    assert stated.renamed == ((("upper/x", "x"),),)


def test_the_period_of_a_task_is_no_part_of_how_it_is_identified() -> None:
    task: IdentificationTask = task_of(NOON, 2, LAYOUT)
    first, second = (
        replace(call, period=number)
        for number in (0, 1)
        for call in archive([LAYOUT]).identification
    )
    assert isinstance(first, IdentificationCall)
    assert first.key == second.key
    assert first.task == task
