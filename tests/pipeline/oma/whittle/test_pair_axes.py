"""Two modes that a window does not resolve, perpendicular to each other, under unlike loads."""

from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.oma.settings import OmaSettings
from pipeline.oma.whittle.groups import Group, Suspect, modes_of_group
from pipeline.oma.whittle.narrow_band import WindowSpectrum
from pipeline.oma.whittle.pair_axes import _turn
from pipeline.oma.whittle.spectral_model import CloseModes, n_inner
from pipeline.oma.whittle.unseen_modes import peaks_of_two
from sensors.arrays import FloatArray
from tests.benchmarks.close_modes import ambient
from tests.tiers import and_at_night

RATE = 5.0
HEIGHT = np.array([0.3, 0.55, 0.75, 1.0])
SIDE_SIDE, FORE_AFT = 0.158, 0.1594  # .84 lines of ten minutes apart [Hz]


def tower(seed: int) -> FloatArray:
    """Fore-aft shaken four times as much as side-side; axes along every other channel."""
    shapes = np.zeros((2, 8))
    shapes[0, 1::2], shapes[1, 0::2] = HEIGHT**1.8, HEIGHT**1.8
    return ambient(
        np.array([SIDE_SIDE, FORE_AFT]),
        np.array([0.007, 0.007]),
        shapes,
        RATE,
        np.array([0.25, 1.0]),
        0.03,
        np.random.default_rng(seed),
    )


def pair_of(seed: int) -> tuple[Mode, ...]:
    spectrum = WindowSpectrum(tower(seed), RATE)
    group = Group(0.1588, 0.1588, 0.0011)
    found = modes_of_group(group, spectrum, [Suspect(1.0, 0.01)], OmaSettings())
    return () if found is None else found.modes


@pytest.mark.parametrize("seeds", and_at_night(range(12), range(24)))
def test_frequencies_of_a_perpendicular_pair_do_not_fall_near_their_mean(seeds: range) -> None:
    gaps, errors = [], []
    for seed in seeds:
        modes = pair_of(seed)
        by_axis = {int(np.argmax(np.abs(mode.shape))) % 2: mode for mode in modes}
        if len(modes) == 2 and len(by_axis) == 2:
            gaps.append(by_axis[0].frequency - by_axis[1].frequency)
            errors.append((by_axis[0].frequency - FORE_AFT) / by_axis[0].frequency_std)
    assert len(gaps) >= 5 / 6 * len(seeds)
    assert abs(np.mean(gaps) - (FORE_AFT - SIDE_SIDE)) < 3 * np.std(gaps) / np.sqrt(len(gaps))
    assert np.mean(gaps) > 0.5 * (FORE_AFT - SIDE_SIDE)
    assert np.sqrt(np.mean(np.square(errors))) < 1.3


def test_a_peak_of_two_directions_is_seen_unless_its_mode_is_known() -> None:
    spectrum = WindowSpectrum(tower(3), RATE)
    (peak,) = peaks_of_two(spectrum, [])
    assert abs(peak - 0.159) < 0.004
    assert peaks_of_two(spectrum, [0.159]) == []


def test_a_mode_alone_is_no_peak_of_two_directions() -> None:
    for seed in range(6):
        samples = ambient(
            np.array([0.16]),
            np.array([0.007]),
            HEIGHT[None] ** 1.8,
            RATE,
            np.array([1.0]),
            0.03,
            np.random.default_rng(seed),
        )
        assert peaks_of_two(WindowSpectrum(samples, RATE), []) == []


def test_a_turn_of_two_axes_moves_each_shape_towards_the_others_unit_vector() -> None:
    """Channels in unlike units: e_1 + ε e_2 is meant of the shapes as they were measured."""
    generator = np.random.default_rng(4)
    shapes, scales = generator.uniform(-1, 1, (5, 2)), generator.uniform(0.5, 2.0, 5)
    start = CloseModes(
        positions=np.array([10.0, 11.0]),
        half_widths=np.array([0.5, 0.5]),
        shapes=shapes,
        forces=np.eye(2, dtype=complex),
        colours=np.zeros(2),
        noise=np.eye(5),
    ).normalised()
    turn = _turn(start, SimpleNamespace(scales=scales))
    step = 1e-6
    moves = turn[n_inner(2) :].reshape(2, 4)
    units = start.shapes * scales[:, None]
    units /= np.linalg.norm(units, axis=0)
    for own, other, sign in ((0, 1, step), (1, 0, -step)):
        turned = (units[:, own] + sign * units[:, other]) / scales
        turned /= turned[start.units[own]]
        moved = np.delete(turned - start.shapes[:, own], start.units[own])
        np.testing.assert_allclose(moved, step * moves[own], rtol=1e-4, atol=1e-12)
