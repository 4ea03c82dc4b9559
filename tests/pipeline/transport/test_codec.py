"""What is sent and recorded is what was meant, and nothing else is let in."""

import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from google.protobuf.descriptor_pb2 import FileDescriptorSet
from hypothesis import example, given
from hypothesis import strategies as st

from pipeline import messages as message_types
from pipeline.messages import (
    FoundationPosterior,
    Message,
    ModalEstimate,
    NodeStatus,
    RecordedUntil,
    WindowRejected,
)
from pipeline.streams import STREAMS
from pipeline.transport.codec import LARGEST_PAYLOAD, SCHEMA_NAMES, decode, encode, schema
from pipeline.transport.errors import CodecError
from pipeline.transport.proto import pilewatch_pb2
from sensors.acquisition import blocks, layout, scada
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from sensors.acquisition.scada import ScadaSample
from tests.pipeline.example_messages import START_NS, block, messages, rejection, same

TYPES = [stream.message for stream in STREAMS]


@given(messages)
def test_what_is_decoded_is_what_was_encoded(message: Message) -> None:
    assert same(decode(type(message), encode(message)), message)


@given(st.sampled_from(TYPES), st.binary(max_size=200))
def test_any_bytes_are_a_message_or_a_codec_error(message_type: type, payload: bytes) -> None:
    try:
        message = decode(message_type, payload)
    except CodecError:
        return
    assert isinstance(message, message_type)


@given(messages, st.lists(st.tuples(st.integers(0, 10**6), st.integers(1, 255)), min_size=1))
def test_a_damaged_message_is_a_message_or_a_codec_error(
    message: Message, flips: list[tuple[int, int]]
) -> None:
    payload = bytearray(encode(message))
    for position, mask in flips:
        if payload:
            payload[position % len(payload)] ^= mask
    try:
        decode(type(message), bytes(payload))
    except CodecError:
        return


@given(messages, st.sampled_from(TYPES))
def test_a_message_read_as_another_type_is_a_message_or_a_codec_error(
    message: Message, message_type: type
) -> None:
    try:
        decode(message_type, encode(message))
    except CodecError:
        return


def test_another_program_reads_a_block_from_its_schema_alone() -> None:
    sent = block(7)
    read = pilewatch_pb2.AccelerationBlock.FromString(encode(sent))
    assert (read.turbine, read.sequence, read.start_ns) == ("t1", 7, sent.start_ns)
    assert np.array_equal(
        np.float32(read.samples.values).reshape(read.samples.rows, read.samples.columns),
        sent.samples,
    )


def test_a_block_from_another_program_is_understood() -> None:
    sent = block(7)
    written = pilewatch_pb2.AccelerationBlock(
        turbine=sent.turbine,
        unit=sent.unit,
        session=sent.session,
        layout_id=sent.layout_id,
        sequence=sent.sequence,
        first_sample=sent.first_sample,
        start_ns=sent.start_ns,
        sampling_rate=sent.sampling_rate,
        samples=pilewatch_pb2.FloatMatrix(rows=40, columns=8, values=sent.samples.ravel()),
    )
    assert same(decode(AccelerationBlock, written.SerializeToString()), sent)


def test_the_schema_has_the_names_of_the_python_types_and_fields() -> None:
    renamed = {older: name for name, older in SCHEMA_NAMES.items()}
    for described in schema().message_type:
        if described.name.endswith("Matrix"):
            continue
        name = renamed.get(described.name, described.name)
        python_type = next(
            getattr(module, name)
            for module in (message_types, blocks, layout, scada)
            if hasattr(module, name)
        )
        assert [field.name for field in described.field] == [f.name for f in fields(python_type)]


def test_the_generated_code_is_that_of_the_schema(tmp_path: Path) -> None:
    pytest.importorskip("grpc_tools", reason="grpcio-tools is not installed")
    described = tmp_path / "described"
    subprocess.run(
        [
            *[sys.executable, "-m", "grpc_tools.protoc", "--proto_path=."],
            f"--descriptor_set_out={described}",
            "pipeline/transport/proto/pilewatch.proto",
        ],
        cwd=Path(__file__).parents[3],
        check=True,
        timeout=60,
    )
    (file,) = FileDescriptorSet.FromString(described.read_bytes()).file
    file.ClearField("source_code_info")
    for message in file.message_type:
        for field in message.field:
            field.ClearField("json_name")
    assert file == schema()


def test_every_message_that_travels_has_its_schema() -> None:
    described = {message.name for message in schema().message_type}
    assert {message_type.__name__ for message_type in TYPES} <= described


def test_samples_of_another_precision_are_sent_as_float32() -> None:
    sent = replace(block(0), samples=np.array([[0.1, 0.2]]))
    assert decode(AccelerationBlock, encode(sent)).samples.dtype == np.float32


@pytest.mark.parametrize(
    ("wrong", "sentence"),
    [
        ({"sampling_rate": 0.0}, "sampling_rate is 0.0 Hz"),
        ({"sampling_rate": float("nan")}, "sampling_rate is nan Hz"),
        ({"sampling_rate": 1e-300}, "sampling_rate is 1e-300 Hz"),
        ({"sequence": -1}, "sequence is -1"),
        ({"sequence": 1.5}, "cannot be interpreted as an integer"),
        ({"start_ns": 2**62}, "sensor times are"),
        ({"samples": np.zeros((0, 8), np.float32)}, r"shape \(0, 8\)"),
        ({"samples": np.zeros(8, np.float32)}, "1 axes"),
        ({"samples": np.zeros((1, 8), complex)}, "Cannot cast"),
        ({"turbine": "\ud800"}, "AccelerationBlock cannot be written"),
        ({"unit": 5}, "AccelerationBlock cannot be written"),
    ],
)
def test_a_block_that_contradicts_itself_is_not_sent(wrong: dict, sentence: str) -> None:
    with pytest.raises(CodecError, match=sentence):
        encode(replace(block(0), **wrong))


def test_a_block_whose_samples_do_not_fill_its_rows_is_refused() -> None:
    written = pilewatch_pb2.AccelerationBlock.FromString(encode(block(0)))
    written.samples.rows = 41
    with pytest.raises(CodecError, match="reshape"):
        decode(AccelerationBlock, written.SerializeToString())


def test_a_payload_beyond_all_reason_is_refused_unread() -> None:
    with pytest.raises(CodecError, match="largest allowed"):
        decode(NodeStatus, bytes(LARGEST_PAYLOAD + 1))


def test_a_layout_of_more_channels_than_any_unit_has_is_refused() -> None:
    written = pilewatch_pb2.SensorLayout(turbine="t1", unit="tower")
    for number in range(5000):
        written.channels.add(name=str(number), direction=[1.0, 0.0, 0.0], coupling="dc")
    with pytest.raises(CodecError, match="5000 channels; a unit has 1 to 4096"):
        decode(SensorLayout, written.SerializeToString())


def test_a_mode_with_fewer_components_than_channels_is_refused() -> None:
    written = pilewatch_pb2.ModalEstimate(turbine="t1", channels=["a", "b"], weight=1.0)
    written.modes.add(shape=[1.0]).covariance_factor.rows = 4
    with pytest.raises(CodecError, match="2 channels"):
        decode(ModalEstimate, written.SerializeToString())


@pytest.mark.parametrize("weight", [0.0, -1.0, 1.5, 1e-300, float("nan"), float("inf")])
def test_a_window_of_which_no_share_is_new_is_refused(weight: float) -> None:
    written = pilewatch_pb2.ModalEstimate(turbine="t1", channels=["a"], weight=weight)
    with pytest.raises(CodecError, match="weight is"):
        decode(ModalEstimate, written.SerializeToString())


@pytest.mark.parametrize("level", [1e150, float("inf"), float("-inf")])
def test_a_water_level_beyond_all_reason_is_refused(level: float) -> None:
    estimate = pilewatch_pb2.ModalEstimate(turbine="t1", weight=1.0, water_level=level)
    sample = pilewatch_pb2.ScadaSample(turbine="t1", water_level=level)
    with pytest.raises(CodecError, match="water_level is"):
        decode(ModalEstimate, estimate.SerializeToString())
    with pytest.raises(CodecError, match="water_level is"):
        decode(ScadaSample, sample.SerializeToString())


def test_a_window_that_ends_before_it_begins_is_refused() -> None:
    written = pilewatch_pb2.ModalEstimate(turbine="t1", weight=1.0, start_ns=2, end_ns=1)
    with pytest.raises(CodecError, match="end_ns 1 lies before start_ns 2"):
        decode(ModalEstimate, written.SerializeToString())


def test_a_mode_that_no_channel_shows_is_refused() -> None:
    written = pilewatch_pb2.ModalEstimate(turbine="t1", weight=1.0)
    written.modes.add().covariance_factor.rows = 2
    with pytest.raises(CodecError, match="modes without a channel"):
        decode(ModalEstimate, written.SerializeToString())


def test_a_posterior_without_its_correlation_is_refused() -> None:
    named = [
        pilewatch_pb2.ParameterSummary(name=name, nominal=1.0)
        for name in ("k11", "k22", "k12", "sigma")
    ]
    written = pilewatch_pb2.FoundationPosterior(turbine="t1", time_ns=START_NS)
    with pytest.raises(CodecError, match="parameters are"):
        decode(FoundationPosterior, written.SerializeToString())
    written.parameters.extend(named)
    with pytest.raises(CodecError, match="correlation"):
        decode(FoundationPosterior, written.SerializeToString())


def test_a_nominal_stiffness_of_zero_has_no_ratios_and_is_refused() -> None:
    written = pilewatch_pb2.FoundationPosterior(turbine="t1", time_ns=START_NS)
    for name in ("k11", "k22", "k12", "sigma"):
        written.parameters.add(name=name, nominal=float(name != "k22"))
    with pytest.raises(CodecError, match=r"k22: nominal is 0\.0; ratios need"):
        decode(FoundationPosterior, written.SerializeToString())


def test_a_mode_with_more_columns_in_common_than_columns_is_refused() -> None:
    written = pilewatch_pb2.ModalEstimate(turbine="t1", channels=["a"], weight=1.0)
    mode = written.modes.add(shape=[1.0], n_block_columns=3)
    mode.covariance_factor.rows, mode.covariance_factor.columns = 3, 2
    mode.covariance_factor.values.extend([0.0] * 6)
    with pytest.raises(CodecError, match="3 of 2 columns are common"):
        decode(ModalEstimate, written.SerializeToString())


def test_an_acknowledged_range_without_a_block_is_refused() -> None:
    written = pilewatch_pb2.RecordedUntil(turbine="t1", unit="tower", session="s1")
    written.ranges.add(first=7, end=7)
    with pytest.raises(CodecError, match="blocks 7 to 7 are no range"):
        decode(RecordedUntil, written.SerializeToString())


@pytest.mark.parametrize("direction", [[1.0, 0.0], [1.0, 0.0, 0.0, 0.0]])
def test_a_direction_has_three_numbers_and_no_other_is_understood(direction: list[float]) -> None:
    written = pilewatch_pb2.SensorLayout(layout_id="l", turbine="t1", unit="tower")
    written.channels.add(name="a", direction=direction, coupling="dc")
    with pytest.raises(CodecError, match=f"direction has {len(direction)} numbers, not 3"):
        decode(SensorLayout, written.SerializeToString())


@given(st.floats(width=32))
@example(-0.0)
@example(float("nan"))
@example(float("-inf"))
def test_a_sample_keeps_its_bits(sample: float) -> None:
    sent = replace(block(0), samples=np.array([[sample]], np.float32))
    received = decode(AccelerationBlock, encode(sent)).samples
    assert received.tobytes() == sent.samples.tobytes()


def test_samples_end_years_before_the_latest_time_that_a_window_may_end_at() -> None:
    """A window of what the latest block begins, ten years long, still has a time on the wire."""
    year = 365 * 86_400 * 10**9  # [ns]
    latest = replace(block(0), start_ns=2**62 - 19 * year)
    window = replace(rejection(0), start_ns=latest.start_ns, end_ns=latest.start_ns + 10 * year)
    assert same(decode(AccelerationBlock, encode(latest)), latest)
    assert same(decode(WindowRejected, encode(window)), window)
    with pytest.raises(CodecError, match="samples end before"):
        encode(replace(latest, start_ns=2**62 - 17 * year))
