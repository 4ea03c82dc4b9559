"""What must not matter: the channels' scales and order, an offset, when the record was made.

And what an independent implementation finds on the same samples.
"""

import logging
import warnings
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.oma.identification import identify
from sensors.arrays import FloatArray
from tests.pipeline.oma.conftest import KnownStructure

RATE, DURATION = 20.0, 60.0  # [Hz], [s]
N_CHANNELS = 2
few = settings(
    max_examples=5,
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
scales = st.lists(st.floats(1e-4, 1e4), min_size=N_CHANNELS, max_size=N_CHANNELS)
offsets = st.lists(st.floats(-30.0, 30.0), min_size=N_CHANNELS, max_size=N_CHANNELS)


@pytest.fixture(scope="module")
def record(two_mass_system: KnownStructure) -> FloatArray:
    """(n, 2) ambient response of the two masses; rms of about 1."""
    return two_mass_system.ambient_response(sampling_rate=RATE, duration=DURATION, seed=11)


@pytest.fixture(scope="module")
def modes(record: FloatArray) -> tuple[Mode, ...]:
    found = identify(record, RATE).modes
    assert len(found) == 2
    return found


def assert_same(found: Sequence[Mode], expected: Sequence[Mode]) -> None:
    """Frequencies and damping ratios to rounding; their stds to the truncated decomposition."""
    assert len(found) == len(expected)
    tolerances = {"frequency": 1e-6, "damping_ratio": 1e-5}
    tolerances |= {"frequency_std": 2e-3, "damping_ratio_std": 2e-3}
    for quantity, tolerance in tolerances.items():
        np.testing.assert_allclose(
            [getattr(mode, quantity) for mode in found],
            [getattr(mode, quantity) for mode in expected],
            rtol=tolerance,
        )


def as_unit(shape: FloatArray) -> FloatArray:
    return shape / shape[np.argmax(np.abs(shape))]


@few
@given(scale=scales)
def test_channel_scales_scale_the_shapes_and_nothing_else(
    record: FloatArray, modes: tuple[Mode, ...], scale: list[float]
) -> None:
    found = identify(record * np.array(scale), RATE).modes
    assert_same(found, modes)
    for mode, before in zip(found, modes, strict=True):
        # The real part is taken after dividing by the largest component: where the scales make
        # another one the largest, what is left of a shape's complexity turns it a little.
        np.testing.assert_allclose(mode.shape, as_unit(before.shape * scale), atol=1e-3)


@few
@given(order=st.permutations(range(N_CHANNELS)))
def test_order_of_channels_orders_the_shapes_and_nothing_else(
    record: FloatArray, modes: tuple[Mode, ...], order: list[int]
) -> None:
    found = identify(record[:, order], RATE).modes
    assert_same(found, modes)
    for mode, before in zip(found, modes, strict=True):
        np.testing.assert_allclose(mode.shape, before.shape[order], atol=1e-5)


@few
@given(offset=offsets)
def test_an_offset_changes_no_mode(
    record: FloatArray, modes: tuple[Mode, ...], offset: list[float]
) -> None:
    found = identify(record + np.array(offset), RATE).modes
    assert_same(found, modes)
    for mode, before in zip(found, modes, strict=True):
        np.testing.assert_allclose(mode.shape, before.shape, atol=1e-5)


@few
@given(start=st.floats(0.0, 2e9))
def test_when_the_record_began_does_not_matter(
    record: FloatArray, modes: tuple[Mode, ...], start: float
) -> None:
    times = start + np.arange(len(record)) / RATE
    assert_same(identify(record, RATE, times=times).modes, modes)


@pytest.mark.peer
def test_pyoma_finds_the_same_modes_within_the_stated_std(cantilever: KnownStructure) -> None:
    pyoma2 = pytest.importorskip("pyoma2.algorithms")
    setup_of = pytest.importorskip("pyoma2.setup").SingleSetup
    samples = cantilever.ambient_response(sampling_rate=RATE, duration=300.0, seed=13)
    logging.disable(logging.CRITICAL)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        setup = setup_of(samples.copy(), fs=RATE)
        setup.add_algorithms(
            pyoma2.SSI(name="ssi", method="cov", br=60, ordmin=2, ordmax=40, step=2)
        )
        setup.run_by_name("ssi")
        poles = setup["ssi"].result
    logging.disable(logging.NOTSET)
    order = poles.Fn_poles.shape[1] - 1
    for mode in identify(samples, RATE).modes:
        theirs = int(np.nanargmin(np.abs(poles.Fn_poles[:, order] - mode.frequency)))
        frequency = poles.Fn_poles[theirs, order]
        assert abs(frequency - mode.frequency) < 3 * mode.frequency_std
        shape = np.real(poles.Phi_poles[theirs, order])
        assert modal_assurance_criterion(mode.shape[None], shape[None])[0, 0] > 0.98
