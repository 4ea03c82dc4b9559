"""Whatever a stranger publishes: it is taken or counted, and what comes out can be sent on."""

import io
import json
import struct
import tracemalloc

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.transport.codec import encode
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.feeds.address import parsed
from sensors.feeds.assembly.assembler import Assembler
from sensors.feeds.csv_tail import Rows
from sensors.feeds.mqtt import SamplesReader
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.scada import ScadaReader
from sensors.feeds.protocol import LONGEST_SENTENCE, NAMED_UNKNOWN, ChannelSamples, FeedCounts
from sensors.feeds.seedlink import SeedLinkFeed
from sensors.files.layout_file import LayoutFile, MappedChannel
from tests.sensors.feeds.seedlink_server import records

LAYOUT = LayoutFile((MappedChannel("ax", 100.0, (1.0, 0.0, 0.0)),), "t1", "top")

_numbers = st.integers(0, 2**64 - 1) | st.sampled_from([0, 1, 2, 10**18, 4 * 10**18, 2**62])
_rates = st.floats() | st.sampled_from([1e-3, 40.0, 1e6])
_frames = st.builds(
    lambda status, n, numbers, rate: (
        struct.pack("<4sHHHHIQQQd", b"PWB1", 0, status, 2, 1, n, *numbers, rate)
        + b"ax"
        + bytes(4 * n)
    ),
    st.integers(0, 2**16 - 1),
    st.integers(0, 50),
    st.tuples(_numbers, _numbers, _numbers),
    _rates,
)
_cpsens = st.builds(
    lambda order, length, seconds, rest, first, n: (
        struct.pack(f"{order}HHQQQ", length, 2, seconds, rest, first) + bytes(4 * n)
    ),
    st.sampled_from("<>"),
    st.integers(20, 40),
    _numbers,
    _numbers,
    _numbers,
    st.integers(0, 50),
)
_json = st.builds(
    lambda time, rate, values: f'{{"time": {time}, "rate": {rate}, "ax": {values}}}'.encode(),
    _numbers | st.floats(),
    _rates,
    st.lists(st.floats() | st.none(), max_size=5).map(
        lambda each: str(each).replace("None", "null")
    ),
)
_bombs = st.sampled_from(
    [
        b"[" * 200_000,
        b'{"a":' * 100_000,
        b'"' + b"x" * 2_000_000 + b'"',
        b'{"time": 1e999, "ax": 1}',
    ]
)
_named = st.builds(
    lambda names: json.dumps({"time": 1_700_000_000, **dict.fromkeys(names, 1.0)}).encode(),
    st.lists(st.text(max_size=100), max_size=40),
)
_messages = st.tuples(
    st.sampled_from(["t/ax", "c/ax/acc/raw/data", "c/ax/acc/raw/metadata"]) | st.text(max_size=30),
    _frames | _cpsens | _json | _bombs | _named | st.binary(max_size=60),
)


class Feed:
    """What an MQTT feed does with messages, without the broker."""

    def __init__(self) -> None:
        self.counts = FeedCounts()
        self.blocks: list[AccelerationBlock] = []
        self._reader = SamplesReader(parsed("mqtt://h/#"), ("ax",), self.counts)
        self._assembler = Assembler(LAYOUT, self.counts)

    def take(self, topic: str, payload: bytes) -> None:
        try:
            for piece in self._reader.read(topic, payload, retained=False):
                assert isinstance(piece, ChannelSamples)
                self.blocks += self._assembler.push(piece)
        except MessageError as error:
            self.counts.refuse(str(error))

    def finish(self) -> None:
        self.blocks += self._assembler.finish()


@settings(max_examples=60)
@given(messages=st.lists(_messages, max_size=12))
def test_any_messages_are_taken_or_counted_and_what_comes_out_can_be_sent(
    messages: list[tuple[str, bytes]],
) -> None:
    feed = Feed()
    for topic, payload in messages:
        feed.take(topic, payload)
    feed.finish()
    for block in feed.blocks:
        encode(block)
    assert len(feed.counts.unknown) <= NAMED_UNKNOWN
    for told in (*feed.counts.unknown, feed.counts.refusal):
        assert told.isprintable()
        assert len(told) <= LONGEST_SENTENCE


@settings(max_examples=40)
@given(messages=st.lists(_messages, max_size=9))
def test_whatever_came_before_the_instrument_itself_is_heard(
    messages: list[tuple[str, bytes]],
) -> None:
    feed = Feed()
    for topic, payload in messages:
        feed.take(topic, payload)
    before = len(feed.blocks)
    for second in range(40):
        values = {"ax": [float(second)] * 40}
        said = {"time": 1_710_000_000 + second, "rate": 40, "values": values}
        feed.take("t/ax", json.dumps(said).encode())
    feed.finish()
    heard = [block for block in feed.blocks[before:] if block.sampling_rate == 40.0]
    assert {float(second) for second in range(20, 40)} <= {
        float(value) for block in heard for value in block.samples[:, 0]
    }


_RECORD = records(
    "XX.TWR.00.HNX", np.arange(200) % 97, start_ns=1_700_000_000 * NANOSECONDS, sampling_rate=100.0
)[0]


@settings(max_examples=100)
@given(
    changes=st.lists(st.tuples(st.integers(0, 63), st.integers(0, 255)), max_size=4),
    encoding=st.sampled_from([0, 1, 3, 4, 5, 10, 11, 99]),  # 0 is text
)
def test_any_record_of_a_logger_is_taken_or_counted(
    changes: list[tuple[int, int]], encoding: int
) -> None:
    record = bytearray(_RECORD)
    record[52] = encoding
    for place, byte in changes:
        record[place] = byte
    feed = SeedLinkFeed(parsed("seedlink://h/XX.TWR"), once=True)
    channel = MappedChannel("XX.TWR.00.HNX", 100.0, (1.0, 0.0, 0.0))
    assembler = Assembler(LayoutFile((channel,), "t1", "top"), feed.counts)
    for piece in feed.pieces_of(1, bytes(record)):
        for block in assembler.push(piece):
            encode(block)
    assert feed.counts.received == 1


@settings(max_examples=60)
@given(rows=st.lists(st.binary(max_size=60) | st.text(max_size=60).map(str.encode), max_size=10))
def test_any_row_of_a_controllers_table_is_taken_or_counted(rows: list[bytes]) -> None:
    counts = FeedCounts()
    table = Rows(ScadaReader(parsed("scada+csv:t.csv"), "t1"), counts)
    table.begin(io.BytesIO(b"time,wind_speed,state\n"), from_start=False)
    for row in rows:
        for sample in table.samples(row):
            encode(sample)


def test_names_and_topics_without_end_cost_no_memory() -> None:
    feed = Feed()

    def storm(begin: int) -> None:
        for number in range(begin, begin + 1200):
            said = {"time": 1_700_000_000, "rate": 40, "sequence": 1, f"n{number}": [1.0] * 40}
            feed.take(f"t/{number}", json.dumps(said | {"ax": [2.0] * 40}).encode())

    storm(0)
    tracemalloc.start()
    storm(1200)
    grown, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert grown < 1_000_000
    assert len(feed.counts.unknown) == NAMED_UNKNOWN
