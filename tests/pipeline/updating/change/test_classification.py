"""Foundation or not, where the model's slopes are not those of the structure."""

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


def test_the_size_that_a_rough_model_states_is_as_unsure_as_its_slopes() -> None:
    """The truth lies within two standard deviations in nine of ten, of ten springs a trial each."""
    held = []
    for seed in range(30):
        step, slopes = softened(seed, 0.3)
        found = stiffness_step(step, Sensitivities(slopes, np.zeros((N_MODES, 2)), rough=True))
        held.append(np.abs(found.ratios - LOST) < 2 * np.sqrt(np.diag(found.covariance)))
    assert np.mean(held) > 0.85
