"""Binary messages of HBK acquisition units, written here byte by byte."""

import json
import struct

import numpy as np
import pytest

from sensors.acquisition.blocks import BlockStatus
from sensors.feeds.payloads.cpsens import CpSensReader, descriptor_of, is_cpsens
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.protocol import ChannelSamples, FeedCounts

BASE = "cpsens/d8-3a-dd-f5-92-48/3050-A-060_sn_106209/1/acc/raw"
SECONDS = 1_741_618_465
VALUES = np.arange(32) / 8
METADATA = {
    "Data": {"Type": "float", "Samples": 32, "Unit": "m/s^2"},
    "Sensor": {"Sensing": "acceleration", "Sensitivity": 100.0, "S/N": "12345"},
    "Analysis chain": [
        {"Name": "acquisition", "Output": "raw", "Sampling": 2048.0},
        {"Name": "decimation", "Output": "raw", "Sampling": 512.0},
    ],
    "Engineering": {"channelName": "156149X+"},
    "TimeAtAquisitionStart": {"Seconds": SECONDS, "Nanosec": 641_669_098},
}


def data(
    first: int, *, order: str = "<", seconds: int = 0, nanoseconds: int = 0, kind: str = "f"
) -> bytes:
    head = struct.pack(f"{order}HHQQQ", 28, 2, seconds, nanoseconds, first)
    return head + struct.pack(f"{order}32{kind}", *VALUES)


def reader(
    counts: FeedCounts | None = None, rate: float | None = None, listed: tuple[str, ...] = ()
) -> CpSensReader:
    return CpSensReader(
        listed, counts or FeedCounts(), sampling_rate=rate, clock=lambda: 5_000_000_000_000
    )


def told(
    metadata: dict[str, object], payload: bytes, listed: tuple[str, ...] = ()
) -> ChannelSamples:
    known = reader(listed=listed)
    assert known.read(json.dumps(metadata).encode(), f"{BASE}/metadata") is None
    piece = known.read(payload, f"{BASE}/data")
    assert piece is not None
    return piece


@pytest.mark.parametrize("order", ["<", ">"])
@pytest.mark.parametrize(("named", "kind"), [("float", "f"), ("double", "d")])
def test_samples_are_read_in_either_order_and_precision(order: str, named: str, kind: str) -> None:
    metadata = METADATA | {"Data": {"Type": named, "Unit": "m/s^2"}}
    payload = data(64, order=order, seconds=SECONDS, nanoseconds=250_000_000, kind=kind)
    piece = told(metadata, payload)
    np.testing.assert_array_equal(piece.samples[:, 0], VALUES)
    assert piece.start_ns == SECONDS * 10**9 + 250_000_000
    assert (piece.sampling_rate, piece.unit) == (512.0, "m/s^2")


@pytest.mark.parametrize(("named", "kind"), [("short", "h"), ("int", "i"), ("long", "i")])
def test_integers_have_the_bytes_that_the_units_c_compiler_gives_them(
    named: str, kind: str
) -> None:
    """A long of the unit has four bytes."""
    counts = np.arange(-3, 29)
    head = struct.pack("<HHQQQ", 28, 2, SECONDS, 0, 0)
    metadata = METADATA | {"Data": {"Type": named, "Unit": "m/s^2"}}
    piece = told(metadata, head + struct.pack(f"<32{kind}", *counts.tolist()))
    np.testing.assert_array_equal(piece.samples[:, 0], counts)


def test_a_descriptor_of_32_bytes_tells_its_columns() -> None:
    head = struct.pack(">HHQQQHH", 32, 2, SECONDS, 0, 0, 4, 2)
    piece = told(METADATA, head + VALUES.astype("<f4").tobytes())
    np.testing.assert_array_equal(piece.samples, VALUES.reshape(16, 2))
    assert [name.rpartition("/")[2] for name in piece.names] == ["1", "2"]


def test_without_a_true_fraction_of_a_second_the_time_is_counted_from_the_acquisitions_start() -> (
    None
):
    # the example of the documentation: seconds, "nanoseconds" and number of one message
    piece = told(METADATA, data(400_319_264, seconds=1_742_400_339, nanoseconds=1_504_491_492_025))
    since = 400_319_264 * 10**9 // 512
    assert piece.start_ns == SECONDS * 10**9 + 641_669_098 + since
    assert piece.start_ns // 10**9 == 1_742_400_339
    assert piece.status is BlockStatus.OK


def test_a_unit_without_a_clock_is_timed_by_arrival_and_says_so() -> None:
    counts = FeedCounts()
    known = reader(counts, rate=512.0)
    pieces = [known.read(data(first), f"{BASE}/data") for first in (0, 32, 96)]
    assert [piece.start_ns - 5 * 10**12 for piece in pieces if piece] == [
        0,
        62_500_000,
        187_500_000,
    ]
    assert {piece.status for piece in pieces if piece} == {BlockStatus.CLOCK_UNSYNCHRONISED}
    assert [piece.follows for piece in pieces if piece] == [False, True, False]
    assert counts.lost == 1


@pytest.mark.parametrize(
    "name", ["156149X+", "12345", BASE, f"{BASE}/data", BASE.removesuffix("/acc/raw"),
             "3050-A-060_sn_106209/1", "1"],
)  # fmt: skip
def test_a_layout_may_know_a_channel_by_any_of_its_names(name: str) -> None:
    assert told(METADATA, data(0, seconds=SECONDS), ("other", name)).names == (name,)


def test_samples_wait_for_no_metadata() -> None:
    with pytest.raises(MessageError, match="no metadata yet"):
        reader().read(data(0), f"{BASE}/data")


@pytest.mark.parametrize(
    ("payload", "sentence"),
    [
        (b"", "no CP-SENS descriptor"),
        (bytes(40), "no CP-SENS descriptor"),
        (data(0)[:-3], "125 bytes of samples; a multiple of 4"),
        (data(0)[:28], "0 bytes of samples"),
        (data(2**63), "a descriptor of 0 s since 1970, sample 9223372036854775808"),
        (data(0, seconds=2**62), "a descriptor of"),
    ],
)
def test_what_is_no_data_message_is_refused_in_one_sentence(payload: bytes, sentence: str) -> None:
    with pytest.raises(MessageError, match=sentence):
        reader(rate=512.0).read(payload, f"{BASE}/data")


@pytest.mark.parametrize(
    "metadata",
    [[], {}, {"Analysis chain": []}, {"Analysis chain": [7]}, {"Analysis chain": [{"Sampling": 0}]},
     METADATA | {"Data": {"Type": "quaternion"}}],
)  # fmt: skip
def test_metadata_that_tell_too_little_are_refused(metadata: object) -> None:
    with pytest.raises(MessageError, match="metadata"):
        reader().read(json.dumps(metadata).encode(), f"{BASE}/metadata")


def test_messages_are_known_by_topic_and_descriptor() -> None:
    assert is_cpsens(f"{BASE}/data", data(0))
    assert is_cpsens(f"{BASE}/metadata", b"{}")
    assert not is_cpsens("tower/ax", data(0))
    assert not is_cpsens(f"{BASE}/data", b'{"time": 1700000000, "value": 1.0}')
    assert descriptor_of(data(7)).first_sample == 7
