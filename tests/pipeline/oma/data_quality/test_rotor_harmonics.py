"""A turning rotor's harmonics along its angle: the short form of the benchmark `harmonics`."""

import numpy as np
import pytest

from pipeline.oma.data_quality.rotor_harmonics import follows_rotor, turns, without_harmonics
from tests.benchmarks.harmonics import figures
from tests.tiers import and_at_night

RATE = 20.0


def test_a_harmonic_of_a_wandering_speed_goes_and_the_rest_stays() -> None:
    generator = np.random.default_rng(0)
    time = np.arange(12_000) / RATE
    speed = 6.0 * (1 + 0.02 * np.sin(2 * np.pi * time / 80))
    angle = 2 * np.pi * np.cumsum(speed / 60) / RATE
    rest = generator.standard_normal((12_000, 2))
    samples = rest + np.outer(5 * (1 + 0.2 * time / 600) * np.cos(3 * angle + 0.4), [1.0, -0.5])
    left = without_harmonics(samples, RATE, speed).samples
    assert np.std(left - rest) < 0.1
    assert np.std(left) == pytest.approx(np.std(rest), rel=0.02)


def test_what_is_left_of_each_line_is_known() -> None:
    """White noise in many channels, whose mean power at each line is what is left of it."""
    generator = np.random.default_rng(1)
    noise = generator.standard_normal((4000, 300))
    speed = 6.0 * (1 + 0.01 * np.sin(2 * np.pi * np.arange(4000) / RATE / 50))
    rest = without_harmonics(noise, RATE, speed)
    power = (np.abs(np.fft.rfft(rest.samples, axis=0)) ** 2).mean(axis=1) / len(noise)
    assert rest.left.min() < 0.1  # at a harmonic
    assert rest.left[200:].min() > 0.999  # far from all
    np.testing.assert_allclose(power, rest.left, atol=0.25)
    assert np.mean((power - rest.left)[1:-1]) == pytest.approx(0.0, abs=0.01)


def test_what_lies_at_a_harmonic_follows_the_rotor() -> None:
    speed = np.full(6000, 6.0)
    assert follows_rotor(0.301, 600.0, speed)
    assert not follows_rotor(0.32, 600.0, speed)


def test_a_standing_rotor_and_an_unknown_speed_have_no_harmonics() -> None:
    assert not turns(np.zeros(10))
    assert not turns(np.array([6.0, np.nan, 6.0]))


@pytest.mark.parametrize("seeds", and_at_night(range(72_001, 72_003), range(72_003, 72_007)))
def test_first_modes_beside_blade_passing_are_found_where_the_speed_is_known(seeds: range) -> None:
    found = figures(seeds, known=True)
    assert found["found"] >= 0.7
    assert found["windows_with_harmonic"] == 0


@pytest.mark.parametrize(("speed", "turning"), [(0.49, False), (0.51, True)])
def test_a_rotor_turns_from_half_a_turn_a_minute_on(speed: float, turning: bool) -> None:
    assert turns(np.full(10, speed)) is turning


@pytest.mark.parametrize("order", [1, 3, 6])
def test_a_harmonic_reaches_two_lines_or_as_far_as_its_speed_scatters(order: int) -> None:
    steady = np.full(6000, 6.0)  # a tenth of a turn a second
    scattering = steady + np.where(np.arange(6000) % 2, 0.6, -0.6)  # .01 turns a second
    for speed, reach in ((steady, 2 / 600.0), (scattering, 0.01 * order)):
        for side in (-1, 1):
            assert follows_rotor(0.1 * order + side * 0.97 * reach, 600.0, speed)
            assert not follows_rotor(0.1 * order + side * 1.03 * reach, 600.0, speed)
