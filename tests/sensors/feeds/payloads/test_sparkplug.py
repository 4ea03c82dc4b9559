"""Numbers of Sparkplug B payloads, written here field by field."""

import pytest

from sensors.feeds.payloads.sparkplug import SparkplugDecoder
from tests.sensors.feeds.payloads.shapes import field

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
