"""Dates and times as loggers and spreadsheets write them."""

import numpy as np
import pyarrow as pa
import pytest

from sensors.files.text.dates import DateStyle


@pytest.mark.parametrize(
    ("written", "hour"),
    [("12:30:00 AM", 0.5), ("1:30:00 AM", 1.5), ("12:30:00 PM", 12.5), ("1:30:00 PM", 13.5)],
)
def test_half_past_midnight_is_written_as_half_past_twelve(written: str, hour: float) -> None:
    texts = [f"5/17/2024 {written}"]
    found = DateStyle.of(texts).nanoseconds(pa.array(texts))
    midnight = np.datetime64("2024-05-17", "ns").astype(np.int64)
    assert (found[0] - midnight) / 3.6e12 == hour
