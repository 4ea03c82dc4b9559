"""A signal is the same between its samples."""

import numpy as np
import pytest

from sensors.acquisition.resampling import HALF_LENGTH, interpolated


@pytest.mark.parametrize("frequency", [0.01, 0.2, 0.44])
def test_a_sine_is_read_between_its_samples(frequency: float) -> None:
    n = np.arange(400.0)
    positions = n[HALF_LENGTH:-HALF_LENGTH] + 0.37
    read = interpolated(np.sin(2 * np.pi * frequency * n)[:, None], positions)[:, 0]
    np.testing.assert_allclose(read, np.sin(2 * np.pi * frequency * positions), atol=1e-3)


def test_positions_on_samples_give_them_back_to_the_bit() -> None:
    samples = np.random.default_rng(2).standard_normal((50, 3))
    np.testing.assert_array_equal(interpolated(samples, np.arange(5.0, 40.0)), samples[5:40])


def test_what_a_lower_rate_cannot_hold_does_not_fold_back() -> None:
    n = np.arange(2000.0)
    positions = np.arange(200.0, 1800.0, 2.5)  # 0.4 of the rate
    high = interpolated(np.sin(2 * np.pi * 0.3 * n)[:, None], positions, band=0.4)
    low = interpolated(np.sin(2 * np.pi * 0.15 * n)[:, None], positions, band=0.4)
    assert np.abs(high).max() < 1e-3
    np.testing.assert_allclose(low[:, 0], np.sin(2 * np.pi * 0.15 * positions), atol=2e-3)


def test_a_higher_rate_gains_nothing_beyond_what_the_samples_hold() -> None:
    samples = np.random.default_rng(3).standard_normal((100, 2))
    positions = np.arange(30.0, 70.0, 0.3)
    faster = interpolated(samples, positions, band=10 / 3)
    np.testing.assert_array_equal(faster, interpolated(samples, positions))
