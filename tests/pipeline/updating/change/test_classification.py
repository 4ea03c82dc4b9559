"""Foundation or not, where the model's slopes are not those of the structure."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.change.classification import foundation_probability
from pipeline.updating.change.likelihood_ratios import stiffness_step
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import Sensitivities, Steps

N_MODES, STD = 9, 0.0005
LOST = np.array([-0.2, -0.15, -0.1])


def softened(seed: int, slope_error: float) -> tuple[Steps, np.ndarray]:
    """Steps of ln f whose slopes differ from the model's, and the model's."""
    generator = np.random.default_rng(seed)
    slopes = generator.uniform(0.0, 0.1, (N_MODES, 3))
    true = slopes * (1 + slope_error * generator.standard_normal((N_MODES, 1)))
    shifts = true @ LOST + STD * generator.standard_normal(N_MODES)
    h = np.full((1, N_MODES), STD**-2)
    return Steps(g=h * shifts, h=h), slopes


@pytest.mark.parametrize(("slope_error", "rough"), [(0.1, False), (0.3, True)])
def test_a_large_loss_of_stiffness_is_the_foundations_although_slopes_are_off(
    slope_error: float, rough: bool
) -> None:
    """A fifth lost moves modes by ten of their standard deviations and more beside the model."""
    stated = []
    for seed in range(12):
        step, slopes = softened(seed, slope_error)
        known = Sensitivities(slopes, np.zeros((N_MODES, 2)), rough=rough)
        stated.append(foundation_probability(step, known, ChangeSettings()))
    assert np.median(stated) > 0.9
    assert np.mean(np.array(stated) > 0.5) >= 0.75


@pytest.mark.parametrize("seed", range(4))
def test_a_loss_of_stiffness_is_the_foundations_where_nothing_reports_the_level(seed: int) -> None:
    """Water would move modes much as the springs do, but never by so much; a rise that the level
    was not let follow is no more the foundation's than it was beforehand."""
    step, slopes = softened(seed, 0.1)
    water = np.zeros((N_MODES, 2))
    water[:, 0] = -0.03 * slopes.mean(axis=1) * np.random.default_rng(seed).normal(1, 0.1, N_MODES)
    known = Sensitivities(slopes, water, level_std=1.0)
    assert foundation_probability(step, known, ChangeSettings()) > 0.9
    risen = replace(step, g=step.h * water[:, 0] * 1.5)
    settings = ChangeSettings()
    assert foundation_probability(risen, known, settings) < settings.foundation_share + 0.1


def test_a_size_is_as_unsure_along_the_water_as_the_level() -> None:
    """By the dense covariance of a level that moves all modes, one spring's slope along it; the
    other springs' sizes stay as they are. Closed form for weights of 1: errors are none."""
    slopes = np.zeros((6, 3))
    slopes[:2, 0], slopes[2:4, 1], slopes[4:, 2] = 0.1, 0.2, 0.3
    water = np.zeros((6, 2))
    water[:2, 0] = -0.002
    h = np.full((1, 6), 1e6)
    step = Steps(g=h * (slopes @ [-0.05, -0.02, 0.01]), h=h)
    known = Sensitivities(slopes, water)
    unknown = Sensitivities(slopes, water, level_std=1.0)
    surely, hardly = stiffness_step(step, known), stiffness_step(step, unknown)
    stds, wider = (np.sqrt(np.diag(each.covariance)) for each in (surely, hardly))
    np.testing.assert_allclose(wider[1:], stds[1:], rtol=1e-3)
    assert wider[0] == pytest.approx(np.hypot(stds[0], 0.002 / 0.1), rel=0.02)


def test_the_size_that_a_rough_model_states_is_as_unsure_as_its_slopes() -> None:
    """The truth lies within two standard deviations in nine of ten, of ten springs a trial each."""
    held = []
    for seed in range(30):
        step, slopes = softened(seed, 0.3)
        found = stiffness_step(step, Sensitivities(slopes, np.zeros((N_MODES, 2)), rough=True))
        held.append(np.abs(found.ratios - LOST) < 2 * np.sqrt(np.diag(found.covariance)))
    assert np.mean(held) > 0.85


def test_a_size_is_stated_as_least_squares_has_it_where_errors_are_normal() -> None:
    """Tails of four degrees weigh normal errors with 5 / (4 + z²), 1.04 on average: of a thousand
    modes the stated covariance is (Sᵀ H S)⁻¹ within that, and the prior."""
    generator, n_modes = np.random.default_rng(9), 1000
    slopes = generator.uniform(0.0, 0.1, (n_modes, 3))
    h = np.full((1, n_modes), STD**-2)
    shifts = slopes @ LOST + STD * generator.standard_normal(n_modes)
    found = stiffness_step(Steps(g=h * shifts, h=h), Sensitivities(slopes, np.zeros((n_modes, 2))))
    least_squares = np.linalg.inv((slopes.T * h[0]) @ slopes)
    ratio = np.sqrt(np.diag(found.covariance) / np.diag(least_squares))
    assert ratio == pytest.approx(np.ones(3), abs=0.05)
