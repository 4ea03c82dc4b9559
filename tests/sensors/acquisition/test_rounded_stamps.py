"""Stamps of few digits are put on the clock that they were rounded from, others left."""

import numpy as np
import pytest

from sensors.acquisition.rounded_stamps import without_rounding

N = 20_000
RNG = np.random.default_rng(8)


def largest_unevenness(times: np.ndarray, rate: float) -> float:
    """Of a step, in steps."""
    return float(np.abs(np.diff(times) * rate - 1).max())


@pytest.mark.parametrize(
    ("rate", "digits"), [(48.83, 2), (33.3, 2), (99.7, 3), (512.0, 3), (700.0, 3), (25.6, 2)]
)
@pytest.mark.parametrize("truncated", [False, True])
def test_rounded_stamps_are_even_again(rate: float, digits: int, truncated: bool) -> None:
    times = np.arange(N) / rate
    scaled = times * 10.0**digits
    rounded = (np.floor(scaled + 1e-6) if truncated else np.round(scaled)) / 10.0**digits
    assert largest_unevenness(rounded, rate) > 0.01
    found = without_rounding(rounded, rate)
    assert largest_unevenness(found, rate) < 0.01
    assert np.abs(found - times).max() < 10.0**-digits


def test_rows_that_are_missing_stay_missing() -> None:
    there = RNG.random(N) >= 0.01
    times = (np.arange(N) / 48.83)[there]
    found = without_rounding(np.round(times, 2), 48.83)
    np.testing.assert_allclose(np.diff(found) * 48.83, np.diff(times) * 48.83, atol=0.01)


def test_a_clock_that_drifts_is_followed() -> None:
    times = np.arange(N) / 48.83
    times += 0.05 * np.sin(2 * np.pi * times / 3000)
    found = without_rounding(np.round(times, 2), 48.83)
    assert largest_unevenness(found, 48.83) < 0.01
    assert np.ptp(found - times) < 0.01


@pytest.mark.parametrize(
    ("times", "rate"),
    [
        (np.arange(N) / 50.0, 50.0),
        (np.round(np.arange(N) / 48.83, 6), 48.83),  # finer than it matters
        (np.round((np.arange(N) + RNG.uniform(-0.4, 0.4, N)) / 50.0, 4), 50.0),  # jitter
        (np.round((np.arange(N) + RNG.uniform(-0.49, 0.49, N)) / 12.0, 2), 12.0),
        (np.round(np.arange(N) / 700.0, 2), 700.0),  # not rising
        (np.arange(N) / 50.0 + np.where(np.arange(N) > 9000, 0.013, 0.0), 50.0),  # clock set
        (np.round(np.arange(500) / 48.83, 2), 48.83),  # too few to tell
    ],
)
def test_other_stamps_are_left(times: np.ndarray, rate: float) -> None:
    assert without_rounding(times, rate) is times
