"""A recording that was cut keeps every chunk that was complete."""

import errno
import io
import multiprocessing
import os
import random
import signal
import sys
from pathlib import Path

import mcap.reader
import mcap.writer
import pytest
from mcap.opcode import Opcode

from pipeline.cli import main
from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import _summary_holds, record_offsets
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.salvage import SalvagedContent, salvage
from pipeline.recording.writer import Recorder
from pipeline.transport.codec import encode, full_name
from tests.benchmarks.trials import DamageOutcome, damage_trial
from tests.pipeline.example_messages import LAYOUT, START_NS, all_same, block
from tests.pipeline.recording.test_recording import METADATA, SECOND, record

MINUTE = [LAYOUT, *map(block, range(60))]


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    """One minute in chunks of five seconds."""
    return record(tmp_path / "tower.mcap", MINUTE, chunk_duration=5.0)


def salvaged(path: Path, content: bytes) -> list:
    """What is left of a file with this content."""
    path.write_bytes(content)
    target = path.with_suffix(".salvaged.mcap")
    target.unlink(missing_ok=True)
    try:
        salvage(path, target)
    except RecordingError:
        assert not target.exists()
        return []
    return list(read_messages(target))


def test_a_recording_cut_anywhere_gives_every_complete_chunk(recording: Path) -> None:
    whole = recording.read_bytes()
    generator = random.Random(4)
    lengths = sorted(generator.randrange(8, len(whole)) for _ in range(40))
    counts = []
    for length in lengths:
        left = salvaged(recording, whole[:length])
        assert all_same(left, MINUTE[: len(left)])
        counts.append(len(left))
    assert counts == sorted(counts)
    assert {(count - 1) % 5 for count in counts if count} == {0}  # a layout, then five a chunk
    assert counts[-1] == len(MINUTE)


def test_a_damaged_recording_gives_every_other_chunk(recording: Path) -> None:
    whole = recording.read_bytes()
    generator = random.Random(5)
    for _ in range(40):
        damaged = bytearray(whole)
        damaged[generator.randrange(len(whole) // 4, len(whole))] ^= generator.randrange(1, 256)
        sequences = [message.sequence for message in salvaged(recording, damaged)[1:]]
        assert sequences == sorted(set(sequences))
        assert set(sequences) <= set(range(60))


def test_the_chunks_after_a_damaged_one_are_still_there(recording: Path) -> None:
    damaged = bytearray(recording.read_bytes())
    damaged[len(damaged) // 2] ^= 0xFF
    recording.write_bytes(damaged)
    remains = salvage(recording, recording.with_suffix(".salvaged.mcap"))
    assert (remains.chunks, remains.damaged_chunks) == (11, 1)
    assert str(remains) == (
        "11 complete chunks with 56 messages, 60.0 s of samples, can be salvaged "
        "(1 more is damaged: 5 messages are gone)"
    )


def test_the_chunks_after_a_damaged_first_one_or_a_damaged_length_are_still_there(
    recording: Path,
) -> None:
    """The first chunk introduces the channels; a record's length leads to the next record."""
    whole = recording.read_bytes()
    with recording.open("rb") as file:
        offsets = [offset for offset, opcode in record_offsets(file) if opcode == Opcode.CHUNK]
    for place in (offsets[0] + 100, offsets[3] + 1, offsets[3] + 4):
        damaged = bytearray(whole)
        damaged[place] ^= 0xFF
        recording.write_bytes(damaged)
        target = recording.with_suffix(".salvaged.mcap")
        target.unlink(missing_ok=True)

        remains = salvage(recording, target)

        assert remains.chunks >= 11


def test_salvaging_keeps_metadata_and_times_and_leaves_the_source_alone(recording: Path) -> None:
    cut = recording.read_bytes()[:-50]
    recording.write_bytes(cut)
    target = recording.with_suffix(".salvaged.mcap")
    salvage(recording, target)
    assert recording.read_bytes() == cut
    assert read_metadata(target) == METADATA
    assert all_same(read_messages(target), MINUTE)


def test_nothing_is_salvaged_over_another_recording(recording: Path) -> None:
    with pytest.raises(RecordingError, match="exists already"):
        salvage(recording, recording)


def test_what_is_no_recording_cannot_be_salvaged(tmp_path: Path) -> None:
    path = tmp_path / "notes.txt"
    path.write_text("not a recording")
    with pytest.raises(RecordingError, match="is not a recording"):
        salvage(path, tmp_path / "a.mcap")


def record_until_killed(path: Path, n_blocks: int) -> None:
    """A process of its own: record a block a second, then be killed."""
    now_ns = START_NS

    def clock() -> int:
        nonlocal now_ns
        now_ns += SECOND
        return now_ns

    recorder = Recorder(path, metadata=METADATA, clock=clock)
    for sequence in range(n_blocks):
        recorder.handle(block(sequence))
    os.kill(os.getpid(), signal.SIGKILL)


def test_a_recorder_that_is_killed_loses_at_most_two_seconds(tmp_path: Path) -> None:
    path = tmp_path / "tower.mcap"
    process = multiprocessing.get_context("spawn").Process(
        target=record_until_killed, args=(path, 100)
    )
    process.start()
    process.join(60)
    assert process.exitcode == -signal.SIGKILL
    left = tmp_path / "tower.salvaged.mcap"
    salvage(tmp_path / "tower.mcap.active", left)
    sequences = [message.sequence for message in read_messages(left)]
    assert sequences == list(range(len(sequences)))
    assert len(sequences) >= 98


def test_the_command_brings_back_what_is_left_and_leaves_the_source(
    recording: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    cut = recording.read_bytes()[:-3000]
    recording.write_bytes(cut)
    monkeypatch.setattr(sys, "argv", ["pilewatch", "salvage", str(recording)])
    with pytest.raises(SystemExit) as ended:
        main()
    assert not ended.value.code
    target = recording.with_name("tower.mcap.salvaged.mcap")
    left = list(read_messages(target))
    assert all_same(left, MINUTE[: len(left)])
    assert f"{len(left)} messages" in capsys.readouterr().out.replace("\n", "")
    assert recording.read_bytes() == cut
    with pytest.raises(RecordingError, match=r"salvaged\.mcap was salvaged from it"):
        list(read_messages(recording))
    target.unlink()
    with pytest.raises(RecordingError, match="pilewatch salvage"):
        list(read_messages(recording))


def test_random_cuts_and_flips_crash_nothing_and_go_unnoticed_nowhere(
    recording: Path, tmp_path: Path
) -> None:
    outcome = damage_trial(tmp_path, recording, cuts=60, flips=60, seed=6)
    assert outcome == DamageOutcome(files=120, crashes=0, fewer=0, unnoticed=0)


def test_where_the_disk_is_full_nothing_is_left_of_a_salvage_which_is_named(
    recording: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(Recorder, "record", full)
    target = recording.with_suffix(".salvaged.mcap")
    with pytest.raises(RecordingError, match=r"salvaged\.mcap: No space left on device; nothing"):
        salvage(recording, target)
    assert list(recording.parent.iterdir()) == [recording]


def times_in(path: Path) -> list[tuple[int, int]]:
    """(log time, publish time) of every message, by the mcap package."""
    with path.open("rb") as file:
        found = mcap.reader.make_reader(file).iter_messages(log_time_order=False)
        return [(message.log_time, message.publish_time) for _, _, message in found]


def test_a_message_that_came_late_is_still_late_after_salvaging(tmp_path: Path) -> None:
    """Received 3.5 s after its samples were taken: both times are facts, and differ."""
    now = iter(range(START_NS + 3_500_000_000, START_NS + 100 * SECOND, SECOND))
    source = record(tmp_path / "late.mcap", MINUTE, clock=lambda: next(now))
    target = tmp_path / "salvaged.mcap"
    salvage(source, target)
    received = times_in(target)
    assert received == times_in(source)
    delays = {log - publish for log, publish in received[1:]}
    assert delays  # the layout has no time of its own
    assert all(delay > 2 * SECOND for delay in delays)


def test_a_summary_holds_where_its_checksum_is_that_of_its_bytes(tmp_path: Path) -> None:
    path = record(tmp_path / "whole.mcap", MINUTE)
    whole = path.read_bytes()
    assert _summary_holds(io.BytesIO(whole))
    for place in (len(whole) - 60, len(whole) - 400):  # both inside the summary
        damaged = bytearray(whole)
        damaged[place] ^= 1
        assert not _summary_holds(io.BytesIO(bytes(damaged)))
    assert not _summary_holds(io.BytesIO(whole[: len(whole) // 2]))
    assert not _summary_holds(io.BytesIO(b""))


def exit_code(monkeypatch: pytest.MonkeyPatch, *words: object) -> object:
    """Of a command."""
    monkeypatch.setattr(sys, "argv", ["pilewatch", *map(str, words)])
    with pytest.raises(SystemExit) as ended:
        main()
    return ended.value.code


def foreign(path: Path, *, also: bool = False) -> Path:
    """A file of another program with three messages, one of ours among them if wanted."""
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start()
        schema = writer.register_schema("sensor_msgs/Imu", "jsonschema", b"{}")
        channel = writer.register_channel("/imu/data", "json", schema)
        for number in range(3):
            writer.add_message(channel, number, b"{}", number)
        if also:
            name = full_name("SensorLayout")
            ours = writer.register_channel(
                "layout", "protobuf", writer.register_schema(name, "", b"")
            )
            writer.add_message(ours, 3, encode(LAYOUT), 3)
        writer.finish()
    return path


def test_what_holds_nothing_of_ours_is_one_line_and_no_file(
    recording: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    empty = tmp_path / "empty.mcap"
    empty.write_bytes(recording.read_bytes()[:900])
    other = foreign(tmp_path / "f.mcap")
    before = sorted(tmp_path.iterdir())
    for file, why in (
        (empty, "the last 754 bytes are incomplete"),
        (other, "3 messages of other programs are left out: /imu/data"),
    ):
        assert exit_code(monkeypatch, "salvage", file) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert f"{file}: nothing of it can be salvaged" in line
        assert why in line
    assert sorted(tmp_path.iterdir()) == before


def test_what_is_gone_is_counted(recording: Path, tmp_path: Path) -> None:
    whole = recording.read_bytes()
    with recording.open("rb") as file:
        offsets = [offset for offset, opcode in record_offsets(file) if opcode == Opcode.CHUNK]
    flipped = bytearray(whole)
    flipped[offsets[3] + 200] ^= 1
    recording.write_bytes(flipped)
    damaged = salvage(recording, tmp_path / "flipped.mcap")
    assert damaged.recovered.endswith("(1 more is damaged: 5 messages are gone)")
    recording.write_bytes(whole[: offsets[3] + 100])
    cut = salvage(recording, tmp_path / "cut.mcap")
    assert cut.recovered.endswith("(the last 100 bytes are incomplete: they are gone)")
    mixed = salvage(foreign(tmp_path / "mixed.mcap", also=True), tmp_path / "ours.mcap")
    assert mixed.recovered.endswith("(3 messages of other programs are left out: /imu/data)")
    assert mixed.messages == 1


def test_after_a_salvage_a_folder_says_what_to_do_with_the_result(
    recording: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (out := tmp_path / "out").mkdir()
    cut = out / "session.mcap"
    cut.write_bytes(recording.read_bytes()[:-2000])
    assert exit_code(monkeypatch, "report", out) == 2
    assert f"`pilewatch salvage {cut}` makes a recording" in capsys.readouterr().err
    assert exit_code(monkeypatch, "salvage", cut) == 0
    use = f"move session.mcap out of it and then session.mcap.salvaged.mcap to {cut}"
    assert use in capsys.readouterr().out
    assert exit_code(monkeypatch, "report", out) == 2
    text = capsys.readouterr().err
    assert use in text
    assert "pilewatch salvage" not in text
    cut.rename(tmp_path / "cut.mcap")
    (out / "session.mcap.salvaged.mcap").rename(cut)
    assert len(list(read_messages(cut))) > 40


def test_a_folder_is_no_file_to_salvage(
    recording: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    assert exit_code(monkeypatch, "salvage", tmp_path) == 2
    assert f"{tmp_path} is a folder; give the recording in it" in (text := capsys.readouterr().err)
    assert f"such as {recording}" in text
    with pytest.raises(RecordingError, match="it is a folder; give a file in it"):
        read_messages(tmp_path)


def test_one_of_a_kind_is_no_plural() -> None:
    content = SalvagedContent(
        chunks=1, damaged_chunks=1, messages=1, unreadable_messages=1, duration=2.0,
        foreign_messages=1, foreign=("/tf",), cut_bytes=1, gone_messages=1,
    )  # fmt: skip
    assert str(content) == (
        "1 complete chunk with 1 message, 2.0 s of samples, can be salvaged (1 more is damaged: "
        "1 message is gone; 1 message is unreadable; the last byte is incomplete: it is gone; "
        "1 message of other programs is left out: /tf)"
    )
