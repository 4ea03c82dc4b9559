"""Numbers of Sparkplug B payloads, written here field by field."""

import pytest

from sensors.feeds.payloads.json_samples import MessageError
from sensors.feeds.payloads.mapped_reader import MappedReader
from sensors.feeds.payloads.mapping import mapping_named
from sensors.feeds.payloads.sparkplug import SparkplugDecoder
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
