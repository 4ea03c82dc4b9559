"""Noise alone is told from weak motion, lone axes and crosstalk."""

import numpy as np
import pytest

from pipeline.oma.data_quality.input_checks import check_samples, silent_channels
from sensors.arrays import FloatArray

RATE, N = 40.0, 24_000
NAMES = ("top-fa", "top-ss", "low-fa", "low-ss")


def motion(rng: np.random.Generator, frequencies: tuple[float, ...] = (0.3, 1.7)) -> FloatArray:
    """(N,) of lightly damped modes under a random load, of unit variance."""
    f = np.fft.rfftfreq(N, 1 / RATE)
    loads = rng.standard_normal(len(f)) + 1j * rng.standard_normal(len(f))
    gain = sum(1 / (1 - (f / one) ** 2 + 0.02j * f / one) for one in frequencies)
    response = np.fft.irfft(loads * gain, N)
    return np.asarray(response / response.std())


def tower(rng: np.random.Generator, noise: float = 0.05) -> FloatArray:
    """(N, 4): two planes that share no motion, at two heights."""
    fore_aft, side = motion(rng), motion(rng, (0.31, 1.8))
    samples = np.column_stack([fore_aft, side, 0.2 * fore_aft, 0.2 * side])
    return samples + noise * samples.std(axis=0) * rng.standard_normal(samples.shape)


def test_channels_that_move_are_not_silent_also_in_as_much_noise_and_on_their_own_axis() -> None:
    for seed in range(20):
        rng = np.random.default_rng(seed)
        assert not silent_channels(tower(rng, noise=1.0)).any()
        assert not silent_channels(tower(rng)[:, :2]).any()


@pytest.mark.parametrize("kind", ["white", "brown", "one bit"])
def test_noise_of_a_dead_channel_is_named(kind: str) -> None:
    for seed in range(20):
        rng = np.random.default_rng(100 + seed)
        samples, noise = tower(rng), rng.standard_normal(N)
        samples[:, 2] = {
            "white": 1e-4 * noise,
            "brown": 1e-3 * np.cumsum(noise) + noise,
            "one bit": np.round(0.3 * noise),
        }[kind]
        assert silent_channels(samples).tolist() == [False, False, True, False]


def test_a_weak_sensor_is_none_that_is_dead() -> None:
    rng = np.random.default_rng(7)
    samples = tower(rng)
    samples[:, 2] = 1e-3 * samples[:, 2] + 1e-4 * rng.standard_normal(N)
    assert not silent_channels(samples).any()


def test_where_nothing_moves_no_channel_is_worse_than_the_others() -> None:
    assert not silent_channels(np.random.default_rng(3).standard_normal((N, 3))).any()


def test_too_few_samples_or_one_channel_tell_nothing() -> None:
    rng = np.random.default_rng(4)
    assert not silent_channels(rng.standard_normal((500, 3))).any()
    assert not silent_channels(rng.standard_normal((N, 1))).any()


def test_the_warning_names_the_channel_and_what_to_do() -> None:
    rng = np.random.default_rng(5)
    samples = tower(rng)
    samples[:, 1] = 1e-4 * rng.standard_normal(N)
    (finding,) = check_samples(samples, RATE, NAMES)
    assert finding.code == "silent-channel"
    assert finding.action == "warn"
    assert finding.text.startswith("top-ss measures nothing")
    assert "layout" in finding.text
