"""A block and its parts are the same samples at the same times."""

from dataclasses import replace

import numpy as np
import pytest

from sensors.acquisition.blocks import parts_of
from tests.pipeline.example_messages import block


@pytest.mark.parametrize("most", [1, 7, 10, 1000])
def test_parts_follow_each_other_as_their_samples_do(most: int) -> None:
    samples = np.arange(100.0, dtype=np.float32).reshape(50, 2)
    whole = replace(block(3), samples=samples, sampling_rate=30.0, first_sample=150)
    parts = list(parts_of(whole, most))
    np.testing.assert_array_equal(np.concatenate([each.samples for each in parts]), samples)
    assert max(len(each.samples) for each in parts) <= most
    assert {each.sequence for each in parts} == {whole.sequence}
    for each in parts:
        since = each.first_sample - whole.first_sample
        assert each.start_ns == whole.start_ns + round(since / 30.0 * 1e9)
    assert parts[-1].first_sample + len(parts[-1].samples) == 200
    assert parts[-1].end_ns == pytest.approx(whole.end_ns, abs=1)
