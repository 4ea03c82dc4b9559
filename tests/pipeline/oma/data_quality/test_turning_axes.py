"""A nacelle that yaws turns the axes of the modes; loads alone do not."""

import numpy as np
import pytest

from pipeline.oma.data_quality.input_checks import NON_STATIONARY, check_stationarity
from pipeline.oma.data_quality.transients import SURELY_TURNED, turning_axes
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import bending_pair
from tests.benchmarks.stationarity import RATE, record


def turned(seed: int, degrees: FloatArray) -> FloatArray:
    """A parked tower's channels, two at a height, about its axis by an angle at each sample."""
    samples = bending_pair(seed).samples
    angle = np.radians(np.interp(np.linspace(0, 1, len(samples)), *degrees))[:, None]
    along, across = samples[:, 0::2], samples[:, 1::2]
    result = np.empty_like(samples)
    result[:, 0::2] = np.cos(angle) * along - np.sin(angle) * across
    result[:, 1::2] = np.sin(angle) * along + np.cos(angle) * across
    return result - result.mean(axis=0)


@pytest.mark.parametrize("seed", [70_401, 70_402, 70_403])
@pytest.mark.parametrize(
    "degrees",
    [np.array([[0.4, 0.5], [0.0, 40.0]]), np.array([[0.0, 1.0], [0.0, 90.0]])],
    ids=["within", "throughout"],
)
def test_a_yaw_within_the_window_is_told_of(seed: int, degrees: FloatArray) -> None:
    (finding,) = check_stationarity(turned(seed, degrees), 20.0)
    assert finding.code == NON_STATIONARY
    assert "other axes" in finding.text


@pytest.mark.parametrize("angle", [0.0, 37.0])
def test_a_nacelle_that_stands_anywhere_is_not(angle: float) -> None:
    for seed in (70_401, 70_402, 70_403):
        found = turning_axes(turned(seed, np.array([[0.0, 1.0], [angle, angle]])), 20.0)
        assert found is not None
        assert not found.is_sure


def test_gusts_turn_no_axes() -> None:
    least = []
    for seed in range(90_001, 90_021):
        samples = record(seed)
        found = turning_axes(samples - samples.mean(axis=0), RATE)
        assert found is not None
        least.append(found.log_chance)
    assert min(least) > 0.6 * SURELY_TURNED


def test_channels_that_move_alike_and_short_windows_have_no_axes() -> None:
    one = bending_pair(70_404).samples[:, :1]
    assert turning_axes(one - one.mean(), 20.0) is None
    twice = np.column_stack([one, 2 * one])
    assert turning_axes(twice - twice.mean(axis=0), 20.0) is None
    assert turning_axes(bending_pair(70_404).samples[:7], 20.0) is None
