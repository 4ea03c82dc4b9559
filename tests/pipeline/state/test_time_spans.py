"""Time that spans cover together."""

import numpy as np
import pytest

from pipeline.state.time_spans import covered


@pytest.mark.parametrize(
    ("spans", "time"),
    [
        ([], 0),
        ([(0, 60), (0, 60)], 60),
        ([(100, 160), (0, 60)], 120),
        ([(0, 60), (30, 90), (90, 100)], 100),
        ([(0, 100), (20, 30), (40, 120)], 120),
        ([(5, 5), (7, 6)], 0),
        ([(-20, -10), (-15, 5)], 25),
    ],
)
def test_a_moment_of_several_spans_counts_once(spans: list[tuple[int, int]], time: int) -> None:
    assert covered(spans) == time


def test_it_is_the_number_of_moments_that_lie_in_any_span() -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        begins, lengths = rng.integers(0, 60, 8), rng.integers(0, 12, 8)
        spans = [(int(b), int(b + n)) for b, n in zip(begins, lengths, strict=True)]
        assert covered(spans) == len({moment for span in spans for moment in range(*span)})
