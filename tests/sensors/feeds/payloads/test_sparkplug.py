"""Numbers of Sparkplug B payloads, written here field by field."""

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.mapped_reader import MappedReader
from sensors.feeds.payloads.mapping import mapping_named
from sensors.feeds.payloads.sparkplug import RebirthRequests, SparkplugDecoder
from sensors.feeds.protocol import FeedCounts
from tests.sensors.feeds.payloads.shapes import field, sparkplug_metric, time_ms

INT8, INT16, INT32, INT64, UINT32 = 1, 2, 3, 4, 7  # datatypes


@pytest.mark.parametrize(
    ("datatype", "place", "bits"),
    [(INT8, 10, 32), (INT16, 10, 32), (INT32, 10, 32), (INT64, 11, 64)],
)
def test_integers_below_zero_come_as_the_complement_of_two(
    datatype: int, place: int, bits: int
) -> None:
    """An unsigned field carries them; what they are stands in the datatype."""
    for number in (-100, -1, 0, 100):
        written = field(1, b"ax") + field(4, datatype) + field(place, number % 2**bits)
        (metric,) = SparkplugDecoder().decoded("spBv1.0/g/NDATA/n", field(2, written))["metrics"]
        assert metric == {"name": "ax", "value": number}


@pytest.mark.parametrize(("place", "length"), [(12, 3), (12, 8), (13, 4), (13, 0)])
def test_a_floating_point_number_of_another_length_is_refused(place: int, length: int) -> None:
    written = field(1, b"ax") + field(4, 9) + field(place, bytes(length))
    with pytest.raises(MessageError, match=f"floating-point number of {length} bytes"):
        SparkplugDecoder().decoded("spBv1.0/g/NDATA/n", field(2, written))


_CONTENT = st.binary(max_size=9) | st.integers(0, 2**64 - 1)
_FIELDS = st.lists(st.tuples(st.integers(1, 17), _CONTENT), max_size=6)


@settings(max_examples=200)
@given(metrics=st.lists(_FIELDS, max_size=3), others=_FIELDS)
def test_no_payload_does_more_than_be_refused(
    metrics: list[list[tuple[int, int | bytes]]], others: list[tuple[int, int | bytes]]
) -> None:
    parts = [field(2, b"".join(field(*each) for each in metric)) for metric in metrics]
    payload = b"".join([*parts, *(field(*each) for each in others)])
    reader = MappedReader(mapping_named("sparkplug-b"), ("ax",), FeedCounts())
    try:
        for piece in reader.read(payload, "spBv1.0/g/NDATA/n"):
            assert piece.samples.ndim == 2
    except MessageError as error:
        assert "\n" not in str(error)  # noqa: PT017  # either is right


def test_large_numbers_without_a_sign_stay_large() -> None:
    written = field(1, b"ax") + field(4, UINT32) + field(10, 2**32 - 1)
    (metric,) = SparkplugDecoder().decoded("spBv1.0/g/NDATA/n", field(2, written))["metrics"]
    assert metric["value"] == 2**32 - 1


def test_an_alias_whose_birth_certificate_did_not_come_is_refused_with_the_reason() -> None:
    """Brokers keep no birth certificate: a feed that starts after the node has no names."""
    data = field(1, time_ms(1)) + sparkplug_metric(1.0, time_ms(1), alias=4)
    with pytest.raises(MessageError, match=r"alias 4 has no name.*Rebirth"):
        SparkplugDecoder().decoded("spBv1.0/g/DDATA/n/d", data)


def test_messages_of_states_and_a_devices_death_are_not_missing_among_the_numbers() -> None:
    counts = FeedCounts()
    reader = MappedReader(mapping_named("sparkplug-b"), ("ax",), counts)
    state = field(2, field(1, b"door") + field(4, 11) + field(14, 1))
    contents = [
        ("NDATA/n", sparkplug_metric(1.0, time_ms(0), name="ax")),
        ("DDATA/n/d", state),
        ("DDEATH/n/d", b""),
        ("NDATA/n", sparkplug_metric(2.0, time_ms(3), name="ax")),
    ]
    found = [
        piece
        for i, (topic, content) in enumerate(contents)
        for piece in reader.read(
            field(1, time_ms(i)) + content + field(3, 254 + i & 255), f"spBv1.0/g/{topic}"
        )
    ]

    assert len(found) == 2
    assert counts == FeedCounts()


class Node:
    """An edge node that numbers its messages, and a feed that reads them."""

    def __init__(self) -> None:
        self.counts = FeedCounts()
        self._reader = MappedReader(mapping_named("sparkplug-b"), ("ax",), self.counts)
        self._sent = 0

    def message(self, kind: str, sequence: int | None) -> tuple[bytes, str]:
        at = time_ms(self._sent)
        self._sent += 1
        number = b"" if sequence is None else field(3, sequence % 256)
        content = field(1, at) + sparkplug_metric(1.0, at, name="ax") + number
        return content, f"spBv1.0/g/{kind}/n"

    def read(self, payload: bytes, topic: str) -> int:
        """Pieces that a message gives."""
        return len(list(self._reader.read(payload, topic)))

    def data(self, first: int, end: int) -> None:
        for sequence in range(first, end):
            assert self.read(*self.message("NDATA", sequence)) == 1


@pytest.mark.parametrize("before", [1, 100, 201, 300, 1000])
@pytest.mark.parametrize("number", [0, None])
def test_a_birth_certificate_begins_a_sequence_of_its_own(before: int, number: int | None) -> None:
    node = Node()
    for last in (before, 50, 400):
        node.read(*node.message("NBIRTH", number))
        node.data(1, last)
    assert (node.counts.lost, node.counts.duplicate, node.counts.late) == (0, 0, 0)
    node.data(403, 410)
    assert node.counts.lost == 3


def test_what_is_missing_behind_a_birth_certificate_is_counted() -> None:
    node = Node()
    node.data(7, 90)  # the feed starts after the node
    node.read(*node.message("NBIRTH", 0))
    node.data(3, 90)
    assert node.counts.lost == 2


def test_a_birth_certificate_that_comes_again_begins_nothing() -> None:
    node = Node()
    first, second = node.message("NBIRTH", 0), node.message("NBIRTH", 0)
    node.read(*first)
    node.data(1, 200)
    node.read(*second)
    node.data(1, 200)
    assert node.read(*second) == 0
    assert node.read(*first) == 0
    node.data(200, 300)
    assert (node.counts.lost, node.counts.duplicate, node.counts.late) == (0, 1, 1)


class Clock:
    """Seconds that a test sets."""

    now = 0.0

    def __call__(self) -> float:
        return self.now


def test_a_node_whose_birth_certificate_did_not_come_is_asked_for_it_now_and_then() -> None:
    clock = Clock()
    rebirths = RebirthRequests(clock)
    decoder = SparkplugDecoder(rebirths)
    data = field(1, time_ms(1)) + sparkplug_metric(1.0, time_ms(1), alias=4)
    birth = field(1, time_ms(1)) + sparkplug_metric(1.0, time_ms(1), name="ax", alias=4)

    def asked_during(seconds: int, node: str = "n") -> list[int]:
        found = []
        begin = int(clock.now)
        for second in range(begin, begin + seconds):
            clock.now = float(second)
            with pytest.raises(MessageError, match="the node is asked for another"):
                decoder.decoded(f"spBv1.0/g/DDATA/{node}/d", data)
            topics = [topic for topic, _ in rebirths.taken()]
            assert topics in ([], [f"spBv1.0/g/NCMD/{node}"])
            found += [second - begin] * len(topics)
        return found

    assert asked_during(1000) == [0, 60, 180, 420, 900]
    assert asked_during(10, "other") == [0]
    decoder.decoded("spBv1.0/g/DBIRTH/n/d", birth)
    assert len(decoder.decoded("spBv1.0/g/DDATA/n/d", data)["metrics"]) == 1
    again = SparkplugDecoder(rebirths)  # as after the node's names are lost
    with pytest.raises(MessageError):
        again.decoded("spBv1.0/g/DDATA/n/d", data)
    assert len(rebirths.taken()) == 1


def test_a_request_is_a_payload_of_its_own_kind() -> None:
    """Node Control/Rebirth = true, a Boolean (datatype 11), with the stamps that are wanted."""
    rebirths = RebirthRequests()
    rebirths.want("spBv1.0/g/NDATA/n")
    ((_, payload),) = rebirths.taken()
    stamp = payload[1:7]
    metric = field(1, b"Node Control/Rebirth") + b"\x18" + stamp + field(4, 11) + field(14, 1)
    assert payload == b"\x08" + stamp + field(2, metric)
    number = sum((byte & 127) << 7 * at for at, byte in enumerate(stamp))
    assert number > time_ms(0)


def test_a_whole_number_has_the_type_that_its_birth_certificate_stated() -> None:
    decoder = SparkplugDecoder()
    value = field(10, 2**32 - 5)
    with pytest.raises(MessageError, match="ax is a whole number or an array of unknown type"):
        decoder.decoded("spBv1.0/g/NDATA/n", field(2, field(1, b"ax") + value))
    born = field(2, field(1, b"ax") + field(2, 1) + field(4, INT32) + value)
    decoder.decoded("spBv1.0/g/NBIRTH/n", born)
    for named in (field(1, b"ax"), field(2, 1)):
        (metric,) = decoder.decoded("spBv1.0/g/NDATA/n", field(2, named + value))["metrics"]
        assert metric == {"name": "ax", "value": -5}
