"""Decimation that leaves the modes alone, and the converter's counts."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from sensors.simulation.instruments import Decimator, quantise


def sine(frequency: float, rate: float, n: int) -> NDArray[np.float64]:
    return np.cos(2 * np.pi * frequency * np.arange(n) / rate)[:, None]


@pytest.mark.parametrize("frequency", [0.157, 2.6, 12.12, 17.9])
def test_decimation_keeps_amplitude_and_phase_up_to_18_hz(frequency: float) -> None:
    decimated = Decimator(3, 1).advance(sine(frequency, 120.0, 3600))
    expected = sine(frequency, 40.0, 1200)
    settled = slice(60, len(decimated))
    np.testing.assert_allclose(decimated[settled], expected[settled], atol=2e-4)


@pytest.mark.parametrize("frequency", [20.0, 28.0, 41.0, 59.0])
def test_nothing_folds_back_from_above_20_hz(frequency: float) -> None:
    decimated = Decimator(3, 1).advance(sine(frequency, 120.0, 3600))
    assert np.abs(decimated[60:]).max() < 2e-4


@given(cuts=st.lists(st.integers(0, 1000), max_size=6))
def test_decimation_does_not_depend_on_the_chunks(cuts: list[int]) -> None:
    samples = np.random.default_rng(5).standard_normal((1000, 2))
    whole = Decimator(3, 2).advance(samples)
    decimator = Decimator(3, 2)
    chunks = [decimator.advance(chunk) for chunk in np.split(samples, sorted(cuts))]
    np.testing.assert_allclose(np.concatenate(chunks), whole, atol=1e-12)


def test_gain_is_what_the_filter_does_to_a_sine() -> None:
    decimator = Decimator(3, 1)
    frequencies = np.array([1.0, 18.6, 19.0])
    measured = [
        np.abs(Decimator(3, 1).advance(sine(frequency, 120.0, 12_000))[100:]).max()
        for frequency in frequencies
    ]
    np.testing.assert_allclose(decimator.gain(frequencies, 120.0), measured, atol=5e-3)


def test_a_factor_of_one_changes_nothing() -> None:
    samples = np.random.default_rng(6).standard_normal((50, 3))
    np.testing.assert_array_equal(Decimator(1, 3).advance(samples), samples)


def test_counts_are_exact_multiples_of_the_step_within_half_of_it() -> None:
    step = 2.0**-13
    samples = np.random.default_rng(7).standard_normal((500, 2))
    counts = quantise(samples, step).astype(np.float64) / step
    np.testing.assert_array_equal(counts, np.round(counts))
    assert np.abs(counts * step - samples).max() <= step / 2


def test_quantisation_noise_is_a_twelfth_of_the_step_squared() -> None:
    step = 2.0**-10
    samples = np.random.default_rng(8).standard_normal((100_000, 1))
    error = quantise(samples, step) - samples
    assert np.var(error) == pytest.approx(step**2 / 12, rel=0.02)
