"""A sea's hump is told from a mode by the shape of its lines."""

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.data_quality.sea_humps import WithoutHumps, without_sea_humps
from sensors.arrays import FloatArray
from sensors.sea_spectrum import jonswap

RATE, DURATION = 4.0, 600.0
SHAPE = np.array([0.3, 0.6, 1.0])


def mode(frequency: float, damping_ratio: float) -> Mode:
    return Mode(
        name="",
        frequency=frequency,
        frequency_std=0.01 * frequency,
        damping_ratio=damping_ratio,
        damping_ratio_std=0.3 * damping_ratio,
        shape=SHAPE,
        covariance_factor=np.zeros((5, 1)),
        n_block_columns=1,
    )


def record(power: FloatArray, seed: int) -> FloatArray:
    """Samples of a motion of one shape with a power at each line, and noise."""
    generator = np.random.default_rng(seed)
    root = np.sqrt(power / power.max())
    lines = root * (generator.standard_normal((2, len(power))).T @ [1.0, 1.0j])
    samples = np.fft.irfft(lines, round(RATE * DURATION)) * np.sqrt(len(lines))
    noise = 0.02 * samples.std() * generator.standard_normal((len(samples), 3))
    return np.asarray(np.outer(samples, SHAPE) + noise)


def lines() -> FloatArray:
    return np.asarray(np.fft.rfftfreq(round(RATE * DURATION), 1 / RATE))


def of_a_sea(seed: int) -> WithoutHumps:
    f = lines()
    samples = record(f**2 * jonswap(f, peak_frequency=0.1, peak_enhancement=3.3), seed)
    return without_sea_humps([mode(0.105, 0.05)], samples, RATE)


def of_a_mode(seed: int, frequency: float, damping_ratio: float) -> WithoutHumps:
    r = lines() / frequency
    samples = record(r**4 / ((1 - r**2) ** 2 + (2 * damping_ratio * r) ** 2), seed)
    return without_sea_humps([mode(frequency, damping_ratio)], samples, RATE)


@pytest.mark.parametrize("seed", range(203900, 203906))
def test_a_sea_is_not_passed_in_silence(seed: int) -> None:
    found = of_a_sea(seed)
    assert found.refused or found.warnings


def test_most_seas_are_refused() -> None:
    assert sum(len(of_a_sea(seed).refused) for seed in range(203910, 203922)) >= 9


@pytest.mark.parametrize(("frequency", "damping_ratio"), [(0.16, 0.02), (0.18, 0.05), (0.12, 0.04)])
def test_a_mode_in_the_band_of_waves_stays(frequency: float, damping_ratio: float) -> None:
    for seed in range(203930, 203936):
        assert not of_a_mode(seed, frequency, damping_ratio).refused


@pytest.mark.parametrize("seed", range(615390, 615396))
def test_swell_on_the_flank_of_a_mode_is_not_passed_in_silence(seed: int) -> None:
    """A narrow hump that wind and the first mode's flank rise about, from several minima."""
    f = lines()
    r = f / 0.265
    force = 1 / (1 + (f / 0.05) ** (5 / 3))
    force += 8 * jonswap(f, peak_frequency=0.13, peak_enhancement=7.0)
    samples = record(r**4 / ((1 - r**2) ** 2 + (0.04 * r) ** 2) * force, seed)
    found = without_sea_humps([mode(0.135, 0.035), mode(0.265, 0.02)], samples, RATE)
    assert found.refused or found.warnings
