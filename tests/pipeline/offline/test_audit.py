"""`pilewatch audit` proves a run's books from its files alone, and finds what was tampered with."""

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from pipeline.messages import FoundationPosterior, Message
from pipeline.offline.audit import AuditPeriod, audit
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import whole_recording
from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
from pipeline.sources.sources import replayed
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.errors import InputError

pytestmark = pytest.mark.usefixtures("identified_once")


@pytest.fixture(scope="module")
def folder(short_recording: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Of a run in threads, from which nothing was lost."""
    out = tmp_path_factory.mktemp("run")
    run_session(replayed(short_recording), SessionOptions(out=out, rrd=False))
    return out


def rewritten(folder: Path, copy: Path, keep: Callable[[Message], bool]) -> Path:
    """The folder with a recording in which messages are missing."""
    shutil.copytree(folder, copy)
    path = folder / "session.mcap"
    (copy / "session.mcap").unlink()
    with whole_recording(copy / "session.mcap", metadata=read_metadata(path)) as recorder:
        for message in read_messages(path):
            if keep(message):
                recorder.handle(message)
    return copy


def test_a_file_that_a_killed_run_left_open_is_counted(folder: Path, tmp_path: Path) -> None:
    killed = tmp_path / "killed"
    shutil.copytree(folder, killed)
    (killed / "session.mcap").rename(killed / "session.mcap.active")
    found = audit(killed)
    assert found.as_json()["files_not_closed"] == 1
    assert "1 file (1 not closed: its run goes on or was killed)" in found.line
    assert "not closed" not in audit(folder).line


def test_the_books_of_a_run_balance(folder: Path) -> None:
    found = audit(folder)
    assert not found.violations
    (unit,) = found.as_json()["units"]
    assert unit["recorded"] == unit["published"]
    assert unit["lost"] == 0
    (turbine,) = found.as_json()["turbines"]
    assert turbine["identified"] == turbine["in_posterior"] == 2
    assert "\n" not in found.line


def test_the_summary_of_the_run_has_the_same_books(folder: Path) -> None:
    summary = json.loads((folder / "summary.json").read_text())["books"]
    assert summary["balanced"]
    assert summary["turbines"] == audit(folder).as_json()["turbines"]


def test_blocks_that_were_taken_out_are_named(folder: Path, tmp_path: Path) -> None:
    def keep(message: Message) -> bool:
        return not isinstance(message, AccelerationBlock) or not 100 <= message.sequence < 105

    (violation,) = audit(rewritten(folder, tmp_path / "copy", keep)).violations
    assert "blocks 100 to 104 are neither recorded nor reported missing" in violation


def without_the_second_half(folder: Path, copy: Path, code: str) -> Path:
    """A run whose recording ends with block 99, and a warning in its summary."""
    stopped = rewritten(folder, copy, lambda message: not is_late(message))
    summary = json.loads((copy / "summary.json").read_text())
    summary["warnings"].append({"code": code, "text": "recording has stopped: full"})
    (copy / "summary.json").write_text(json.dumps(summary))
    return stopped


def is_late(message: Message) -> bool:
    if isinstance(message, AccelerationBlock):
        return message.sequence >= 100
    return not isinstance(message, SensorLayout)


def test_what_came_after_a_recording_had_stopped_is_lost_as_in_the_summary(
    folder: Path, tmp_path: Path
) -> None:
    published = json.loads((folder / "summary.json").read_text())["books"]["units"][0]["recorded"]
    found = audit(without_the_second_half(folder, tmp_path / "copy", "recording-stopped"))
    assert found.books.as_json()["units"][0]["lost"] == published - 100
    blocks, windows = found.violations
    assert f"{published - 100} of {published} received blocks are not recorded" in blocks
    assert "2 windows were identified (summary.json) and 0 of them recorded" in windows
    assert f"100 blocks of 1 boot recorded, {published - 100} lost" in found.line
    assert not found.as_json()["balanced"]


def test_a_recording_of_which_nothing_is_left_is_lost_as_in_the_summary(
    folder: Path, tmp_path: Path
) -> None:
    copy = without_the_second_half(folder, tmp_path / "copy", "recording-resumed")
    none = rewritten(copy, tmp_path / "none", lambda m: not isinstance(m, AccelerationBlock))
    (unit,) = audit(none).books.as_json()["units"]
    assert (unit["recorded"], unit["lost"]) == (0, 240)


def test_a_summary_alone_accuses_no_folder_whose_parts_lie_elsewhere(
    folder: Path, tmp_path: Path
) -> None:
    assert not audit(without_the_second_half(folder, tmp_path / "copy", "clock-off")).violations


@pytest.mark.parametrize("text", ["", "[]", "{", '{"warnings": [{"code": "recording-stopped"}]}'])
def test_a_summary_that_cannot_be_read_is_passed_over(
    folder: Path, tmp_path: Path, text: str
) -> None:
    copy = rewritten(folder, tmp_path / "copy", lambda _: True)
    (copy / "summary.json").write_text(text)
    assert not audit(copy).violations


def test_a_posterior_that_is_missing_leaves_its_estimate_pending(
    folder: Path, tmp_path: Path
) -> None:
    def keep(message: Message) -> bool:
        return not isinstance(message, FoundationPosterior) or message.window != 1

    found = audit(rewritten(folder, tmp_path / "copy", keep))
    assert found.as_json()["turbines"][0]["pending"] == 1


def test_a_gap_counts_in_the_period_that_has_it_and_in_no_other(
    folder: Path, tmp_path: Path
) -> None:
    def keep(message: Message) -> bool:
        return not isinstance(message, AccelerationBlock) or not 100 <= message.sequence < 105

    copy = rewritten(folder, tmp_path / "copy", keep)
    blocks = [m for m in read_messages(copy / "session.mcap") if isinstance(m, AccelerationBlock)]
    before = AuditPeriod(until_ns=blocks[50].end_ns)
    over_its_begin = AuditPeriod(blocks[99].end_ns + 10**9, blocks[120].end_ns)
    after = AuditPeriod(since_ns=blocks[120].end_ns)

    assert not audit(copy, before).violations
    assert not audit(copy, after).violations
    (violation,) = audit(copy, over_its_begin).violations
    assert "blocks 100 to 104 are neither recorded nor reported missing" in violation
    (unit,) = audit(copy, after).as_json()["units"]
    assert unit["recorded"] == len(blocks) - 121


def test_periods_count_their_own_blocks_alone(folder: Path) -> None:
    ends = [m.end_ns for m in read_messages(folder / "session.mcap", (AccelerationBlock,))]
    thirds = [
        audit(folder, AuditPeriod(until_ns=ends[79])),
        audit(folder, AuditPeriod(ends[79], ends[159])),
        audit(folder, AuditPeriod(since_ns=ends[159])),
    ]
    recorded = [each.as_json()["units"][0]["recorded"] for each in thirds]
    assert recorded == [80, 80, len(ends) - 160]
    assert "80 blocks of 1 boot recorded, 0 lost" in thirds[1].line
    one = audit(folder, AuditPeriod(ends[79], ends[80]))
    assert "1 block of 1 boot recorded, 0 lost; 0 windows identified" in one.line


@pytest.mark.parametrize("number", [0, -1])
def test_a_period_before_or_after_all_blocks_has_nothing(folder: Path, number: int) -> None:
    blocks = [*read_messages(folder / "session.mcap", (AccelerationBlock,))]
    block = blocks[number]
    assert isinstance(block, AccelerationBlock)
    before = AuditPeriod(until_ns=block.start_ns)
    found = audit(folder, AuditPeriod(since_ns=block.end_ns) if number else before)
    assert found.line == f"{folder}: nothing was recorded in this period; 1 file"
    assert (found.violations, found.as_json()["units"]) == ((), [])


def test_a_folder_without_blocks_names_no_period_where_none_is_given(
    folder: Path, tmp_path: Path
) -> None:
    found = audit(rewritten(folder, tmp_path / "copy", lambda _: False))
    assert found.line == f"{tmp_path / 'copy'}: nothing was recorded; 1 file"


def test_a_gap_over_the_whole_period_is_lost_in_it(folder: Path, tmp_path: Path) -> None:
    def keep(message: Message) -> bool:
        return not isinstance(message, AccelerationBlock) or not 100 <= message.sequence < 120

    blocks = [*read_messages(folder / "session.mcap", (AccelerationBlock,))]
    inside = AuditPeriod(blocks[105].end_ns, blocks[110].end_ns)  # type: ignore[union-attr]
    found = audit(rewritten(folder, tmp_path / "copy", keep), inside)
    assert "0 blocks of 1 boot recorded, 20 lost" in found.line
    assert len(found.violations) == 1


def test_the_windows_of_two_periods_are_those_of_the_whole(folder: Path) -> None:
    ends = [m.time_ns for m in read_messages(folder / "session.mcap") if is_posterior(m)]
    halves = [
        audit(folder, AuditPeriod(until_ns=ends[0])),
        audit(folder, AuditPeriod(since_ns=ends[0])),
    ]

    assert [each.violations for each in halves] == [(), ()]
    found = [each.as_json()["turbines"][0] for each in halves]
    assert [each["identified"] for each in found] == [1, 1]
    assert [each["in_posterior"] for each in found] == [1, 1]


def is_posterior(message: Message) -> bool:
    return isinstance(message, FoundationPosterior)


def test_a_period_without_a_length_is_one_line() -> None:
    with pytest.raises(InputError, match="--since is not before --until"):
        AuditPeriod(5, 5)


def test_damaged_files_are_named(folder: Path, tmp_path: Path) -> None:
    copy = tmp_path / "copy"
    shutil.copytree(folder, copy)
    (checkpoint,) = (copy / "checkpoints").glob("*.checkpoint")
    content = bytearray(checkpoint.read_bytes())
    content[-100] ^= 1
    checkpoint.write_bytes(content)
    recording = copy / "session.mcap"
    content = bytearray(recording.read_bytes())
    content[len(content) // 2] ^= 1
    recording.write_bytes(content)
    found = " ".join(audit(copy).damaged)
    assert str(checkpoint) in found
    assert str(recording) in found


def test_a_folder_without_a_recording_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="holds no recording"):
        audit(tmp_path)


def test_the_command_gives_a_line_and_exit_code_0_or_1(folder: Path, tmp_path: Path) -> None:
    from typer.testing import CliRunner

    from pipeline.cli import app

    good = CliRunner().invoke(app, ["audit", str(folder)])
    assert good.exit_code == 0
    assert good.stdout.count("\n") == 1
    assert "the books balance" in good.stdout

    def keep(message: Message) -> bool:
        return not isinstance(message, AccelerationBlock) or message.sequence != 50

    bad = rewritten(folder, tmp_path / "copy", keep)
    found = CliRunner().invoke(app, ["audit", str(bad), "--json"])
    assert found.exit_code == 1
    assert not json.loads(found.stdout)["balanced"]
