"""Lines of which a part was taken off count as much as is left of them."""

import numpy as np
import pytest

from pipeline.oma.settings import HIGHEST_RELATIVE
from pipeline.oma.whittle.narrow_band import WindowSpectrum, peaks_and_flanks

RATE = 10.0


def taken_off(share: float) -> tuple[WindowSpectrum, WindowSpectrum]:
    """The spectrum of noise, and that of the same noise less a share of the power of lines 300 to
    309."""
    lines = np.fft.rfft(np.random.default_rng(2).standard_normal((6000, 2)), axis=0)
    left = np.ones(len(lines))
    left[300:310] = 1 - share
    samples, less = (np.fft.irfft(each, axis=0) for each in (lines, lines * np.sqrt(left)[:, None]))
    return WindowSpectrum(samples, RATE), WindowSpectrum(less, RATE, left=left)


def test_the_mean_power_of_a_band_is_unbiased_and_its_lines_are_fewer() -> None:
    whole, rest = taken_off(0.4)
    one, other = (spectrum.band(0.45, 0.55, 5) for spectrum in (whole, rest))
    ratio = one.powers / other.powers
    assert ratio == pytest.approx(ratio[0, 0], rel=0.01)  # what the scale of all channels makes
    assert other.n_lines == pytest.approx(one.n_lines - 4)


def test_lines_of_which_hardly_anything_is_left_are_left_out() -> None:
    whole, rest = taken_off(0.9)
    one, other = (spectrum.band(0.45, 0.55, 5) for spectrum in (whole, rest))
    assert len(other.numbers) == len(one.numbers) - 2
    assert other.n_lines == one.n_lines - 10
    edges = np.array([280, 295, 300, 310, 330])
    assert rest.uneven_band(edges).numbers == pytest.approx([287.0, 297.0, 319.5])


def test_a_stretch_is_whole_where_no_harmonic_is_near() -> None:
    _, rest = taken_off(0.4)
    assert rest.is_whole(0.4, 0.4, 0.002)
    assert not rest.is_whole(0.49, 0.49, 0.002)


def test_neither_bands_nor_flanks_reach_above_the_frequencies_that_are_sought() -> None:
    """Lines there are a hundred times as strong."""
    lines = np.fft.rfft(np.random.default_rng(3).standard_normal((6000, 2)), axis=0)
    lines[int(HIGHEST_RELATIVE * 6000) + 1 :] *= 10.0
    spectrum = WindowSpectrum(np.fft.irfft(lines, axis=0), RATE)
    band = spectrum.band(4.0, 5.0, 10)
    assert band.numbers[-1] + 5 <= HIGHEST_RELATIVE * 6000
    assert band.powers[-6:].mean() < 2 * band.powers[:6].mean()
    assert spectrum.powers_over_flank(4.4, 4.4, 0.02).min() > 0.5
    at, beside = peaks_and_flanks(spectrum.running_sums(2, 3000.0), 2, np.array([2600.0]), 12.0)
    assert np.trace(beside[0]) < 2 * np.trace(at[0])


@pytest.mark.parametrize("frequency", [0.3, 2.0])
def test_channels_of_other_quantities_become_accelerations_at_the_modes_frequency(
    frequency: float,
) -> None:
    """One motion as an accelerometer, a seismometer and a displacement gauge have it: their scaled
    lines are alike, and each stands for as much acceleration."""
    omega, t = 2 * np.pi * frequency, np.arange(6000) / RATE
    samples = np.column_stack(
        [np.sin(omega * t), -np.cos(omega * t) / omega, -np.sin(omega * t) / omega**2]
    )
    spectrum = WindowSpectrum(samples, RATE, integrations=np.array([0, 1, 2]))
    band = spectrum.band(frequency, frequency)
    (matrix,) = band.matrices
    assert matrix / matrix[0, 0] == pytest.approx(np.ones((3, 3)), abs=1e-9)
    factors = band.accelerations(frequency)
    assert factors == pytest.approx(np.full(3, np.sqrt(0.5)))
