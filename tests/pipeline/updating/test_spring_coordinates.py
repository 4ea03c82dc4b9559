"""Coordinates of springs: no point is a foundation that cannot be, and densities carry over."""

import numpy as np
import pytest

from pipeline.updating.population import SpringCoordinates

PUBLISHED = np.array([0.098e11, 8.238e11, 0.678e11])  # [foundation-updating] Eq. 12
EMBEDDED = PUBLISHED * [1, 1, -1]


@pytest.mark.parametrize("nominal", [PUBLISHED, EMBEDDED])
def test_every_point_is_a_positive_definite_foundation(nominal):
    points = 3 * np.random.default_rng(1).standard_normal((1000, 3))
    k11, k22, k12 = (SpringCoordinates(nominal).to_ratios(points) * nominal).T
    assert np.all(k11 > 0)
    assert np.all(k11 * k22 > k12**2)


@pytest.mark.parametrize("nominal", [PUBLISHED, EMBEDDED])
def test_there_and_back_is_where_it_was(nominal):
    coordinates = SpringCoordinates(nominal)
    points = np.random.default_rng(2).standard_normal((50, 3))
    np.testing.assert_allclose(coordinates.of_ratios(coordinates.to_ratios(points)), points)
    np.testing.assert_allclose(coordinates.of_ratios(np.ones(3)), 0, atol=1e-15)


def test_the_first_two_are_logarithms_of_the_ratios():
    ratios = np.array([0.85, 1.1, 1.0])
    np.testing.assert_allclose(
        SpringCoordinates(PUBLISHED).of_ratios(ratios)[:2], np.log(ratios[:2])
    )


@pytest.mark.parametrize("nominal", [PUBLISHED, EMBEDDED])
def test_the_jacobian_is_that_of_differences(nominal):
    coordinates = SpringCoordinates(nominal)
    point, step = np.array([0.1, -0.2, 0.3]), 1e-6
    slopes = [
        (coordinates.to_ratios(point + step * e) - coordinates.to_ratios(point - step * e))
        for e in np.eye(3)
    ]
    determinant = abs(np.linalg.det(np.array(slopes) / (2 * step)))
    assert coordinates.log_jacobian(point) == pytest.approx(np.log(determinant), abs=1e-6)
