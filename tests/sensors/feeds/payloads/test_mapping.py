"""A declared mapping finds every sample of a message, and a preset those of each vendor."""

import json
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.acquisition.blocks import NANOSECONDS
from sensors.arrays import FloatArray
from sensors.feeds.address import parsed
from sensors.feeds.mqtt import SamplesReader
from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.mapped_reader import MappedReader
from sensors.feeds.payloads.mapping import (
    PayloadMapping,
    looked_up,
    mapping_from_table,
    mapping_named,
    presets,
)
from sensors.feeds.payloads.sniff import sniffed
from sensors.feeds.protocol import ChannelSamples, FeedCounts, FeedError
from tests.sensors.feeds.payloads.shapes import (
    RATE,
    SAMPLES,
    SHAPES,
    Messages,
    Shape,
    encoded,
    iso,
    time_ms,
)

ONE_SHAPE = pytest.mark.parametrize("shape", SHAPES, ids=lambda shape: shape.preset)


def pieces_of(messages: Messages, shape: Shape, counts: FeedCounts) -> list[ChannelSamples]:
    reader = MappedReader(mapping_named(shape.preset), shape.names, counts)
    return [piece for topic, payload in messages for piece in reader.read(payload, topic)]


def samples_of(pieces: list[ChannelSamples]) -> dict[tuple[str, int], float]:
    """Value by channel and time [ns]."""
    found: dict[tuple[str, int], float] = {}
    for piece in pieces:
        for row, values in enumerate(piece.samples):
            step = 0 if row == 0 else round(row * 1e9 / (piece.sampling_rate or np.nan))
            for name, value in zip(piece.names, values, strict=True):
                assert (name, piece.start_ns + step) not in found
                found[name, piece.start_ns + step] = float(value)
    return found


@ONE_SHAPE
def test_a_preset_gives_every_sample_at_its_time(shape: Shape) -> None:
    counts = FeedCounts()
    found = samples_of(pieces_of(shape.messages(), shape, counts))

    wanted = {
        (name, time_ms(i) * 1_000_000): SAMPLES[i, at]
        for i in range(len(SAMPLES))
        for at, name in enumerate(shape.names)
    }
    near = {  # other numbers of a message (status, counters) are channels that no layout lists
        (name, round(time_ns, -3)): value
        for (name, time_ns), value in found.items()
        if name in shape.names
    }
    assert near == wanted
    assert (counts.lost, counts.duplicate, counts.late) == (0, 0, 0)


@pytest.mark.parametrize(
    "shape", [each for each in SHAPES if each.numbered], ids=lambda shape: shape.preset
)
def test_a_message_that_is_missing_or_comes_twice_is_counted(shape: Shape) -> None:
    counts, messages = FeedCounts(), shape.messages()
    if len(messages) > 3:
        pieces_of([*messages[:1], *messages[2:], messages[-1]], shape, counts)
        assert counts.lost == (10 if shape.preset == "csijson" else 1)  # there by rows
    else:
        pieces_of([*messages, messages[-1]], shape, counts)
    assert counts.duplicate == (10 if shape.preset == "csijson" else 1)


@ONE_SHAPE
def test_units_of_the_message_are_kept(shape: Shape) -> None:
    units = {piece.unit for piece in pieces_of(shape.messages(), shape, FeedCounts())}

    said = ("csijson", "campbell-geojson", "telegraf", "senml", "nested")
    assert units == {"m/s^2" if shape.preset in said else ""}


@ONE_SHAPE
def test_sniffing_finds_the_preset_or_proposes_a_mapping_that_reads_the_same(shape: Shape) -> None:
    found = sniffed(shape.messages())

    assert found.refused == 0
    assert {each: found.channels.get(each) for each in shape.names} == dict.fromkeys(
        shape.names, len(SAMPLES)
    )
    assert found.sampling_rate == pytest.approx(RATE, rel=1e-4)
    assert found.mapping == shape.preset


def test_sniffing_proposes_a_mapping_for_an_unknown_shape(tmp_path: Path) -> None:
    messages = [
        (
            "x",
            encoded(
                {
                    "dev": {"id": 4, "stamped": iso(i)},
                    "body": {"acc": {"x": x, "y": y}},
                }
            ),
        )
        for i, (x, y) in enumerate(SAMPLES.tolist())
    ]
    found = sniffed(messages)
    (tmp_path / "m.toml").write_text(found.toml)
    reader = MappedReader(mapping_named(str(tmp_path / "m.toml")), (), FeedCounts())
    pieces = [piece for topic, payload in messages for piece in reader.read(payload, topic)]

    assert found.mapping == "proposed"
    assert found.toml == '[mapping]\nrows = ""\ntime = "dev.stamped"\nvalues = "body.acc"'
    np.testing.assert_array_equal(np.vstack([piece.samples for piece in pieces]), SAMPLES)


def test_a_feed_takes_a_mapping_by_its_address() -> None:
    address = parsed("mqtt://h/#?mapping=thingsboard")
    reader = SamplesReader(address, ("ax", "ay"), FeedCounts())
    payload = encoded({"ts": time_ms(0), "values": {"ax": 1.0, "ay": 2}})
    (piece,) = reader.read("v1/devices/me/telemetry", payload, retained=False)

    assert (piece.names, piece.start_ns) == (("ax", "ay"), time_ms(0) * 1_000_000)


def test_a_mapping_renames_scales_no_time_and_takes_only_what_it_is_told() -> None:
    table = {
        **{"time": "t", "time_unit": "s", "values": "d", "only": "a[0-9]", "rename": {"a1": "ax"}},
        **{"stamp": "last", "sampling_rate": 10.0},
    }
    reader = MappedReader(mapping_from_table(table, "test"), (), FeedCounts())
    (piece,) = reader.read(encoded({"t": 100, "d": {"a1": [1, None, 3], "b": [4, 5, 6]}}), "x")

    assert piece.names == ("ax",)
    assert piece.start_ns == 99_800_000_000
    np.testing.assert_array_equal(piece.samples, [[1], [np.nan], [3]])


def test_a_path_leads_to_keys_elements_and_all_elements() -> None:
    content = {"a": [{"n": 1}, {"n": 2}], "b": {"c": 3}}

    assert looked_up(content, "a[].n") == [1, 2]
    assert looked_up(content, "a[-1].n") == 2
    assert looked_up(content, "b.c") == 3
    assert looked_up(content, "") == content
    assert looked_up(content, "a.n") is None
    assert looked_up(content, "a[7]") is None


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"tyme": "t"}, "did you mean 'time'"),
        ({"time_unit": "h"}, "it is one of auto, s, ms, us, ns"),
        ({"decode": "xml"}, "it is one of json, sparkplug-b"),
        ({"only": "("}, "no regular expression"),
        ({"rename": {"a": 1}}, "it is a table like"),
        ({"time": 4}, "time is 4"),
    ],
)
def test_a_wrong_mapping_is_one_line(table: dict[str, object], says: str) -> None:
    with pytest.raises(FeedError, match=says.replace("(", r"\(")) as raised:
        mapping_from_table(table, "m.toml [mapping]")
    assert "\n" not in str(raised.value)


def test_a_mapping_that_is_neither_file_nor_preset_is_one_line() -> None:
    with pytest.raises(FeedError, match="neither a file nor one of csijson, campbell-geojson"):
        mapping_named("nothing")


@given(st.sampled_from(sorted(presets())), st.binary(max_size=200), st.text(max_size=30))
def test_no_message_ends_a_reader(name: str, payload: bytes, topic: str) -> None:
    reader = MappedReader(presets()[name], (), FeedCounts())
    for sent_to in (topic, "spBv1.0/a/DDATA/b"):
        with suppress(MessageError):
            list(reader.read(payload, sent_to))


KEYS = (
    *("time", "ts", "t", "values", "data", "head", "fields", "v", "n", "bt", "metrics", "Messages"),
    *("Payload", "SequenceNumber", "s", "properties", "observations"),
)
JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(
            st.sampled_from(KEYS),
            inner,
            max_size=4,
        )
    ),
    max_leaves=12,
)


@given(st.sampled_from(sorted(presets())), JSON)
def test_no_json_ends_a_reader_or_the_sniffing(name: str, content: object) -> None:
    reader = MappedReader(presets()[name], (), FeedCounts())
    with suppress(MessageError):
        list(reader.read(encoded(content), "a/b"))
    sniffed([("a/b", encoded(content))])


def read_by(preset: str, message: object, *, counts: FeedCounts | None = None) -> dict[str, float]:
    """The last value of each channel of one JSON message."""
    reader = MappedReader(mapping_named(preset), ("ax",), counts or FeedCounts())
    pieces = reader.read(encoded(message), "tower")
    return {name: float(v) for p in pieces for name, v in zip(p.names, p.samples[-1], strict=True)}


def test_a_base_value_of_senml_is_added_to_each_value_behind_it() -> None:
    """RFC 8428, section 4.1."""
    pack = [{"bn": "t/", "bt": 1.7e9, "bv": 2.0}, {"n": "ax", "v": 0.5}, {"n": "ay", "v": -1}]
    assert read_by("senml", pack) == {"t/ax": 2.5, "t/ay": 1.0}
    with pytest.raises(MessageError, match="'two' is no number"):
        read_by("senml", [{"bv": "two", "bt": 1.7e9, "n": "ax", "v": 0.5}])


@pytest.mark.parametrize("time", [{}, {"t": 0}, {"t": -5}, {"t": 12.5}, {"bt": 10, "t": 3}])
def test_a_time_of_senml_that_counts_from_now_is_refused(time: dict[str, float]) -> None:
    """RFC 8428, section 4.5.3; in 1970, where it would lie by its number, nothing was measured."""
    with pytest.raises(MessageError, match="counts from the message's arrival"):
        read_by("senml", [{"n": "ax", "v": 1.0} | time])


def test_a_base_of_another_sender_may_count_from_its_boot() -> None:
    """A unit whose clock was never set; the session warns of it (`clock-unset`)."""
    mapping = PayloadMapping(time=("t",), time_base=("boot",), time_unit="s", values=("v",))
    reader = MappedReader(mapping, ("ax",), FeedCounts())
    (piece,) = reader.read(encoded({"boot": 100, "t": 3, "v": {"ax": 1.0}}), "tower")
    assert piece.start_ns == 103 * NANOSECONDS


def test_the_rate_of_nested_lists_stands_in_the_row_the_message_or_its_header() -> None:
    values = {"ax": [1.0, 2.0]}
    for key in ("rate", "sampling_rate", "fs"):
        for where in ("header", "meta"):
            assert read_by("nested", {where: {"time": 1.7e9, key: 40}, "data": values})
        assert read_by("nested", {"time": 1.7e9, key: 40, "data": values})
        assert read_by("nested", {"samples": [{"time": 1.7e9, key: 40, "values": values}]})


def test_a_row_or_message_without_samples_is_not_missing_among_the_numbered() -> None:
    """A row of a logger whose sensor is unplugged; keep-alive messages; metadata has no number."""
    counts = FeedCounts()
    reader = MappedReader(mapping_named("csijson"), ("ax",), counts)
    rows = [{"time": iso(i, ""), "no": i, "vals": ["NAN" if i == 1 else 1.0]} for i in range(3)]
    table = {"head": {"fields": [{"name": "ax"}]}, "data": rows}
    assert len(list(reader.read(encoded(table), "t"))) == 2

    reader = MappedReader(mapping_named("opcua-pubsub-json"), ("ax",), counts)
    found: list[ChannelSamples] = []
    for i, content in enumerate([{"Payload": {"ax": 1.0}}, {"MessageType": "ua-keepalive"}] * 2):
        header = {"DataSetWriterId": 5, "SequenceNumber": i, "Timestamp": iso(i)}
        message = {"MessageType": "ua-data", "Messages": [header | content]}
        found += reader.read(encoded(message), "t")
    found += reader.read(encoded({"MessageType": "ua-metadata", "DataSetWriterId": 5}), "t")

    assert [piece.names for piece in found] == [("ax",), ("ax",)]
    assert counts == FeedCounts()


def test_numbers_written_as_text_are_samples_of_the_channels_that_a_layout_lists() -> None:
    counts = FeedCounts()
    reader = MappedReader(mapping_named("thingsboard"), ("ax", "ay"), counts)
    values = {"ax": "1.23", "ay": " -4e-1 ", "firmware": "1.23", "state": "on"}
    (piece,) = reader.read(encoded({"ts": str(time_ms(0)), "values": values}), "v1/telemetry")
    assert (piece.names, piece.samples.tolist()) == (("ax", "ay"), [[1.23, -0.4]])
    assert piece.start_ns == time_ms(0) * 1_000_000
    assert counts.malformed == 0

    list(reader.read(encoded({"ts": time_ms(1), "values": {"ax": "1,23", "ay": 0.1}}), "v1/t"))
    assert (counts.malformed, counts.refusal) == (1, "v1/t: ax is '1,23', which is no number")
    list(reader.read(encoded({"ts": time_ms(2), "values": {"ax": True, "ay": 0.1}}), "v1/t"))
    assert (counts.malformed, counts.refusal) == (2, "v1/t: ax is True, which is no number")
    list(reader.read(encoded({"ts": time_ms(3), "values": {"ax": "NAN", "ay": "", "b": "x"}}), "t"))
    list(reader.read(encoded({"ts": time_ms(4), "values": {"ax": "n/a", "ay": "--"}}), "t"))
    assert counts.malformed == 2  # no sample was taken


def as_text(content: object) -> object:
    """Every number written as text."""
    if isinstance(content, dict):
        return {key: as_text(each) for key, each in content.items()}
    if isinstance(content, list):
        return [as_text(each) for each in content]
    return str(content) if isinstance(content, int | float) else content


@pytest.mark.parametrize(
    "shape",
    [each for each in SHAPES if each.preset != "sparkplug-b"],
    ids=lambda shape: shape.preset,
)
def test_each_preset_reads_numbers_written_as_text(shape: Shape) -> None:
    messages = shape.messages()
    written = [(topic, encoded(as_text(json.loads(payload)))) for topic, payload in messages]
    counts = FeedCounts()
    found = samples_of(pieces_of(written, shape, counts))
    expected = samples_of(pieces_of(messages, shape, FeedCounts()))
    assert found == {key: each for key, each in expected.items() if key[0] in shape.names}
    assert (counts.malformed, counts.lost) == (0, 0)


FOUR = ("a.0", "a.1", "a.2", "a.3")


def array_message(index: int, content: object) -> bytes:
    """Of a digitiser that has four channels in one array and the time in ms."""
    return encoded({"ts": time_ms(index), "no": index, "a": content})


@pytest.mark.parametrize(
    ("table", "listed"),
    [
        ({"values": "a"}, FOUR),
        ({"values": "a", "names": list(FOUR)}, FOUR),
        ({"values": "a", "names": ["w", "x", "y", "z"]}, ("w", "x", "y", "z")),
        ({"values": "a", "names": ["a", "no", "y", "z"]}, ("a", "no", "y", "z")),
        ({"values": "a", "rename": {"a.0": "ax"}}, ("ax", *FOUR[1:])),
        ({"values": "a", "sampling_rate": 40.0}, FOUR),
        ({"values": ""}, FOUR),
    ],
)
def test_the_numbers_of_an_array_are_a_sample_of_as_many_channels(
    table: dict[str, object], listed: tuple[str, ...]
) -> None:
    mapping = mapping_from_table({"time": "ts"} | table, "test")
    reader = MappedReader(mapping, listed, FeedCounts())
    pieces = [*reader.read(array_message(0, [1, 2, 3, None]), "x")]
    pieces += [*reader.read(array_message(1, [5, 6, 7, 8]), "x")]
    found = samples_of(pieces)

    assert [found[name, time_ms(1) * 1_000_000] for name in listed] == [5, 6, 7, 8]
    assert found[listed[0], time_ms(0) * 1_000_000] == 1


def test_an_array_is_the_samples_of_the_channel_that_the_layout_calls_as_its_key() -> None:
    mapping = mapping_from_table({"time": "ts", "values": "a", "sampling_rate": 40.0}, "test")
    (piece,) = MappedReader(mapping, ("a",), FeedCounts()).read(array_message(0, [1, 2, 3]), "x")
    assert (piece.names, piece.samples.tolist()) == (("a",), [[1], [2], [3]])


@pytest.mark.parametrize("values", ["a", ""])
def test_the_lists_of_an_array_are_the_samples_of_as_many_channels(values: str) -> None:
    mapping = mapping_from_table({"time": "ts", "values": values, "sampling_rate": 40.0}, "test")
    reader = MappedReader(mapping, ("a.0", "a.1"), FeedCounts())
    pieces = list(reader.read(array_message(0, [[1, 2], [3, 4]]), "x"))
    assert pieces[-1].names == ("a.0", "a.1")
    assert pieces[-1].samples.tolist() == [[1, 3], [2, 4]]


def test_one_number_without_a_name_is_of_the_channel_that_its_path_is() -> None:
    reader = MappedReader(PayloadMapping(values=("a",)), ("a",), FeedCounts())
    (piece,) = reader.read(array_message(0, 1.5), "x")
    assert (piece.names, piece.samples.tolist()) == (("a",), [[1.5]])


@pytest.mark.parametrize(
    ("table", "says"),
    [
        ({"values": ["a.0", "a.1"]}, "no values at a.0 or a.1"),
        ({"values": "b"}, "no values at b"),
        ({"values": "a", "names": "head.names"}, "4 values and no names at head.names"),
        ({"values": "a", "names": ["w", "x"]}, "4 values and no names at w or x"),
        ({"values": ""}, "4 samples and no rate"),
    ],
)
def test_a_message_of_whose_values_the_mapping_reads_none_is_refused_with_the_reason(
    table: dict[str, object], says: str
) -> None:
    reader = MappedReader(mapping_from_table({"time": "ts"} | table, "test"), ("a",), FeedCounts())
    with pytest.raises(MessageError, match=says):
        list(reader.read(array_message(0, [1, 2, 3, 4]), "x"))


def test_a_rate_that_is_a_figure_is_refused_with_the_key_that_takes_one() -> None:
    with pytest.raises(FeedError, match=r"sampling_rate = 20, or \?rate=20 in the address"):
        mapping_from_table({"values": "a", "rate": 20}, "m.toml [mapping]")


def array_messages(content: object, **others: object) -> Messages:
    """Twenty of them."""
    return [
        ("x", encoded({"ts": time_ms(i), "no": i, "a": content} | others)) for i in range(0, 80, 4)
    ]


def read_as_proposed(messages: Messages, folder: Path, listed: tuple[str, ...]) -> FloatArray:
    """Samples of all messages by the mapping that sniffing proposes (n_samples, n_channels)."""
    (folder / "m.toml").write_text(sniffed(messages).toml)
    reader = MappedReader(mapping_named(str(folder / "m.toml")), listed, FeedCounts())
    pieces = [piece for topic, payload in messages for piece in reader.read(payload, topic)]
    assert {piece.names for piece in pieces} == {listed}
    return np.vstack([piece.samples for piece in pieces])


def test_sniffing_proposes_the_array_of_channels(tmp_path: Path) -> None:
    messages = array_messages([1, 2, 3, 4])
    found = sniffed(messages)

    assert found.toml.startswith('[mapping]\nrows = ""\ntime = "ts"\nvalues = "a"\n# a.0 … a.3: ')
    assert (found.channels, found.refused) == (dict.fromkeys(FOUR, 20), 0)
    assert found.sampling_rate == pytest.approx(RATE / 4)
    np.testing.assert_array_equal(read_as_proposed(messages, tmp_path, FOUR), [[1, 2, 3, 4]] * 20)


@pytest.mark.parametrize(
    ("content", "names"), [([[1, 2], [3, 4]], ("a.0", "a.1")), ({"x": [1, 2], "y": [3, 4]}, "xy")]
)
def test_sniffing_proposes_lists_of_samples_with_the_key_of_their_rate(
    content: object, names: Sequence[str], tmp_path: Path
) -> None:
    messages = array_messages(content, fs=40)
    found = sniffed(messages)

    assert found.toml.endswith('values = "a"\nrate = "fs"')
    assert (found.channels, found.refused) == (dict.fromkeys(names, 40), 0)
    assert found.sampling_rate == RATE
    samples = read_as_proposed(messages, tmp_path, tuple(names))
    np.testing.assert_array_equal(samples, [[1, 3], [2, 4]] * 20)


@pytest.mark.parametrize("content", [[[1, 2]] * 4, {"x": [1, 2], "y": [3, 4]}])
def test_sniffing_proposes_nothing_for_samples_without_a_rate_and_names_the_reason(
    content: object,
) -> None:
    found = sniffed(array_messages(content))

    assert (found.mapping, found.toml, found.refused) == ("", "", 20)
    assert "lists of 2 samples, and no message has their rate (by the times 20 Hz)" in found.reason
    assert 'values = "a" and sampling_rate = HZ read them' in found.reason


@pytest.mark.parametrize("topic", ["x", "tower/x"])
def test_sniffing_sees_numbers_that_are_all_text(topic: str, tmp_path: Path) -> None:
    values = {"ax": "0.0125", "ay": "-1.5e-3", "state": "ok", "none": ""}
    messages = [(topic, encoded({"ts": time_ms(i), "v": values})) for i in range(0, 80, 4)]
    found = sniffed(messages)

    assert (found.is_text, found.channels, found.refused) == (True, {"ax": 20, "ay": 20}, 0)
    assert found.sampling_rate == pytest.approx(RATE / 4)
    samples = read_as_proposed(messages, tmp_path, ("ax", "ay"))
    np.testing.assert_array_equal(samples, [[0.0125, -0.0015]] * 20)


def test_text_without_any_number_is_no_text_of_numbers() -> None:
    found = sniffed([("x", encoded({"ts": time_ms(i), "v": {"a": "open"}})) for i in range(20)])
    assert (found.mapping, found.is_text) == ("", False)


def test_sniffing_names_messages_without_a_time_as_the_reason() -> None:
    found = sniffed([("x", encoded({"no": i, "a": [1, 2]})) for i in range(20)])
    assert (found.mapping, found.refused) == ("", 20)
    assert found.reason.startswith("no message has a time")


def test_a_name_that_the_mapping_lists_is_the_channels_unless_its_path_leads_to_one() -> None:
    mapping = mapping_from_table({"time": "ts", "values": "a", "names": "n"}, "test")
    reader = MappedReader(mapping, ("n", "ax"), FeedCounts())
    names = [
        next(reader.read(encoded({"ts": time_ms(0), "a": 1.5} | more), "x")).names
        for more in ({"n": "ax"}, {"n": 7}, {})
    ]
    assert names == [("ax",), ("n",), ("n",)]
