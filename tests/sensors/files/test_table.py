"""The rate that time stamps have: rounded, jittered, with rows missing."""

import numpy as np
import pytest

from sensors.files.table import rate_of_stamps

N = 20_000


def kept(share: float) -> np.ndarray:
    """Which rows are there, where a share is missing here and there."""
    return np.random.default_rng(6).random(N) >= share


@pytest.mark.parametrize("share", [0.001, 0.01, 0.05, 0.1])
@pytest.mark.parametrize("rate", [10.0, 48.83, 50.0, 99.7, 512.0])
@pytest.mark.parametrize("digits", [3, 6])
def test_missing_rows_do_not_slow_the_rate(rate: float, digits: int, share: float) -> None:
    """The mean step of 50 Hz with one row in a hundred missing is that of 49.5 Hz."""
    times = np.round(np.arange(N) / rate, digits)[kept(share)]
    assert rate_of_stamps(times) == pytest.approx(rate, rel=2e-4)


@pytest.mark.parametrize("rate", [300.0, 512.0, 600.0, 700.0, 900.0, 999.0])
def test_milliseconds_of_a_sample_or_so_show_no_missing_rows(rate: float) -> None:
    times = np.round(np.arange(N) / rate, 3)
    assert rate_of_stamps(times) == pytest.approx(rate, rel=1e-4)


@pytest.mark.parametrize("jitter", [0.1, 0.3])
@pytest.mark.parametrize("share", [0.0, 0.01, 0.1])
def test_stamps_that_jitter_have_the_rate_of_the_clock(jitter: float, share: float) -> None:
    times = (np.arange(N) + np.random.default_rng(7).uniform(-jitter, jitter, N)) / 50.0
    assert rate_of_stamps(times[kept(share)]) == pytest.approx(50.0, rel=1e-4)


def test_a_gap_is_no_step() -> None:
    times = np.arange(N) / 50.0 + np.where(np.arange(N) > N // 3, 100.0, 0.0)
    assert rate_of_stamps(times) == pytest.approx(50.0, rel=1e-9)
