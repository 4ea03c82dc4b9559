"""What was recorded is what is read; what is no whole recording says so in one line."""

import struct
import zlib
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from itertools import pairwise
from pathlib import Path

import mcap.reader
import mcap.writer
import pytest
from google.protobuf import message_factory
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from google.protobuf.descriptor_pool import DescriptorPool
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.opcode import Opcode

from pipeline.messages import FoundationTruth, Message, StreamEnd
from pipeline.recording.errors import RecordingError
from pipeline.recording.info import recording_info
from pipeline.recording.mcap_file import complete_records, record_offsets
from pipeline.recording.reader import read_messages, read_metadata
from pipeline.recording.writer import Recorder, RecorderSettings
from pipeline.streams import STREAMS, stream_of
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_messages import (
    LAYOUT,
    START_NS,
    all_same,
    block,
    messages,
    rejection,
    status,
)
from tests.pipeline.power_cut import power_cut

SECOND = 10**9  # [ns]
TRUTH = FoundationTruth("t1", START_NS, 0.098e11, 8.238e11, 0.678e11)
METADATA = {"scenario": {"toml": "seed = 1\n"}, "pilewatch": {"version": "0.1.0"}}
FORTY_SECONDS = [LAYOUT, TRUTH, *map(block, range(40)), rejection(0)]


def record(
    path: Path,
    recorded: list[Message],
    *,
    clock: Callable[[], int] | None = None,
    chunk_duration: float = 1.0,
) -> Path:
    recorder = Recorder(
        path,
        metadata=METADATA,
        clock=clock,
        settings=RecorderSettings(chunk_duration=chunk_duration),
    )
    for message in recorded:
        assert tuple(recorder.handle(message)) == ()
    recorder.close()
    return path


@pytest.fixture
def recording(tmp_path: Path) -> Path:
    return record(tmp_path / "tower.mcap", FORTY_SECONDS)


def refusal(path: Path) -> str:
    with pytest.raises(RecordingError) as refused:
        list(read_messages(path))
    assert "\n" not in str(refused.value)
    assert str(path) in str(refused.value)
    return str(refused.value)


# ---- writing and reading -----------------------------------------------------------------------


@settings(max_examples=30)
@given(recorded=st.lists(messages.filter(lambda m: stream_of(type(m)).recorded), max_size=8))
def test_what_is_read_is_what_was_recorded(
    recorded: list[Message], tmp_path_factory: pytest.TempPathFactory
) -> None:
    path = tmp_path_factory.mktemp("any") / "tower.mcap"
    assert all_same(read_messages(record(path, recorded, clock=lambda: START_NS)), recorded)


def test_the_recorder_takes_every_message_that_is_to_be_recorded(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", metadata={}, clock=None)
    assert set(recorder.inputs) == {stream.message for stream in STREAMS if stream.recorded}
    recorder.handle(block(0))
    recorder.handle(block(1))
    assert recorder.recorded[AccelerationBlock] == 2
    recorder.close()


def test_messages_of_some_types_can_be_picked(recording: Path) -> None:
    picked = read_messages(recording, [AccelerationBlock])
    assert [message.sequence for message in picked] == list(range(40))


def test_the_scenario_and_all_that_is_needed_to_run_it_again_is_inside(recording: Path) -> None:
    assert read_metadata(recording) == METADATA


def test_the_same_messages_make_the_same_file(tmp_path: Path) -> None:
    one, other = (record(tmp_path / name, FORTY_SECONDS) for name in ("one.mcap", "other.mcap"))
    assert one.read_bytes() == other.read_bytes()


def test_another_program_reads_a_block_from_the_file_alone(recording: Path) -> None:
    with recording.open("rb") as file:
        schema, channel, message = next(
            mcap.reader.make_reader(file).iter_messages(["pilewatch/t1/tower/acceleration"])
        )
    (described,) = FileDescriptorSet.FromString(schema.data).file
    pool = DescriptorPool()
    pool.Add(described)
    block_class = message_factory.GetMessageClass(pool.FindMessageTypeByName(schema.name))
    read = block_class.FromString(message.data)
    assert (schema.encoding, channel.message_encoding) == ("protobuf", "protobuf")
    assert (message.sequence, message.publish_time) == (0, START_NS)
    assert list(read.samples.values) == block(0).samples.ravel().tolist()


def test_log_time_is_when_a_message_came_and_publish_time_when_it_was_measured(
    tmp_path: Path,
) -> None:
    received_ns = START_NS + 3600 * SECOND
    path = record(tmp_path / "a.mcap", [LAYOUT, block(5)], clock=lambda: received_ns)
    with path.open("rb") as file:
        recorded = [message for *_, message in mcap.reader.make_reader(file).iter_messages()]
    assert [message.log_time for message in recorded] == [received_ns] * 2
    assert recorded[1].publish_time == block(5).start_ns


def test_a_computed_recording_begins_with_its_first_sample(recording: Path) -> None:
    with recording.open("rb") as file:
        summary = mcap.reader.make_reader(file).get_summary()
    assert summary.statistics.message_start_time == START_NS


def test_an_hour_of_eight_channels_fits_into_four_and_a_half_megabytes(tmp_path: Path) -> None:
    five_minutes = [LAYOUT, *map(block, range(300))]
    path = record(tmp_path / "a.mcap", five_minutes, chunk_duration=60.0)
    assert 12 * path.stat().st_size <= 4.5e6


def test_a_recording_has_its_name_only_when_it_is_finished(tmp_path: Path) -> None:
    recorder = Recorder(tmp_path / "a.mcap", metadata={}, clock=None)
    recorder.handle(block(0))
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap.active"]
    recorder.close()
    recorder.close()
    assert [path.name for path in tmp_path.iterdir()] == ["a.mcap"]


@pytest.mark.parametrize("existing", ["a.mcap", "a.mcap.active"])
def test_an_earlier_recording_is_never_overwritten(tmp_path: Path, existing: str) -> None:
    (tmp_path / existing).write_bytes(b"an hour of work")
    with pytest.raises(RecordingError, match="exists already"):
        Recorder(tmp_path / "a.mcap", metadata={}, clock=None)
    assert (tmp_path / existing).read_bytes() == b"an hour of work"


def test_a_folder_that_does_not_exist_is_one_clear_line(tmp_path: Path) -> None:
    with pytest.raises(RecordingError, match="the folder must exist"):
        Recorder(tmp_path / "missing" / "a.mcap", metadata={}, clock=None)


def test_the_open_chunk_never_holds_more_than_its_time(tmp_path: Path) -> None:
    now_ns = START_NS
    recorder = Recorder(tmp_path / "a.mcap", metadata={}, clock=lambda: now_ns)
    sizes = []
    for sequence in range(10):
        now_ns += SECOND
        recorder.handle(block(sequence))
        sizes.append((tmp_path / "a.mcap.active").stat().st_size)
    recorder.close()
    assert all(later > earlier for earlier, later in pairwise(sizes[1:]))


# ---- what is no whole recording ----------------------------------------------------------------


def test_a_missing_recording_is_one_clear_line(tmp_path: Path) -> None:
    assert "No such file" in refusal(tmp_path / "missing.mcap")


def test_a_folder_is_no_recording(tmp_path: Path) -> None:
    assert "it is a folder; give a file in it" in refusal(tmp_path)


@pytest.mark.parametrize("content", [b"", b"t,x\n0,1\n", b"\x89MCAP"])
def test_a_file_of_another_kind_is_one_clear_line(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.mcap"
    path.write_bytes(content)
    assert ("is not a recording" if content else "is empty (0 bytes)") in refusal(path)


def test_a_cut_recording_says_what_can_be_salvaged(recording: Path) -> None:
    whole = recording.read_bytes()
    recording.write_bytes(whole[: len(whole) // 2])
    message = refusal(recording)
    assert "was cut off before its end" in message
    assert "complete chunks" in message


def of_another_program(path: Path, topics: dict[str, tuple[str, str]]) -> Path:
    """An MCAP file with a message on each topic, of that message encoding and schema."""
    with path.open("wb") as file:
        writer = mcap.writer.Writer(file)
        writer.start()
        for topic, (encoding, name) in topics.items():
            schema = writer.register_schema(name, "jsonschema", b"{}")
            channel = writer.register_channel(topic, encoding, schema)
            writer.add_message(channel, log_time=0, data=b"{}", publish_time=0)
        writer.finish()
    return path


def test_an_mcap_file_of_another_program_names_its_topics(tmp_path: Path) -> None:
    path = of_another_program(tmp_path / "robot.mcap", {"/robot/pose": ("json", "Pose")})
    assert refusal(path).endswith("holds no pilewatch channel, only /robot/pose")

    many = {f"/robot/{number}": ("json", "Pose") for number in range(9)}
    path = of_another_program(tmp_path / "many.mcap", many)
    assert refusal(path).endswith(
        "only /robot/0, /robot/1, /robot/2, /robot/3, /robot/4 and 4 more"
    )


def test_our_topic_in_another_encoding_says_which_and_what_is_expected(tmp_path: Path) -> None:
    ours = {"pilewatch/A/tower/acceleration": ("json", "sensor_msgs/Imu")}
    path = of_another_program(tmp_path / "ours.mcap", {"/robot/pose": ("json", "Pose"), **ours})
    assert refusal(path).endswith(
        "ours.mcap cannot be understood: it has pilewatch/A/tower/acceleration with message "
        "encoding json and schema sensor_msgs/Imu (expected: protobuf and "
        "pilewatch.AccelerationBlock)"
    )


@settings(max_examples=60)
@given(share=st.floats(0, 1, exclude_max=True), mask=st.integers(1, 255))
def test_a_flipped_byte_is_found_or_changes_nothing(
    share: float, mask: int, tmp_path_factory: pytest.TempPathFactory
) -> None:
    folder = tmp_path_factory.mktemp("flipped")
    path = record(folder / "tower.mcap", FORTY_SECONDS, chunk_duration=10.0)
    damaged = bytearray(path.read_bytes())
    damaged[int(share * len(damaged))] ^= mask
    path.write_bytes(damaged)
    try:
        read = list(read_messages(path))
        metadata = read_metadata(path)
    except RecordingError:
        return
    assert all_same(read, FORTY_SECONDS)
    assert metadata == METADATA


# ---- at one look -------------------------------------------------------------------------------


def test_info_shows_channels_durations_layouts_and_metadata(recording: Path) -> None:
    info = recording_info(recording)
    (unit,) = info.units
    assert {channel.key: channel.count for channel in info.channels} == {
        "pilewatch/t1/tower/layout": 1,
        "pilewatch/t1/truth": 1,
        "pilewatch/t1/tower/acceleration": 40,
        "pilewatch/t1/window-rejected": 1,
    }
    assert (unit.unit, unit.sampling_rate, unit.n_channels, unit.n_blocks) == ("tower", 40.0, 8, 40)
    assert info.duration == unit.duration == 40.0
    assert info.layouts == (LAYOUT,)
    other = replace(LAYOUT, turbine="t2", channels=LAYOUT.channels[:2])  # with the same id
    assert recording_info(record(recording.with_name("two.mcap"), [LAYOUT, other])).layouts == (
        LAYOUT,
        other,
    )
    assert info.metadata == METADATA
    assert info.size == recording.stat().st_size


def test_info_shows_the_gaps(tmp_path: Path) -> None:
    # sequence   0 1 2 . . . 6 7 . 9
    with_gaps = [block(sequence) for sequence in (0, 1, 2, 6, 7, 9)]
    (unit,) = recording_info(record(tmp_path / "a.mcap", with_gaps)).units
    assert [(gap.first_sequence, gap.n_blocks) for gap in unit.gaps] == [(3, 3), (8, 1)]
    assert unit.gaps[0].start_ns == block(3).start_ns
    assert unit.gaps[0].end_ns == block(6).start_ns
    assert unit.duration == 10.0


def test_info_shows_no_gap_where_a_block_was_only_late(tmp_path: Path) -> None:
    late = [block(sequence) for sequence in (0, 1, 3, 2, 4)]
    (unit,) = recording_info(record(tmp_path / "a.mcap", late)).units
    assert unit.gaps == ()


def test_info_shows_the_last_word_of_every_node(tmp_path: Path) -> None:
    said = [status("updating"), status("updating", state="stopped"), status("viewer")]
    health = recording_info(record(tmp_path / "a.mcap", said)).health
    assert {node.node: node.state for node in health} == {
        "updating": "stopped",
        "viewer": "running",
    }


def test_a_recording_without_samples_has_no_duration(tmp_path: Path) -> None:
    end = StreamEnd("t1", "tower", "session-1", START_NS, 0)
    assert recording_info(record(tmp_path / "a.mcap", [end])).duration == 0.0


def data_end_of(path: Path) -> tuple[int, int]:
    """Checksum that the data section's end states, and the one that its bytes have."""
    with path.open("rb") as file:
        *before, end = complete_records(file)
        content = path.read_bytes()
    (stated,) = struct.unpack("<I", end.content)
    assert end.opcode == Opcode.DATA_END
    assert before[-1].offset < end.offset
    return stated, zlib.crc32(content[: end.offset])


def test_the_data_section_states_its_checksum(recording: Path) -> None:
    """Metadata and message indexes lie outside the chunks: only this one covers them."""
    stated, computed = data_end_of(recording)
    assert stated == computed != 0


def test_a_message_has_the_publishers_number_or_its_count_on_the_key(tmp_path: Path) -> None:
    """Other tools find a lost block by a step in MCAP's own sequence numbers."""
    path = record(tmp_path / "a.mcap", [LAYOUT, block(7), block(9), rejection(0), rejection(1)])
    with path.open("rb") as file:
        found: dict[str, list[int]] = {}
        for _, channel, message in mcap.reader.make_reader(file).iter_messages(
            log_time_order=False
        ):
            found.setdefault(channel.topic, []).append(message.sequence)
    assert [7, 9] in found.values()
    assert [0, 1] in found.values()


@pytest.mark.parametrize("leap", [3600 * SECOND, -3600 * SECOND])
def test_a_clock_that_is_set_closes_the_open_chunk(tmp_path: Path, leap: int) -> None:
    """Until then what is recorded would lie in memory: an hour of it, for a clock set back."""
    now = START_NS + 7200 * SECOND
    recorder = Recorder(tmp_path / "clock.mcap", metadata={}, clock=lambda: now)
    recorder.handle(block(0))
    size = recorder.size
    now += leap
    recorder.handle(block(1))
    assert recorder.size > size
    recorder.close()


def test_a_clock_that_is_set_back_leaves_no_chunk_open_for_good(tmp_path: Path) -> None:
    """A day back, then a few seconds more: what came before the step is on disk."""
    path = tmp_path / "back.mcap"
    recorder = Recorder(path, metadata=METADATA, clock=None, settings=RecorderSettings())
    for number, time_ns in enumerate((START_NS, START_NS - 86_400 * SECOND)):
        recorder.record(block(number), time_ns, time_ns)
    recorder._file.flush()
    on_disk = Path(f"{path}.active").read_bytes()
    assert Opcode.CHUNK in [opcode for _, opcode in record_offsets(BytesIO(on_disk))]
    recorder.close()


def test_what_a_recording_begins_with_is_there_after_a_power_cut(tmp_path: Path) -> None:
    with power_cut(tmp_path):
        Recorder(tmp_path / "tower.mcap", metadata=METADATA, clock=None)
    (left,) = tmp_path.iterdir()
    assert left.read_bytes().startswith(b"\x89MCAP0\r\n")
    assert b"seed = 1" in left.read_bytes()
