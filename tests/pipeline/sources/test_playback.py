"""A part of a recording, several rounds, several files: the same blocks as one stream."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from pipeline.messages import ModalEstimate
from pipeline.nodes.identification import IdentificationNode
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.recording.settings import RecordingSettings
from pipeline.runtime.source_feed import with_end
from pipeline.sources.recorded_stream import Playback, SourceError, recordings_in
from pipeline.sources.session_files import one_recording
from pipeline.sources.sources import replayed, simulated
from pipeline.transport.codec import encode
from sensors.acquisition.blocks import AccelerationBlock
from sensors.errors import InputError
from tests.pipeline.example_messages import START_NS, block, same
from tests.pipeline.histories import identify_by_digests

SECOND = 10**9  # [ns]


def blocks_of(source) -> list[AccelerationBlock]:
    return [each for each in source.messages() if isinstance(each, AccelerationBlock)]


def same_samples(ones, others) -> bool:
    return len(ones) == len(others) and all(
        np.array_equal(one.samples, other.samples) for one, other in zip(ones, others, strict=True)
    )


def test_a_recording_that_a_killed_run_left_open_is_named_with_the_way_on(tmp_path: Path):
    (tmp_path / "session.mcap.active").write_bytes(b"")
    with pytest.raises(SourceError, match=r"pilewatch salvage .*session\.mcap\.active"):
        recordings_in(tmp_path)
    (tmp_path / "session.mcap.active").unlink()
    with pytest.raises(SourceError, match="holds no recording"):
        recordings_in(tmp_path)


def test_of_the_folder_that_new_made_the_recordings_below_it_are_named(tmp_path: Path):
    for name in ("recordings/mast.mcap", "out/session.mcap"):
        (tmp_path / name).parent.mkdir()
        (tmp_path / name).write_bytes(b"")
    named = rf"recordings are in {tmp_path}/out and {tmp_path}/recordings$"
    with pytest.raises(SourceError, match=named):
        recordings_in(tmp_path)


def test_a_range_holds_its_blocks_and_counts_them_from_its_beginning(short_recording: Path):
    whole = replayed(short_recording)
    part = whole.with_playback(Playback(30.0, 90.0))
    assert part.duration == 60.0
    played = blocks_of(part)
    assert same_samples(played, blocks_of(whole)[30:90])
    assert [block.sequence for block in played] == list(range(60))
    assert played[0].first_sample == 0
    assert played[0].start_ns == blocks_of(whole)[30].start_ns


def booted(*boots: tuple[int, range]) -> list[AccelerationBlock]:
    """Blocks of a unit under one session's name: of each boot its second and its numbers."""
    n_samples = len(block(0).samples)
    return [
        replace(
            block(number),
            first_sample=number * n_samples,
            start_ns=START_NS + (second + number - numbers.start) * SECOND,
        )
        for second, numbers in boots
        for number in numbers
    ]


def numbers_from(start: float, blocks: list[AccelerationBlock]) -> list[int]:
    """Of the blocks that are played; their first samples follow them."""
    played = [
        each
        for each in Playback(start).of(lambda: blocks)
        if isinstance(each, AccelerationBlock) and encode(each)
    ]
    n_samples = len(block(0).samples)
    assert [each.first_sample for each in played] == [each.sequence * n_samples for each in played]
    return [each.sequence for each in played]


@pytest.mark.parametrize(
    ("start", "boots", "numbers"),
    [
        (10.0, [(0, range(20)), (30, range(5))], [*range(10), *range(5)]),
        (32.0, [(0, range(20)), (30, range(5))], [*range(3)]),
        (10.0, [(0, range(20)), (30, range(5)), (40, range(3))], [*range(10), *range(5), 0, 1, 2]),
        (10.0, [(0, range(20)), (30, range(12, 20))], [*range(10), *range(2, 10)]),
        (10.0, [(0, range(12)), (30, range(7, 20))], [*range(2), *range(7, 20)]),
        (5.0, [(0, range(3, 20))], [*range(12)]),
    ],
    ids=["restarted", "from within the second", "twice", "late", "late and below", "cut before"],
)
def test_a_range_counts_each_boot_of_a_unit_by_itself(
    start: float, boots: list[tuple[int, range]], numbers: list[int]
) -> None:
    """The boot in which the range begins from there, later ones as the unit did; one of which the
    first blocks are missing, and that shows by its stamps alone, as what came before it."""
    assert numbers_from(start, booted(*boots)) == numbers


def test_rounds_follow_each_other_in_time_as_sessions_of_their_own(short_recording: Path):
    played = blocks_of(replayed(short_recording).with_playback(Playback(0.0, 20.0, rounds=3)))
    assert len(played) == 60
    assert len({block.session for block in played}) == 3
    steps = np.diff([block.start_ns for block in played])
    assert (steps == SECOND).all()
    assert same_samples(played[:20], played[40:])


def parts(folder: Path, recording: Path, overlap: int) -> None:
    """The recording in parts of a minute, each starting with the last blocks of the one before."""
    now_ns = [START_NS]
    source = replayed(recording)
    recorder = SessionRecorder(
        folder / "session.mcap",
        metadata=source.metadata,
        clock=lambda: now_ns[0],
        settings=RecordingSettings(rotate_after=60.0),
        free=lambda _: 10**12,
    )
    latest: list[AccelerationBlock] = []
    for message in with_end(source.messages()):
        part = recorder.path
        recorder.handle(message)
        if recorder.path != part:
            for again in latest[-overlap:]:
                recorder.handle(again)
        if isinstance(message, AccelerationBlock):
            now_ns[0] += SECOND
            latest.append(message)
    recorder.close()


@pytest.mark.parametrize("overlap", [1, 50])
def test_several_files_are_one_stream_without_repeats(tmp_path, short_recording, overlap):
    parts(tmp_path, short_recording, overlap)
    assert len(list(tmp_path.glob("*.mcap"))) > 3
    joined, whole = replayed(tmp_path), replayed(short_recording)
    assert joined.duration == whole.duration
    assert same_samples(blocks_of(joined), blocks_of(whole))
    assert joined.truth == whole.truth


def test_a_replay_of_the_parts_gives_the_windows_of_the_whole_bit_for_bit(
    tmp_path, short_recording, monkeypatch
):
    """What is identified of them is a digest of their samples."""
    identify_by_digests(monkeypatch.setattr)
    parts(tmp_path, short_recording, 5)
    one, many = (first_estimate(replayed(path)) for path in (short_recording, tmp_path))
    assert same(one, many)


def first_estimate(source) -> ModalEstimate:
    """Of the first window, as the live session would have given it."""
    node = IdentificationNode(source.scenario.oma)
    answers = (answer for message in source.messages() for answer in node.handle(message))
    return next(answer for answer in answers if isinstance(answer, ModalEstimate))


def test_playback_begins_at_the_first_sample_or_at_any_moment_after_it():
    assert (Playback(0.0).start, Playback(0.1).start) == (0.0, 0.1)
    with pytest.raises(InputError, match=r"--from -0\.1 is before the first"):
        Playback(-0.1)


def test_of_two_recordings_one_is_to_be_named(short_recording: Path, tmp_path: Path):
    first = Path(shutil.copy(short_recording, tmp_path / "a.mcap"))
    assert one_recording(tmp_path) == one_recording(first) == first
    shutil.copy(short_recording, tmp_path / "b.mcap")
    with pytest.raises(SourceError, match=r"has 2 recordings; name one of a\.mcap, b\.mcap$"):
        one_recording(tmp_path)


def test_what_cannot_be_played_is_one_line(short_recording: Path, tmp_path: Path):
    with pytest.raises(InputError, match="--from 5 --to 3 is no range"):
        Playback(5.0, 3.0)
    with pytest.raises(InputError, match="--loop 0 plays nothing"):
        Playback(rounds=0)
    with pytest.raises(SourceError, match="--from 500 lies behind the end of"):
        replayed(short_recording).with_playback(Playback(500.0))
    with pytest.raises(SourceError, match="are for replay:FILE"):
        simulated(replayed(short_recording).scenario).with_playback(Playback(5.0))
    with pytest.raises(SourceError, match="holds no recording"):
        replayed(tmp_path)


def test_nothing_is_read_far_behind_the_end_once_every_unit_is_there():
    read: list[AccelerationBlock] = []
    some = block(0)

    def stream():
        for second in range(5000):
            for unit, late in (("tower", 0), ("slow", 100)):
                start_ns = START_NS + max(0, second - late) * SECOND
                read.append(replace(some, unit=unit, sequence=second, start_ns=start_ns))
                yield read[-1]

    played = list(Playback(end=10.0).of(stream))
    assert [each.sequence for each in played if each.unit == "tower"] == list(range(10))
    late = [each.start_ns for each in played if each.unit == "slow"]
    assert max(late) == START_NS + 9 * SECOND
    assert 2 * 700 <= len(read) <= 2 * 715
