"""Modes that no pole shows, found in the lines alone."""

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.settings import HIGHEST_RELATIVE, OmaSettings
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.neighbours import around_mode, first_mode
from pipeline.oma.whittle.unseen_modes import with_unseen
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import ambient

RATE = 10.0  # [Hz]
FREQUENCY, DAMPING = 3.6, 0.01  # [Hz], [-]
SHAPE = np.array([1.0, 0.6, -0.4])


def window(seed: int) -> FloatArray:
    """Ten minutes in a tenth as much noise, (n, 3)."""
    generator = np.random.default_rng(seed)
    one = np.ones(1)
    return ambient(FREQUENCY * one, DAMPING * one, SHAPE[None], RATE, one, 0.1, generator)


def found(samples: FloatArray) -> list[Mode]:
    """All that the lines show."""
    reach = (0.1, HIGHEST_RELATIVE * RATE)
    return with_unseen([], [], WindowSpectrum(samples, RATE), OmaSettings(), reach=reach)


def fitted_from_truth(samples: FloatArray) -> Mode:
    """The fit that begins where the mode is."""
    std = 0.001
    factor = np.full((2 + len(SHAPE), 1), std)
    true = Mode("", FREQUENCY, std, DAMPING, std, SHAPE, factor, 0)
    around = around_mode(true, [], WindowSpectrum(samples, RATE))
    assert around is not None
    return first_mode(around.fitted(), around.band)


def test_a_mode_sought_too_wide_is_known_as_if_sought_where_it_is() -> None:
    """Its peak stands out most of a stretch that is many times as wide as the mode."""
    apart = []
    for seed in range(8):
        samples = window(seed)
        (mode,) = found(samples)
        expected = fitted_from_truth(samples)
        apart.append((mode.frequency - expected.frequency) / expected.frequency_std)
        assert mode.frequency_std == pytest.approx(expected.frequency_std, rel=0.1)
    assert np.sqrt(np.mean(np.square(apart))) < 0.6  # 1.0 in the lines of the peak's own width
    assert np.abs(apart).max() < 1.0


def test_what_lies_above_the_frequencies_that_are_sought_moves_no_mode() -> None:
    """Such as a recorder's filter and what the filling of lost samples leaves there."""
    samples = window(1)
    lines = np.fft.rfft(samples, axis=0)
    lines[int(HIGHEST_RELATIVE * len(samples)) + 1 :] *= 0.1
    (mode,) = found(samples)
    (filtered,) = found(np.fft.irfft(lines, len(samples), axis=0))
    assert filtered.frequency == pytest.approx(mode.frequency, abs=1e-4 * mode.frequency_std)
    assert filtered.damping_ratio == pytest.approx(mode.damping_ratio, rel=1e-5)
