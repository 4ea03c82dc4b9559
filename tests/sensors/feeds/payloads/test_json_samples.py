"""What JSON messages say, and what is wrong with those that say nothing."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.feeds.payloads.json_samples import JsonReader, MessageError, json_of
from sensors.feeds.payloads.timestamps import moment_ns
from sensors.feeds.protocol import ChannelSamples, FeedCounts

START = 1_700_000_000_000_000_000


def read(
    message: object, topic: str = "tower/unit", counts: FeedCounts | None = None
) -> list[ChannelSamples]:
    reader = JsonReader(("ax", "ay", "unit/az"), counts or FeedCounts())
    payload = message if isinstance(message, bytes) else json.dumps(message).encode()
    return list(reader.read(payload, topic))


def test_one_sample_of_several_channels() -> None:
    (piece,) = read({"time": 1_700_000_000.5, "ax": 0.5, "ay": -1, "note": "fine"})
    assert piece.names == ("ax", "ay")
    assert piece.start_ns == START + 500_000_000
    assert piece.sampling_rate is None
    np.testing.assert_array_equal(piece.samples, [[0.5, -1.0]])


def test_a_number_written_as_text_is_a_sample_of_a_channel_that_the_layout_lists() -> None:
    (piece,) = read({"time": 1_700_000_000, "ax": "0.5", "ay": "-1e0", "serial": "12"})
    assert (piece.names, piece.samples.tolist()) == (("ax", "ay"), [[0.5, -1.0]])
    with pytest.raises(MessageError, match="'ax' is '0,5', which is no number"):
        read({"time": 1_700_000_000, "ax": "0,5"})


def test_a_placeholder_is_a_missing_sample_of_its_channel_alone() -> None:
    (piece,) = read({"time": 1_700_000_000, "ax": "N/A", "ay": -1})
    assert piece.names == ("ax", "ay")
    np.testing.assert_array_equal(piece.samples, [[np.nan, -1.0]])


def test_several_samples_at_a_rate() -> None:
    (piece,) = read(
        {"t": 1_700_000_000, "rate": 40, "values": {"ax": [1, 2, 3], "ay": [4, None, 6]}}
    )
    assert piece.sampling_rate == 40
    np.testing.assert_array_equal(piece.samples, [[1, 4], [2, np.nan], [3, 6]])


@pytest.mark.parametrize(
    ("topic", "name"),
    [("tower/ax", "ax"), ("tower/unit/az", "unit/az"), ("tower/temp", "temp"), ("ay", "ay")],
)
def test_a_topic_names_the_one_channel_of_its_messages(topic: str, name: str) -> None:
    (piece,) = read({"timestamp": "2023-11-14T22:13:20Z", "fs": 40, "value": [1, 2]}, topic)
    assert piece.names == (name,)
    assert piece.start_ns == START


def test_a_list_of_samples_is_taken_one_by_one() -> None:
    pieces = read([{"time": 1_700_000_000 + i / 40, "ax": i} for i in range(5)])
    assert [piece.samples[0, 0] for piece in pieces] == [0, 1, 2, 3, 4]


def test_numbered_messages_tell_what_was_lost() -> None:
    counts = FeedCounts()
    reader = JsonReader(("ax",), counts)
    follows = [
        [piece.follows for piece in reader.read(json.dumps(said).encode(), "t")]
        for said in ({"time": i, "seq": i, "ax": 0} for i in (1, 2, 5, 5))
    ]
    assert follows == [[False], [True], [False], []]
    assert (counts.lost, counts.duplicate) == (2, 1)


@pytest.mark.parametrize(
    "written",
    [1_700_000_000, 1_700_000_000.0, 1_700_000_000_000, START, "2023-11-14T23:13:20+01:00",
     "2023-11-14 22:13:20", "1700000000", 1_700_000_000_000_000],
)  # fmt: skip
def test_times_are_read_however_they_are_written(written: object) -> None:
    assert moment_ns(written) == START


@settings(max_examples=100)
@given(time_ns=st.integers(10**18, 4 * 10**18 - 1))
def test_nanoseconds_are_read_exactly(time_ns: int) -> None:
    assert moment_ns(time_ns) == moment_ns(str(time_ns)) == time_ns


@pytest.mark.parametrize(
    ("message", "sentence"),
    [
        (b"hello", "no JSON: b'hello'"),
        (b"[" * 100_000, "no JSON"),
        (b'{"time": 1, "ax": ' + b"9" * 5000 + b"}", "no JSON"),
        (7, "7 is no sample; an object is"),
        ({"ax": 1}, "no time in it"),
        ({"time": "noon", "ax": 1}, "time: 'noon' is no time"),
        ({"time": -5, "ax": 1}, "time: -5 is no time since 1970"),
        ({"time": 1e300, "ax": 1}, "is no time since 1970"),
        ({"time": True, "ax": 1}, "time: True is no time"),
        ({"time": 1}, "no values in it"),
        ({"time": 1, "ax": {"b": 1}}, "'ax' is {'b': 1}, which is no number"),
        ({"time": 1, "value": [1, "x"]}, "which is no number"),
        ({"time": 1, "rate": 40, "values": {"ax": [1, 2], "ay": [1]}}, "channels of 1 and 2"),
        ({"time": 1, "values": {"ax": [1, 2]}}, "2 samples and no rate"),
        ({"time": 1, "rate": 0, "ax": 1}, "rate is 0"),
        ({"time": 1, "rate": "40", "ax": 1}, "rate is '40', which is no number"),
        ({"time": 1, "seq": 10**30, "ax": 1}, "seq is 1000000000"),
    ],
)  # fmt: skip
def test_what_is_wrong_with_a_message_is_one_sentence(message: object, sentence: str) -> None:
    with pytest.raises(MessageError) as caught:
        read(message)
    assert sentence in str(caught.value)
    assert "\n" not in str(caught.value)


_JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(
        st.sampled_from(["time", "rate", "seq", "session", "values", "value", "ax", "unit"]), inner
    ),
    max_leaves=8,
)  # fmt: skip


@settings(max_examples=80)
@given(message=_JSON)
def test_no_json_does_more_than_be_refused(message: object) -> None:
    try:
        for piece in read(message):
            assert piece.samples.ndim == 2
    except MessageError as error:
        assert "\n" not in str(error)  # noqa: PT017  # either is right


def test_a_message_of_more_than_a_megabyte_is_not_read() -> None:
    assert json_of(b"1".rjust(2**20)) == 1
    with pytest.raises(MessageError, match="at most 1048576"):
        json_of(b"1".rjust(2**20 + 1))
