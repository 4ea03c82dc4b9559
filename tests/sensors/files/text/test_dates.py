"""Dates and times as loggers and spreadsheets write them."""

import numpy as np
import pyarrow as pa
import pytest

from sensors.files.text.dates import DateError, DateStyle


@pytest.mark.parametrize(
    ("written", "hour"),
    [("12:30:00 AM", 0.5), ("1:30:00 AM", 1.5), ("12:30:00 PM", 12.5), ("1:30:00 PM", 13.5)],
)
def test_half_past_midnight_is_written_as_half_past_twelve(written: str, hour: float) -> None:
    texts = [f"5/17/2024 {written}"]
    found = DateStyle.of(texts).nanoseconds(pa.array(texts))
    midnight = np.datetime64("2024-05-17", "ns").astype(np.int64)
    assert (found[0] - midnight) / 3.6e12 == hour


@pytest.mark.parametrize(
    ("days", "order"),
    [
        (["12/13/2024"], "mdy"),
        (["13/12/2024"], "dmy"),
        (["12/12/2024", "12/13/2024"], "mdy"),
        (["12/12/2024", "13/12/2024"], "dmy"),
    ],
)
def test_a_thirteenth_shows_which_number_is_the_day(days: list[str], order: str) -> None:
    assert DateStyle.of([f"{day} 10:00:00" for day in days]).order == order


def test_a_twelfth_does_not_show_whether_it_is_the_day() -> None:
    with pytest.raises(DateError, match="is the day or the month first"):
        DateStyle.of(["12/12/2024 10:00:00", "11/12/2024 10:00:00"])
