"""How long a mode is remembered that the windows see no more, and modes without some channels."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import ModeEvidence, PartnerInWater
from pipeline.updating.evidence.observations import ModeObservation
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

DAY, WEEK, MONTH = 144, 1008, 4320  # windows of ten minutes


def seen_in(n_windows: int) -> ModeEvidence:
    observation = ModeObservation("m1", np.array([1.0, 1.0]), np.diag([1e-3, 0.0]), n_blocks=0)
    mode = ModeEvidence.empty(observation)
    return replace(mode, n_windows=n_windows, last_window=n_windows)


@pytest.mark.parametrize(
    ("n_windows", "kept_for", "gone_after"),
    [
        (1, DAY - 1, DAY + 1),  # a spurious pole: a day
        (8, WEEK, 9 * DAY),  # a mode that is seldom excited: a day for each window with it
        (10 * DAY, MONTH - 1, MONTH + 1),  # a mode of the tower: a month at most
    ],
)
def test_the_oftener_a_mode_was_seen_the_longer_it_is_waited_for(
    n_windows: int, kept_for: int, gone_after: int
) -> None:
    mode = seen_in(n_windows)
    assert not mode.forgotten(n_windows + kept_for)
    assert mode.forgotten(n_windows + gone_after)


def test_a_mode_that_wanders_far_from_its_mean_is_still_the_same_mode() -> None:
    """A tide of 3 ‰ a window and 6 % in all: three standard deviations of one window from the
    mean, one from the window before."""
    tower, evidence = LinearTower(), ModalEvidence(channels=LAYOUT.channel_names)
    for number in range(21):
        generator = np.random.default_rng(number)
        drift = np.full(6, 0.003 * number)
        estimate = drawn_estimate(
            np.ones(3), generator, window=number, tower=tower, labels=("3",), bias=drift[:1]
        )
        evidence = evidence.with_estimate(estimate)
    (mode,) = evidence.modes
    assert mode.n_windows == 21


def seen_mode(values: list[float], stds: list[float], rises: tuple[float, ...]) -> ModeEvidence:
    """Of windows with the water that much above the model's level."""
    factor = np.diag(stds)
    observation = ModeObservation("m1", np.array(values), factor, n_blocks=0)
    mode = ModeEvidence.empty(observation)
    for window, rise in enumerate(rises, start=1):
        mode = mode.with_observation(
            observation, window=window, weight=1.0, joint_covariance=False, rise=rise
        )
    return mode


def test_without_a_channel_a_mode_is_as_if_that_channel_had_not_measured() -> None:
    values, stds = [0.3, 1.0, 0.6, -0.4], [1e-3, 0.0, 0.02, 0.03]
    absent = [0.3, 1.0, np.nan, -0.4], [1e-3, 0.0, 0.0, 0.03]
    water = PartnerInWater(np.log([0.29, 0.3, 0.302]), np.array([[1, 0.5, -0.3]] * 3) * 1.0)
    water.shapes[2] += [0.0, 0.1, 0.2]
    rises = (0.5, -0.2, 1.0)
    left_out = seen_mode(values, stds, rises).without_channels([1])
    expected = seen_mode(*absent, rises)
    for mode, other in [
        (left_out, expected),
        (left_out.at_model_level(water), expected.at_model_level(water)),
    ]:
        np.testing.assert_allclose(mode.mean, other.mean)
        np.testing.assert_allclose(mode.covariance, other.covariance)


def test_levels_above_a_higher_water_are_those_of_windows_that_were_measured_from_there() -> None:
    values, stds, rises = [0.3, 1.0, 0.6, -0.4], [1e-3, 0.0, 0.02, 0.03], (3.4, 2.7, 3.0)
    moved = seen_mode(values, stds, rises).with_levels_above(3.0)
    expected = seen_mode(values, stds, (0.4, -0.3, 0.0))
    np.testing.assert_allclose(moved.level_information, expected.level_information, atol=1e-6)
    np.testing.assert_array_equal(moved.information_mean, expected.information_mean)


def test_a_curve_about_another_level_is_of_the_same_parabola() -> None:
    water = PartnerInWater(np.array([-0.2, 0.1, 0.3]), np.ones((3, 2)))
    slope, curvature = water.curve
    there, bend = water.curve_about(-3.0)
    height = slope * -3 + curvature * 9
    for level in (-1.0, 0.5, 4.0):
        assert height + there * (level + 3) + bend * (level + 3) ** 2 == pytest.approx(
            slope * level + curvature * level**2
        )


def test_a_shape_without_its_unit_component_scatters_as_drawn_ones_do() -> None:
    """By a Monte Carlo: draws of the shape, normalised to the channel that is best known then."""
    values, stds = [0.3, 1.0, 0.9, -0.4, 0.2], [1e-3, 0.0, 0.01, 0.02, 0.01]
    left_out = seen_mode(values, stds, (0.0,)).without_channels([0])
    assert left_out.unit_component == 1
    drawn = np.random.default_rng(18_950).normal(values, stds, (200_000, 5))
    drawn[:, 2:] /= drawn[:, [2]]
    np.testing.assert_allclose(
        left_out.mean[[0, 2, 3, 4]], drawn.mean(axis=0)[[0, 2, 3, 4]], rtol=2e-3
    )
    stds_left = np.sqrt(np.diag(left_out.covariance))[[0, 3, 4]]
    np.testing.assert_allclose(stds_left, drawn.std(axis=0)[[0, 3, 4]], rtol=0.01)
    assert not left_out.known[1]
    assert not left_out.known[2]


def test_a_mode_of_one_sensor_alone_is_a_frequency_without_it() -> None:
    left_out = seen_mode([0.3, 1.0, 0.9], [1e-3, 0.0, 0.01], (0.0,)).without_channels([0, 1])
    assert left_out.frequency == pytest.approx(0.3)
    assert left_out.frequency_std == pytest.approx(1e-3)
    assert not left_out.known[1:].any()


def test_a_modes_damping_is_the_mean_of_its_windows() -> None:
    observation = ModeObservation("m1", np.array([1.0, 1.0]), np.diag([1e-3, 0.0]), n_blocks=0)
    mode = ModeEvidence.empty(observation)
    for window, ratio in enumerate((0.01, 0.02, 0.06), start=1):
        seen = replace(observation, damping_ratio=ratio)
        mode = mode.with_observation(seen, window=window, weight=1.0, joint_covariance=False)
    assert mode.damping_ratio == pytest.approx(0.03)
