"""Drawn modal estimates: what they show, how they err, and what they state of it."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import Mode
from tests.outside.figures import draw
from tests.outside.loads import STRONG, WEAK
from tests.outside.modal_data import (
    LAYOUT,
    Errors,
    Truth,
    drawn_truth,
    estimates,
    visible_modes,
)
from tests.outside.model import NOMINAL

NO_FLOOR = Errors(frequency_floor=0.0, shape_floor=0.0)
PLAIN = Truth(NOMINAL)


def number(mode: Mode) -> int:
    """Place of the true mode, from 0."""
    return int(mode.name[1:]) - 1


def test_a_strong_load_shows_about_forty_modes_and_a_weak_one_half_of_them() -> None:
    strong = estimates(PLAIN, 20, np.random.default_rng(1), loads=STRONG)
    weak = estimates(PLAIN, 20, np.random.default_rng(1), loads=WEAK)
    assert 34 <= np.mean([len(each.modes) for each in strong]) <= 42
    assert 15 <= np.mean([len(each.modes) for each in weak]) <= 24


def test_the_close_first_pair_mostly_shows_one_mode() -> None:
    found = estimates(PLAIN, 200, np.random.default_rng(2))
    both = [each for each in found if {"m1", "m2"} <= {mode.name for mode in each.modes}]
    assert 0.02 < len(both) / len(found) < 0.15
    assert all(len({m.pair_id for m in each.modes[:2]} - {""}) == 1 for each in both)
    second = [mode for each in found for mode in each.modes if mode.name == "m2"]
    assert len(second) / len(found) > 0.9


def test_stated_deviations_are_those_of_the_errors() -> None:
    visible = visible_modes(PLAIN.modes(), LAYOUT)
    found = estimates(PLAIN, 150, np.random.default_rng(3), errors=NO_FLOOR)
    alone = [mode for each in found for mode in each.modes if number(mode) in (9, 21, 30, 41)]
    scaled = [
        (mode.frequency - visible.frequencies[number(mode)]) / mode.frequency_std for mode in alone
    ]
    assert np.std(scaled) == pytest.approx(1.0, abs=0.1)
    shape_errors = [
        np.delete(
            (mode.shape - visible.shapes[number(mode)] / visible.shapes[number(mode)][unit])
            / np.where(mode.shape_std > 0, mode.shape_std, 1.0),
            unit,
        )
        for mode in alone
        for unit in [mode.unit_component]
    ]
    assert np.std(shape_errors) == pytest.approx(1.0, abs=0.1)


def test_the_unit_component_has_no_variance_and_every_other_one_has() -> None:
    for mode in estimates(PLAIN, 1, np.random.default_rng(4))[0].modes:
        assert mode.covariance_factor.shape[0] == 2 + len(LAYOUT.channels)
        assert mode.shape[mode.unit_component] == 1.0
        assert mode.shape_std[mode.unit_component] == 0.0
        assert np.all(np.delete(mode.shape_std, mode.unit_component) > 0)
        assert mode.frequency_std == pytest.approx(np.sqrt(mode.covariance[0, 0]))


def test_the_floor_stays_over_the_windows() -> None:
    found = estimates(PLAIN, 60, np.random.default_rng(5), errors=Errors(scale=1e-3))
    visible = visible_modes(PLAIN.modes(), LAYOUT)
    offsets: dict[int, list[float]] = {}
    for mode in (mode for each in found for mode in each.modes if number(mode) > 1):
        error = mode.frequency / visible.frequencies[number(mode)] - 1
        offsets.setdefault(number(mode), []).append(error)
    lone = [errors for errors in offsets.values() if np.std(errors) < 1e-4]
    assert len(lone) > 35  # the others are pairs that are blended
    assert np.std([np.mean(errors) for errors in lone]) == pytest.approx(5e-4, rel=0.3)


def test_each_window_has_its_own_water_and_its_report() -> None:
    truth = Truth(NOMINAL, draw(np.random.default_rng(6)))
    quiet = Errors(0.0, 0.0, scale=1e-6)
    low, high = estimates(
        truth,
        2,
        np.random.default_rng(7),
        levels=(-1.0, 1.0),
        reported_levels=(-0.9, 1.1),
        errors=quiet,
    )
    assert (low.water_level, high.water_level) == (-0.9, 1.1)
    common = {mode.name: mode.frequency for mode in low.modes}
    falls = [common[m.name] - m.frequency for m in high.modes if m.name in common]
    assert np.median(falls) > 0


def test_a_rigid_reading_of_a_turned_layout_is_another_shape() -> None:
    turned = replace(
        LAYOUT,
        channels=tuple(
            replace(axis, direction=(axis.direction[1], axis.direction[0], 0.0))
            for axis in LAYOUT.channels
        ),
    )
    plain = visible_modes(PLAIN.modes(), LAYOUT).shapes
    other = visible_modes(PLAIN.modes(), turned).shapes
    assert other[:, :4] == pytest.approx(plain[:, 4:])


def test_drawn_truths_stand_and_differ_in_every_figure() -> None:
    rng = np.random.default_rng(8)
    truths = [drawn_truth(rng, "embedded-pile", level_std=1.0) for _ in range(6)]
    ratios = np.array([truth.theta / NOMINAL for truth in truths])
    assert ratios.min() > 0.8
    assert ratios.max() < 1.25
    assert np.std([truth.figures.water_level for truth in truths]) > 0.3
    assert len({truth.figures for truth in truths}) == len(truths)
