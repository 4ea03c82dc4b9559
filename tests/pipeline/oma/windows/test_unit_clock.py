"""A unit's clock is judged by its stamps against its sample count."""

import numpy as np
import pytest

from pipeline.oma.windows.unit_clock import ClockFit, fit_clock
from sensors.acquisition.blocks import NANOSECONDS

RATE = 40.0  # [Hz]


def stamps(drift: float, jitter: float, *, late: int = 0) -> list[tuple[int, int]]:
    """Of ten minutes of blocks of a second; `late` of them come a second late."""
    generator = np.random.default_rng(3)
    seconds = np.arange(600) * (1 + drift) + jitter * generator.standard_normal(600)
    seconds[generator.permutation(600)[:late]] += 1.0
    return [(round(40 * k), round(s * NANOSECONDS)) for k, s in enumerate(seconds)]


def test_a_drift_is_one_where_it_is_four_times_its_standard_deviation() -> None:
    limit = 1e-5
    assert ClockFit(5e-5, drift_std=1.0e-5, scatter=0.0).exceeds(limit)
    assert not ClockFit(5e-5, drift_std=1.5e-5, scatter=0.0).exceeds(limit)
    assert not ClockFit(0.9e-5, drift_std=1e-9, scatter=0.0).exceeds(limit)


@pytest.mark.parametrize("drift", [0.0, 5e-5, -2e-4])
def test_a_few_stamps_that_are_far_off_do_not_turn_the_line(drift: float) -> None:
    found = fit_clock(stamps(drift, 1e-5, late=20), RATE)
    assert found is not None
    assert found.drift == pytest.approx(drift, abs=1e-7)
    assert found.drift_std < 1e-7
