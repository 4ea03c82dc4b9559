"""Modes that no pole shows, found in the lines alone."""

import numpy as np
import pytest

from pipeline.messages import Mode, RefusedMode
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


def found_and_refused(samples: FloatArray) -> tuple[list[Mode], list[RefusedMode]]:
    """All that the lines show."""
    reach = (0.1, HIGHEST_RELATIVE * RATE)
    return with_unseen([], [], WindowSpectrum(samples, RATE), OmaSettings(), reach=reach)


def found(samples: FloatArray) -> list[Mode]:
    """Nothing that is found is refused, too."""
    modes, refused = found_and_refused(samples)
    assert not refused
    return modes


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


def test_two_modes_that_stand_out_as_one_are_refused_with_the_reason() -> None:
    pair = np.array([FREQUENCY, 1.006 * FREQUENCY])
    shapes = np.array([SHAPE, [0.5, -0.8, 0.9]])
    generator = np.random.default_rng(2)
    samples = ambient(pair, np.full(2, DAMPING), shapes, RATE, np.ones(2), 0.1, generator)
    modes, refused = found_and_refused(samples)
    assert not modes
    (both,) = refused
    assert pair[0] < both.frequency < pair[1]
    assert both.damping_ratio == pytest.approx(DAMPING, rel=0.5)
    assert both.code == "uncertain"
    assert "one mode leaves there is not noise" in both.text
    of_evidence = "81.3 is the most): perhaps two, or channels out of phase"  # 2 % of 4065 nats
    assert both.text.endswith(of_evidence)


def test_noise_is_refused_nowhere() -> None:
    samples = np.random.default_rng(3).standard_normal((6000, 3))
    assert found_and_refused(samples) == ([], [])
