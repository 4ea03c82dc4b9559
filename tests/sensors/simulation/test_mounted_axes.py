"""Axes as they were mounted while the nacelle yaws, and what instruments add to a reading."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from sensors.acquisition.layout import biaxial_layout
from sensors.simulation.instruments import InstrumentError, Instruments, MountedAxes

LAYOUT = biaxial_layout("two", turbine="t", unit="u", elevations=(41.0, 145.0))
ANGLES = st.floats(-180.0, 180.0)


def in_nacelle(along: float, across: float) -> np.ndarray:
    """One sample of the same motion at every channel's place, (1, 2 n_channels)."""
    return np.repeat([[along, across]], 4, axis=0).T.reshape(1, -1)


def test_without_yaw_and_error_the_axes_read_fore_aft_and_side_side() -> None:
    readings = MountedAxes(LAYOUT).readings(in_nacelle(2.0, -3.0), np.zeros(1))
    np.testing.assert_allclose(readings, [[2.0, 2.0, -3.0, -3.0]], atol=1e-12)


@given(yaw=ANGLES, direction=ANGLES)
def test_a_yawing_nacelle_takes_its_motion_round_the_tower(yaw: float, direction: float) -> None:
    """A motion in a direction of the nacelle has, in the tower's axes, that direction plus yaw."""
    motion = in_nacelle(np.cos(np.radians(direction)), np.sin(np.radians(direction)))
    readings = MountedAxes(LAYOUT).readings(motion, np.array([yaw]))[0]
    angle = np.radians(direction + yaw)
    np.testing.assert_allclose(readings[:2], np.cos(angle), atol=1e-9)
    np.testing.assert_allclose(readings[2:], np.sin(angle), atol=1e-9)


def test_an_axis_off_by_a_degree_reads_a_sixtieth_of_the_motion_across_it() -> None:
    axes = MountedAxes(LAYOUT, (1.0, 0.0, 0.0, -1.0))
    readings = axes.readings(in_nacelle(0.0, 1.0), np.zeros(1))[0]
    np.testing.assert_allclose(readings, [np.sin(np.radians(1)), 0, 1, np.cos(np.radians(1))])


@given(yaw=ANGLES)
def test_variances_are_those_of_the_readings(yaw: float) -> None:
    axes = MountedAxes(LAYOUT, (0.5, -0.3, 0.8, -1.0))
    drawn = np.random.default_rng(11).standard_normal((4000, 8))
    drawn -= drawn.mean(axis=0)
    along, across = np.split(drawn, 2, axis=1)
    across -= along * ((along * across).sum(axis=0) / (along**2).sum(axis=0))  # uncorrelated
    readings = axes.readings(np.concatenate([along, across], axis=1), np.full(4000, yaw))
    expected = axes.variances(np.concatenate([along.var(axis=0), across.var(axis=0)]), yaw)
    np.testing.assert_allclose(readings.var(axis=0), expected, rtol=1e-9)


def test_a_misalignment_for_another_number_of_channels_is_refused() -> None:
    with pytest.raises(InstrumentError, match=r"misalignment has 3 values; layout two has 4"):
        MountedAxes(LAYOUT, (1.0, 2.0, 3.0))


def test_a_noise_density_gives_the_variance_of_its_band() -> None:
    assert Instruments(noise_density=2e-4).noise_deviation(40.0) == pytest.approx(2e-4 * 20**0.5)


def test_drift_runs_up_in_even_channels_and_down_in_odd_ones() -> None:
    drift = Instruments(drift_per_hour=0.2).drift(np.array([0.0, 1800.0]), 3)
    np.testing.assert_allclose(drift, [[0.0, 0.0, 0.0], [0.1, -0.1, 0.1]])


def test_nothing_leaves_the_converters_range() -> None:
    readings = np.array([[-9.0, 3.0, 8.5]])
    np.testing.assert_array_equal(Instruments(full_scale=8.0).limited(readings), [[-8.0, 3.0, 8.0]])
    np.testing.assert_array_equal(Instruments().limited(readings), readings)


def test_a_negative_noise_density_is_refused() -> None:
    with pytest.raises(InstrumentError, match="noise_density is -1"):
        Instruments(noise_density=-1.0)
