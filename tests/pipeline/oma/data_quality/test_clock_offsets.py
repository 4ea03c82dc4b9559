"""How late a unit's stamps are, by the phases of the modes that both units see."""

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.data_quality.clock_offsets import (
    UnitOffset,
    _fitted,
    _lag_covariances,
    unit_offset,
)
from tests.benchmarks.close_modes import ambient


def test_an_offset_lies_as_far_from_the_truth_as_it_says() -> None:
    """Twelve modes to 8 Hz, whose phases scatter by 20 mrad, in sixty windows: an rms of .68, for
    the step of the coarse grid counts as scatter."""
    omega = 2 * np.pi * np.linspace(0.5, 8.0, 12)
    generator = np.random.default_rng(4)
    apart = []
    for offset in generator.uniform(-10e-3, 10e-3, 60):
        found = _fitted(omega, omega * offset + 0.02 * generator.standard_normal(12))
        assert found is not None
        apart.append((found.seconds - offset) / found.std)
    assert 0.5 < np.sqrt(np.mean(np.square(apart))) < 1.3


@pytest.mark.parametrize("every", [2, 3, 5])
def test_a_shape_that_is_turned_round_is_no_delay(every: int) -> None:
    """The sign of a mode's motion in one unit against the other is not known."""
    omega = 2 * np.pi * np.linspace(0.5, 8.0, 12)
    phases = omega * 4e-3
    phases[::every] += np.pi
    found = _fitted(omega, phases)
    assert found is not None
    assert found.seconds == pytest.approx(4e-3, abs=1e-5)


@pytest.mark.parametrize(
    ("seconds", "std", "limit", "exceeds"),
    [
        (0.006, 0.001, 0.005, True),
        (-0.006, 0.001, 0.005, True),
        (0.005, 0.001, 0.005, False),
        (0.006, 0.00201, 0.005, False),  # less than three of its standard deviations
        (0.006, 0.00199, 0.005, True),
    ],
)
def test_an_offset_is_beyond_a_limit_only_where_it_is_no_chance(
    seconds: float, std: float, limit: float, exceeds: bool
) -> None:
    assert UnitOffset(seconds, std).exceeds(limit) is exceeds


def test_lag_covariances_are_the_sums_that_define_them() -> None:
    samples = np.random.default_rng(4).normal(size=(50, 2))
    found = _lag_covariances(samples, 3)
    assert found.shape == (4, 2, 2)
    for k in range(4):
        assert found[k] == pytest.approx(samples[k:].T @ samples[: 50 - k] / 50)


FREQUENCIES = np.array([0.4, 0.9, 1.7, 2.9, 4.1])
SHAPES = np.array(
    [[1.0, 0.5, 0.7, 0.3], [0.6, -1.0, 0.5, -0.8], [-0.5, 0.9, 1.0, 0.4], [0.8, 0.7, -0.9, 1.0],
     [0.7, -0.6, 0.8, -1.0]]
)  # fmt: skip


@pytest.mark.parametrize("late", [0, 1, -1])
def test_a_unit_whose_stamps_are_a_sample_late_is_late_by_its_interval(late: int) -> None:
    """Ten minutes at 50 Hz of five modes; the other unit's two channels are shifted."""
    rate = 50.0
    damping, noise = np.full(5, 0.01), 0.02
    samples = ambient(
        FREQUENCIES, damping, SHAPES, rate, np.ones(5), noise, np.random.default_rng(8)
    )
    shifted = samples.copy()
    shifted[:, 2:] = np.roll(samples[:, 2:], late, axis=0)  # under a stamp later than its own
    modes = [
        Mode("", f, 1e-3, 0.01, 1e-3, shape, np.zeros((6, 1)), 1)
        for f, shape in zip(FREQUENCIES, SHAPES, strict=True)
    ]
    found = unit_offset(shifted[10:-10], rate, modes, [0, 1], [2, 3])
    assert found is not None
    assert found.seconds == pytest.approx(late / rate, abs=0.002)
    assert found.exceeds(5e-3) is (late != 0)
    assert unit_offset(shifted, rate, modes[:3], [0, 1], [2, 3]) is None


def test_four_modes_are_enough_for_an_offset() -> None:
    samples = ambient(
        FREQUENCIES[:4], np.full(4, 0.01), SHAPES[:4], 50.0, np.ones(4), 0.02,
        np.random.default_rng(8),
    )  # fmt: skip
    modes = [
        Mode("", f, 1e-3, 0.01, 1e-3, shape, np.zeros((6, 1)), 1)
        for f, shape in zip(FREQUENCIES[:4], SHAPES[:4], strict=True)
    ]
    found = unit_offset(samples, 50.0, modes, [0, 1], [2, 3])
    assert found is not None
    assert found.seconds == pytest.approx(0.0, abs=0.002)
