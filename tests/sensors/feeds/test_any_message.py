"""Whatever a stranger publishes: it is taken or counted, and what comes out can be sent on."""

import struct

from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.transport.codec import encode
from sensors.feeds.address import parsed
from sensors.feeds.assembler import Assembler
from sensors.feeds.feed import ChannelSamples, FeedCounts
from sensors.feeds.json_samples import MessageError
from sensors.feeds.mqtt import SamplesReader
from sensors.files.layout_file import LayoutFile, MappedChannel

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
_messages = st.tuples(
    st.sampled_from(["t/ax", "c/ax/acc/raw/data", "c/ax/acc/raw/metadata"]),
    _frames | _cpsens | _json | st.binary(max_size=60),
)


@settings(max_examples=60)
@given(messages=st.lists(_messages, max_size=12))
def test_any_messages_are_taken_or_counted_and_what_comes_out_can_be_sent(
    messages: list[tuple[str, bytes]],
) -> None:
    counts = FeedCounts()
    reader = SamplesReader(parsed("mqtt://h/#?rate=40"), ("ax",), counts)
    assembler = Assembler(LAYOUT, counts)
    blocks = []
    for topic, payload in messages:
        try:
            for piece in reader.read(topic, payload, retained=False):
                assert isinstance(piece, ChannelSamples)
                blocks += assembler.push(piece)
        except MessageError as error:
            counts.refuse(str(error))
    for block in [*blocks, *assembler.finish()]:
        encode(block)
