"""An archive gives the numbers of one recording of the whole, whoever works and however often."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.opcode import Opcode
from pyarrow import parquet
from typer.testing import CliRunner

from pipeline.archive.reprocessing import FINISHED, SUMMARY, ArchiveReport, reprocessed
from pipeline.archive.survey import surveyed
from pipeline.archive.tracking import ArchiveTracking
from pipeline.archive.turbines import archived_turbines
from pipeline.archive.work import ThisProcess
from pipeline.cli import app
from pipeline.messages import Message, ModalEstimate, WindowRejected
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.mcap_file import record_offsets
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import Recorder, RecorderSettings
from pipeline.runtime.source_feed import with_end
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.archive.archives import MEASURED, Renamed, rewritten, tables_of
from tests.pipeline.recording.test_recording import of_another_program

pytestmark = pytest.mark.usefixtures("identified_once")

CLI = CliRunner()


@pytest.fixture(scope="module")
def report(archive: list[Path], results: Path) -> ArchiveReport:
    """Of a second run over it."""
    return reprocessed(archive, results, ThisProcess())


def rows(results: Path, table: str) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = parquet.read_table(results / table).to_pylist()
    return found


@pytest.fixture(scope="module")
def live(short_recording: Path) -> list[ModalEstimate]:
    """The whole recording by the node of a session."""
    source = replayed(short_recording)
    node = IdentificationNode(source.scenario.oma)
    answers: list[Message] = []
    for message in with_end(source.messages()):
        if isinstance(message, node.inputs):
            answers += node.handle(message)
    return [each for each in answers if isinstance(each, ModalEstimate)]


def test_cut_files_give_the_windows_modes_and_names_of_the_whole_recording(
    live: list[ModalEstimate], results: Path
) -> None:
    """A session warms its decomposition up from window to window; tasks begin anew: 1e-6."""
    expected = [(each, mode) for each in live for mode in each.modes]
    found = rows(results, "modes")

    assert [(row["window"], row["mode"]) for row in found] == [
        (estimate.window, mode.name) for estimate, mode in expected
    ]
    for column, quantity, tolerance in (
        ("frequency [Hz]", "frequency", 1e-6),
        ("frequency_std [Hz]", "frequency_std", 1e-3),
    ):
        np.testing.assert_allclose(
            [row[column] for row in found],
            [getattr(mode, quantity) for _, mode in expected],
            rtol=tolerance,
        )


def test_every_window_has_its_posterior(results: Path) -> None:
    posterior = rows(results, "posterior")

    assert [row["window"] for row in posterior] == [0, 1]
    assert [row["windows"] for row in posterior] == [1, 2]
    for row in posterior:
        assert row["k22_p05 [N·m/rad]"] < 8.238e11 < row["k22_p95 [N·m/rad]"]  # the truth


def test_what_is_finished_is_not_done_again(report: ArchiveReport) -> None:
    assert report.done_now == 0
    assert report.found_finished > 0
    assert report.posteriors == 2


def test_a_script_has_the_counts_and_where_the_results_are(
    archive: list[Path], results: Path, report: ArchiveReport
) -> None:
    said = CLI.invoke(
        app, ["reprocess", *map(str, archive), "-o", str(results), "--serial", "--json"]
    )
    assert said.exit_code == 0
    counts = json.loads(said.stdout)
    assert counts["out"] == str(results)
    assert counts["posteriors"] == report.posteriors


def test_a_file_without_a_whole_chunk_is_one_line_and_the_rest_goes_on(
    archive: list[Path], results: Path, tmp_path: Path
) -> None:
    broken = tmp_path / "broken.mcap"
    broken.write_bytes(archive[0].read_bytes()[:5_000])

    said = CLI.invoke(
        app, ["reprocess", *map(str, archive), str(broken), "-o", str(results), "--serial"]
    )

    assert said.exit_code == 2
    assert "2 windows identified" in said.output.replace("\n", "")
    (line,) = [line for line in said.output.splitlines() if str(broken) in line]
    assert "was cut off before its end" in line


def test_files_that_are_no_recordings_or_have_gone_are_a_line_each_and_exit_code_2(
    tmp_path: Path,
) -> None:
    of_another_program(tmp_path / "robot.mcap", {"/robot/pose": ("json", "Pose")})
    (tmp_path / "gone.mcap").symlink_to(tmp_path / "nowhere.mcap")

    said = CLI.invoke(
        app, ["reprocess", str(tmp_path / "*.mcap"), "-o", str(tmp_path / "out"), "--serial"]
    )

    assert said.exit_code == 2
    failures = json.loads((tmp_path / "out" / SUMMARY).read_text())["failures"]
    assert [
        (Path(each["file"]).name, each["reason"].partition(".mcap")[2]) for each in failures
    ] == [
        ("gone.mcap", ": No such file or directory"),
        ("robot.mcap", " holds no pilewatch channel, only /robot/pose"),
    ]


def test_a_copy_is_skipped_and_the_file_that_is_used_is_named(
    archive: list[Path], results: Path, tmp_path: Path
) -> None:
    copy = Path(shutil.copy(archive[1], tmp_path / "z.mcap"))

    said = CLI.invoke(
        app, ["reprocess", *map(str, archive), str(copy), "-o", str(results), "--serial"]
    )

    first, second = sorted([archive[1], copy])
    assert f"{second} is a copy of {first} and was skipped" in said.output
    copies = json.loads((results / SUMMARY).read_text())["copies"]
    assert copies == [{"file": str(second), "original": str(first)}]


def test_what_a_damaged_file_still_holds_is_surveyed_and_read(
    archive: list[Path], short_recording: Path, tmp_path: Path
) -> None:
    damaged = tmp_path / "damaged.mcap"
    recorder = Recorder(
        damaged,
        metadata=read_metadata(short_recording),
        clock=None,
        settings=RecorderSettings(chunk_duration=10.0),
    )
    for message in read_messages(short_recording, MEASURED):
        recorder.handle(message)
    recorder.close()
    content = bytearray(damaged.read_bytes())
    with damaged.open("rb") as file:
        chunks = [offset for offset, opcode in record_offsets(file) if opcode == Opcode.CHUNK]
    content[chunks[-3] + 200] ^= 0xFF
    damaged.write_bytes(content)

    survey = surveyed(damaged)
    report = reprocessed([damaged], tmp_path / "out", ThisProcess())

    (part,) = survey.parts
    (gap,) = part.gaps
    assert (gap.end_ns - gap.start_ns) / NANOSECONDS == pytest.approx(10.0, abs=1.0)
    assert survey.damage.startswith("has lost 1 of ")
    assert (report.identified, report.rejected) == (1, 1)  # the damage is in the second window
    assert [each.path for each in report.salvaged] == [str(damaged)]
    assert not report.failures


def test_a_damaged_result_is_made_again(archive: list[Path], results: Path) -> None:
    before = tables_of(results)
    posterior = next(path for path in before if path.startswith("posterior/"))
    for damaged in (results / posterior, *(results / FINISHED).glob("??/*.pw")):
        damaged.write_bytes(damaged.read_bytes()[:-1])

    again = reprocessed(archive, results, ThisProcess())

    assert again.done_now > 1
    assert tables_of(results) == before


def test_turbines_of_one_archive_have_histories_of_their_own(
    archive: list[Path], short_recording: Path, tmp_path: Path
) -> None:
    twin = rewritten(short_recording, tmp_path / "twin.mcap", Renamed("twin"))
    surveys = [surveyed(path) for path in (*archive, twin)]

    first, second = archived_turbines(surveys, None, None)

    assert (first.plan.turbine, second.plan.turbine) == ("iea15mw", "twin")
    assert sum(task.n_windows for task in first.plan.tasks) == 2
    assert [task.n_windows for task in second.plan.tasks] == [2]
    assert second.updating is not None
    assert second.updating.layout.turbine == "twin"


def test_names_of_modes_stay_over_a_gap_of_a_month(live: list[ModalEstimate]) -> None:
    month = 30 * 86_400 * NANOSECONDS
    later = [replace(e, start_ns=e.start_ns + month, end_ns=e.end_ns + month) for e in live]
    tracking = ArchiveTracking(live[0].channels, 120.0)

    followed = tracking.followed([*live, *later])
    windows = [each for each in followed if isinstance(each, ModalEstimate)]

    assert [each.window for each in windows] == [0, 1, 2, 3]
    before, after = ([mode.name for mode in windows[i].modes] for i in (1, 3))
    assert before == after  # the same samples


def test_a_window_of_channels_that_no_layout_has_is_refused() -> None:
    tracking = ArchiveTracking(("a", "b"), 600.0)
    estimate = ModalEstimate("t", 0, 0, 1, "", ("a", "c"), ())

    (answer,) = tracking.followed([estimate])

    assert isinstance(answer, WindowRejected)
    assert answer.reason == "no layout of the archive has a channel c"


def test_an_archive_without_its_layout_in_every_file_takes_it_from_the_others(
    archive: list[Path],
) -> None:
    surveys = [surveyed(path) for path in archive]
    without = [replace(surveys[0], layouts=()), *surveys[1:]]

    (turbine,) = archived_turbines(without, None, None)

    assert all(call.layouts == turbine.layouts for call in turbine.identification)
    assert len(turbine.layouts) == 1


def test_the_ways_of_working_exclude_each_other(archive: list[Path]) -> None:
    said = CLI.invoke(app, ["reprocess", str(archive[0]), "--serial", "--workers", "2"])

    assert "--cluster, --workers and --serial exclude each other" in str(said.exception)


def recorded_after_a_cut(recording: Path, folder: Path, files: int) -> None:
    """The recording as a shore station has it after a cut of 90 s: what was measured meanwhile
    comes at the end, mixed with live blocks; in one file, or in a file a stretch."""
    messages = list(read_messages(recording, MEASURED))
    blocks = [each for each in messages if isinstance(each, AccelerationBlock)]
    cut, back = 40, 130
    before, meanwhile, after = blocks[:cut], blocks[cut:back], blocks[back:]
    mixed = [each for pair in zip(after, meanwhile, strict=False) for each in pair]
    mixed += [*after[len(meanwhile) :], *meanwhile[len(after) :]]
    arrived = [*before, *mixed]
    length = -(-len(arrived) // files)
    for number in range(files):
        recorder = Recorder(
            folder / f"session.part{number + 1}.mcap", metadata=read_metadata(recording), clock=None
        )
        for each in messages:
            if isinstance(each, SensorLayout):
                recorder.handle(each)
        for each in arrived[number * length : (number + 1) * length]:
            recorder.handle(each)
        recorder.close()


@pytest.mark.parametrize("files", [1, 3])
def test_blocks_that_were_sent_again_after_a_long_cut_are_taken_up(
    short_recording: Path, live: list[ModalEstimate], tmp_path: Path, files: int
) -> None:
    (tmp_path / "in").mkdir()
    recorded_after_a_cut(short_recording, tmp_path / "in", files)
    recordings = sorted((tmp_path / "in").glob("*.mcap"))
    report = reprocessed(recordings, tmp_path / "out", ThisProcess())

    assert (report.identified, report.rejected) == (len(live), 0)
    found = rows(tmp_path / "out", "modes")
    expected = [mode.frequency for each in live for mode in each.modes]
    np.testing.assert_allclose([row["frequency [Hz]"] for row in found], expected, rtol=1e-6)
    assert not (tmp_path / "out" / "gaps.parquet").exists() or not rows(tmp_path / "out", "gaps")
