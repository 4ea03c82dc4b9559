"""A rotor that turns shows by harmonics too weak to be taken off."""

import numpy as np
import pytest
from scipy.signal import lfilter

from pipeline.oma.data_quality.turning_rotor import (
    TurningRotor,
    _cumulated,
    _directions,
    _of_constant_speed,
    turning_rotor,
)
from pipeline.oma.identification import identify
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import bending_pair, triplet
from tests.tiers import and_at_night

RATE, DURATION = 20.0, 600.0
SPEED = 6.5  # [rpm]
ACROSS = np.array([0.1, 0.03, 0.3, 0.1, 0.5, 0.15, 1.0, 0.3])  # what a rotor pushes, as no mode


def parked(seed: int) -> FloatArray:
    """A tower's four bending modes, (n, 8)."""
    return bending_pair(seed).samples


def harmonics(speed: FloatArray, orders: tuple[tuple[int, float], ...]) -> FloatArray:
    """Motion at multiples of a speed [rpm], (n,)."""
    angle = 2 * np.pi * np.cumsum(speed / 60) / RATE
    return sum(share * np.cos(order * angle + order) for order, share in orders)


def with_rotor(seed: int, size: float, *, wander: float, mean: float = SPEED) -> FloatArray:
    """The tower beside 3P of that size over its rms, 6P and 1P a third and a fifth of it."""
    quiet = parked(seed)
    keeps = np.exp(-1 / (RATE * 60))
    white = np.random.default_rng(seed).standard_normal(len(quiet))
    slow = lfilter([1.0], [1.0, -keeps], white)
    speed = mean * (1 + wander * (slow - slow.mean()) / slow.std())
    blades = harmonics(speed, ((3, 1.0), (6, 0.3), (1, 0.2)))
    return quiet + size * quiet.std(axis=0).max() * np.outer(blades, ACROSS)


def rotor_of(samples: FloatArray) -> TurningRotor | None:
    return turning_rotor(samples - samples.mean(axis=0), RATE)


@pytest.mark.parametrize("wander", [0.0, 0.003, 0.01, 0.03])
def test_harmonics_of_a_tenth_of_the_motion_say_that_a_rotor_turns(wander: float) -> None:
    for seed in range(70_301, 70_305):
        found = rotor_of(with_rotor(seed, 0.1, wander=wander))
        assert found is not None
        assert found.speed == pytest.approx(SPEED, rel=0.03)
        assert found.orders == (3, 6)


@pytest.mark.parametrize("seeds", and_at_night(range(70_311, 70_315), range(70_315, 70_323)))
def test_a_tower_that_shakes_at_random_has_no_rotor(seeds: range) -> None:
    for seed in seeds:
        assert rotor_of(parked(seed)) is None
        assert rotor_of(triplet(seed).samples) is None


def test_one_line_alone_is_no_rotor() -> None:
    """A machine on the platform hums at one frequency."""
    quiet = parked(70_321)
    line = harmonics(np.full(len(quiet), SPEED), ((3, 1.0),))
    assert rotor_of(quiet + np.outer(line, ACROSS)) is None


@pytest.mark.parametrize("seeds", and_at_night(range(72_000, 72_012), range(72_000, 72_024)))
def test_a_hum_of_any_frequency_is_seldom_a_rotor(seeds: range) -> None:
    """Another order has as much as chance gives one of the six pairs of orders that are tried."""
    rotors = 0
    for seed in seeds:
        quiet = parked(seed)
        frequency = np.random.default_rng(seed).uniform(0.3, 3.0)
        hum = np.cos(2 * np.pi * frequency * np.arange(len(quiet)) / RATE)
        found = rotor_of(quiet + 0.1 * quiet.std(axis=0).max() * np.outer(hum, ACROSS))
        rotors += found is not None
    assert rotors <= len(seeds) // 8


def test_a_rotor_that_idles_is_as_a_parked_one() -> None:
    for wander in (0.0, 0.02):
        assert rotor_of(with_rotor(70_331, 0.3, wander=wander, mean=0.7)) is None


@pytest.mark.parametrize("n", [100, 1_000])
def test_a_window_too_short_to_show_a_rotor_shows_none(n: int) -> None:
    assert rotor_of(parked(70_341)[:n]) is None


def test_more_channels_than_lines_beside_a_harmonic_and_a_dead_pair_are_no_obstacle() -> None:
    samples = with_rotor(70_351, 0.1, wander=0.01)
    many = samples @ np.random.default_rng(1).standard_normal((8, 40))
    many += 1e-3 * np.random.default_rng(2).standard_normal(many.shape)
    assert rotor_of(many) is not None
    assert rotor_of(np.column_stack([samples, samples[:, 0]])) is not None


def test_a_rotor_is_told_of_in_words_with_its_speed() -> None:
    found = identify(with_rotor(70_361, 0.1, wander=0.003)[:, 4:], RATE)
    (text,) = [each.text for each in found.warnings if each.code == "turning-rotor"]
    assert "Hz are harmonics of one speed: a rotor turns, at 6.5 rpm" in text


def test_a_window_whose_speed_is_known_is_not_warned_of() -> None:
    samples = with_rotor(70_361, 0.1, wander=0.0)[:, 4:]
    known = identify(samples, RATE, rotor_speed=np.full(len(samples), SPEED))
    assert not [each for each in known.warnings if each.code == "turning-rotor"]
    standing = identify(samples, RATE, rotor_speed=np.zeros(len(samples)))
    assert [each for each in standing.warnings if each.code == "turning-rotor"]


@pytest.mark.parametrize("stops", [True, False])
def test_a_rotor_that_stops_or_starts_within_the_window_turns(stops: bool) -> None:
    """For two fifths of the window, at one speed: no harmonic is steady in the whole."""
    for seed in (70_331, 70_332, 70_333):
        quiet = parked(seed)
        times = np.arange(len(quiet)) / DURATION / RATE
        speed = SPEED * np.interp(times, [0.4, 0.45], [1.0, 0.0])
        blades = harmonics(speed, ((3, 1.0), (6, 0.3), (1, 0.2))) * (speed / SPEED) ** 2
        blades = blades if stops else blades[::-1]
        found = rotor_of(quiet + 0.4 * quiet.std(axis=0).max() * np.outer(blades, ACROSS))
        assert found is not None
        assert found.speed == pytest.approx(SPEED, rel=0.03)


def test_the_speed_of_a_steady_rotor_is_that_of_its_line_over_the_lines_order() -> None:
    samples = with_rotor(70_301, 0.1, wander=0.0)
    lines = _directions(samples - samples.mean(axis=0), DURATION)
    found = next(_of_constant_speed(lines, _cumulated(lines), DURATION))
    assert found.speed == pytest.approx(SPEED, abs=60 / DURATION)
    assert found.orders == (3, 6)
