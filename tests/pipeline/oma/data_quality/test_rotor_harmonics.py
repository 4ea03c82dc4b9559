"""A turning rotor's harmonics along its angle: the short form of the benchmark `harmonics`."""

import numpy as np
import pytest

from pipeline.oma.data_quality.rotor_harmonics import follows_rotor, turns, without_harmonics
from tests.benchmarks.harmonics import figures

RATE = 20.0


def test_a_harmonic_of_a_wandering_speed_goes_and_the_rest_stays() -> None:
    generator = np.random.default_rng(0)
    time = np.arange(12_000) / RATE
    speed = 6.0 * (1 + 0.02 * np.sin(2 * np.pi * time / 80))
    angle = 2 * np.pi * np.cumsum(speed / 60) / RATE
    rest = generator.standard_normal((12_000, 2))
    samples = rest + np.outer(5 * (1 + 0.2 * time / 600) * np.cos(3 * angle + 0.4), [1.0, -0.5])
    left = without_harmonics(samples, RATE, speed)
    assert np.std(left - rest) < 0.1
    assert np.std(left) == pytest.approx(np.std(rest), rel=0.02)


def test_what_lies_at_a_harmonic_follows_the_rotor() -> None:
    speed = np.full(6000, 6.0)
    assert follows_rotor(0.301, 600.0, speed)
    assert not follows_rotor(0.32, 600.0, speed)


def test_a_standing_rotor_and_an_unknown_speed_have_no_harmonics() -> None:
    assert not turns(np.zeros(10))
    assert not turns(np.array([6.0, np.nan, 6.0]))


def test_first_modes_beside_blade_passing_are_found_where_the_speed_is_known() -> None:
    found = figures(range(72_001, 72_007), known=True)
    assert found["found"] >= 0.7
    assert found["windows_with_harmonic"] == 0
