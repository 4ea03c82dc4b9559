"""When each row of exported samples was taken."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.export.samples import samples_schema, samples_table
from tests.pipeline.example_messages import block


@pytest.mark.parametrize("rate", [8.0, 40.0, 100.0])
def test_a_row_of_a_csv_has_the_decimals_of_its_instant_and_no_more(rate: float) -> None:
    """Seconds since 1970 with milliseconds, as a person would write them."""
    first = replace(block(0), sampling_rate=rate)
    start = first.start_ns // 10**9
    for second in range(0, 5000, 7):
        each = replace(first, start_ns=(start + second) * 10**9)
        times = samples_table(each, samples_schema(each, None, "csv")).column(0).to_pylist()
        ticks = np.arange(len(times)) * round(1000 / rate)
        written = [f"{start + second + n // 1000}.{n % 1000:03d}" for n in ticks.tolist()]
        assert [f"{time:.6f}" for time in times] == [f"{text}000" for text in written]
        assert times == [float(text) for text in written]
