"""Where a foundation can be, and where it cannot."""

import numpy as np
import pytest

from pipeline.updating.prior import Prior, PriorSettings, UpdatingError, modal_where_supported
from tests.pipeline.updating.small_tower import NOMINAL, SmallTower


def test_39_percent_of_the_box_has_springs_that_are_not_positive_definite():
    ratios = np.random.default_rng(1).uniform(0.25, 4.0, size=(200_000, 3))
    assert np.mean(Prior(NOMINAL).supports(ratios)) == pytest.approx(0.61, abs=0.01)


def test_the_boundary_of_positive_definite_springs_is_where_the_determinant_vanishes():
    boundary = np.sqrt(NOMINAL[0] * NOMINAL[1]) / NOMINAL[2]  # largest k12 ratio at k11 = k22 = 1
    ratios = np.array([[1, 1, boundary * 0.999], [1, 1, boundary * 1.001]])
    assert Prior(NOMINAL).supports(ratios).tolist() == [True, False]


def test_the_prior_is_flat_with_one_value_for_each_set_of_ratios():
    assert Prior(NOMINAL).log_density(np.ones((5, 3))).tolist() == [0.0] * 5
    assert Prior(NOMINAL).log_density(np.ones((2, 5, 3))).shape == (2, 5)


def test_the_box_ends_at_a_quarter_and_four_times_nominal():
    ratios = np.array([[0.25, 4, 0.25], [0.2499, 4, 0.25], [1, 4.0001, 0.25]])
    assert Prior(NOMINAL).supports(ratios).tolist() == [True, False, False]


def test_the_sign_of_the_coupling_does_not_matter():
    embedded = NOMINAL * [1, 1, -1]
    ratios = np.random.default_rng(2).uniform(0.25, 4.0, size=(1000, 3))
    assert np.array_equal(Prior(NOMINAL).supports(ratios), Prior(embedded).supports(ratios))


def test_draws_are_uniform_in_stiffness_on_the_supported_part():
    draws = Prior(NOMINAL).draws(20_000, np.random.default_rng(3))
    assert Prior(NOMINAL).supports(draws).all()
    with_little_coupling = draws[draws[:, 2] < 0.26]  # there the determinant excludes nothing
    assert np.mean(with_little_coupling[:, 0]) == pytest.approx((0.25 + 4) / 2, rel=0.1)


def test_the_model_is_asked_only_where_the_prior_is_above_zero():
    ratios = np.array([[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]])
    supported, modes = modal_where_supported(SmallTower(), Prior(NOMINAL), ratios)
    assert supported.tolist() == [True, False]
    assert modes is not None
    assert len(modes.frequencies) == 1


@pytest.mark.parametrize("bounds", [(0.0, 4.0), (4.0, 0.25), (0.25, np.inf)])
def test_bounds_that_are_not_positive_and_rising_are_refused_with_their_values(bounds):
    with pytest.raises(UpdatingError, match=str(bounds[0])):
        PriorSettings(lowest_ratio=bounds[0], highest_ratio=bounds[1])


def test_a_nominal_spring_of_zero_cannot_be_updated_as_a_ratio():
    with pytest.raises(UpdatingError, match="other than 0"):
        Prior(np.array([1.0, 1.0, 0.0]))
