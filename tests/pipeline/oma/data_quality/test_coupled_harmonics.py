"""A turning rotor shows in a window by harmonics that keep one phase."""

import numpy as np
import pytest

from pipeline.oma.data_quality.coupled_harmonics import coupled_harmonics, rotor_speed_of
from pipeline.oma.data_quality.rotor_harmonics import without_harmonics
from pipeline.oma.identification import identify
from tests.benchmarks.close_modes import bending_pair
from tests.benchmarks.harmonics import figures, turning
from tests.tiers import and_at_night


@pytest.mark.parametrize("ratio", [2, 3])
def test_a_wandering_speed_keeps_the_phase_of_its_harmonics(ratio: int) -> None:
    generator = np.random.default_rng(ratio)
    rate, n = 10.0, 6000
    speed = 0.3 * (1 + 0.01 * np.sin(2 * np.pi * np.arange(n) / rate / 70))
    angle = 2 * np.pi * np.cumsum(speed) / rate
    shaking = np.outer(np.cos(angle) + 0.3 * np.cos(ratio * angle + 1), [1.0, -0.5])
    found = coupled_harmonics(shaking + 0.5 * generator.standard_normal((n, 2)), rate)
    assert found is not None
    assert found.ratio == ratio
    assert found.frequency == pytest.approx(0.3, rel=0.02)
    assert found.coherence > 0.8


@pytest.mark.parametrize(("ratio", "order"), [(2, 3), (3, 1)])
def test_the_phase_of_harmonics_says_the_speed_of_their_rotor(ratio: int, order: int) -> None:
    """Along it they go: of 16 times the power of the noise a hundredth of that is left."""
    generator = np.random.default_rng(ratio)
    rate, n = 10.0, 6000
    passing = 0.3 * (1 + 0.01 * np.sin(2 * np.pi * np.arange(n) / rate / 150))
    angle = 2 * np.pi * np.cumsum(passing) / rate
    noise = 0.25 * generator.standard_normal((n, 2))
    blades = np.sqrt(2) * (np.cos(angle) + 0.3 * np.cos(ratio * angle + 1))
    shaking = np.outer(blades, [1.0, -1.0])
    found = coupled_harmonics(shaking + noise, rate)
    assert found is not None
    speed = rotor_speed_of(found, shaking + noise, rate)
    inner = slice(n // 20, -n // 20)
    assert np.std((speed * order / 60 - passing)[inner]) < 0.0003
    left = without_harmonics(shaking + noise, rate, speed).samples
    assert np.mean((left - noise) ** 2) < 0.03 * np.mean(noise**2)


@pytest.mark.parametrize(("noise", "pure"), [(0.5, True), (3.0, False)])
def test_the_phase_is_the_machines_where_most_of_the_motion_is(noise: float, pure: bool) -> None:
    rate, n = 10.0, 6000
    angle = 2 * np.pi * 1.2 * np.arange(n) / rate
    shaking = np.outer(np.cos(angle) + np.cos(2 * angle + 1), [1.0, -0.5])
    random = noise * np.random.default_rng(5).standard_normal((n, 2))
    found = coupled_harmonics(shaking + random, rate)
    assert found is not None
    assert found.is_pure == pure


@pytest.mark.parametrize("seeds", and_at_night(range(70_001, 70_003), range(70_003, 70_005)))
def test_harmonics_of_an_unknown_speed_hide_no_modes_beside_them_and_are_none(seeds: range) -> None:
    found = figures(seeds, known=False)
    assert found["found"] >= 0.7
    assert found["windows_with_harmonic"] == 0


def test_modes_under_random_loads_are_no_harmonics() -> None:
    for seed in range(8):
        record = bending_pair(70_200 + seed)
        assert coupled_harmonics(record.samples, record.sampling_rate) is None


def test_a_turning_rotor_of_unknown_speed_is_a_warning() -> None:
    record, samples, _, passing = turning(70_003)
    warnings = identify(samples, record.sampling_rate).warnings
    (text,) = [each.text for each in warnings if each.code == "harmonic"]
    assert f"{passing:.2g}" in text


def test_a_burst_whose_lines_keep_one_phase_is_no_machine_that_turns() -> None:
    """The same two lines, for a minute of ten: the amplitude is not a rotor's."""
    rate, n = 10.0, 6000
    times = np.arange(n) / rate
    angle = 2 * np.pi * 0.3 * times
    steady = np.outer(np.cos(angle) + 0.3 * np.cos(2 * angle + 1), [1.0, -0.5])
    burst = steady * np.exp(-(((times - 300) / 30) ** 2))[:, None]
    noise = 0.05 * np.random.default_rng(2).standard_normal((n, 2))
    assert coupled_harmonics(steady + noise, rate) is not None
    assert coupled_harmonics(burst + noise, rate) is None
