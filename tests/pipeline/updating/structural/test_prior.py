"""Coordinates of springs and figures: what a point stands for, and its derivatives."""

import numpy as np
import pytest
from scipy.special import expit, logit, ndtri
from scipy.stats import halfnorm

from pipeline.updating.structural.prior import GaussianBelief, JointCoordinates, UncertainFigure

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
FIGURES = (UncertainFigure("steel_modulus", 0.01), UncertainFigure("transition_piece", 150e3))


@pytest.fixture
def coordinates() -> JointCoordinates:
    return JointCoordinates(NOMINAL, FIGURES, 0.1, sensor_names=("gain a",))


def test_the_origin_is_the_described_foundation(coordinates: JointCoordinates) -> None:
    np.testing.assert_allclose(coordinates.springs(coordinates.origin), NOMINAL, rtol=1e-12)


def test_every_point_has_positive_definite_springs(coordinates: JointCoordinates) -> None:
    u = np.random.default_rng(1).normal(0.0, 3.0, (200, coordinates.n_dim))
    k11, k22, k12 = coordinates.springs(u).T
    assert np.all(k11 * k22 > k12**2)


def test_ratios_come_back_from_their_coordinates(coordinates: JointCoordinates) -> None:
    ratios = np.array([1.2, 0.9, 1.05])
    u = coordinates.origin
    u = np.concatenate([coordinates.of_ratios(ratios), u[3:]])
    np.testing.assert_allclose(coordinates.springs(u) / NOMINAL, ratios, rtol=1e-12)


def test_standard_normal_coordinates_give_half_normal_masses(coordinates: JointCoordinates) -> None:
    u = np.random.default_rng(2).standard_normal((4000, coordinates.n_dim))
    masses = coordinates.departures(u)[:, 1]
    expected = halfnorm.ppf([0.1, 0.5, 0.9], scale=150e3)
    np.testing.assert_allclose(np.quantile(masses, [0.1, 0.5, 0.9]), expected, rtol=0.1)


def test_slopes_are_those_of_differences(coordinates: JointCoordinates) -> None:
    u = coordinates.origin + np.random.default_rng(3).normal(0.0, 0.5, coordinates.n_dim)
    slopes = coordinates.slopes(u)

    def values(point: np.ndarray) -> np.ndarray:
        parts = [coordinates.springs(point), coordinates.departures(point)]
        return np.append(np.concatenate(parts), coordinates.level(point))

    for column in range(coordinates.n_dim):
        step = np.zeros(coordinates.n_dim)
        step[column] = 1e-6
        difference = (values(u + step) - values(u - step)) / 2e-6
        np.testing.assert_allclose(slopes[:, column], difference, rtol=1e-5, atol=1e-9)


def test_a_belief_replaces_the_prior_of_its_coordinates(coordinates: JointCoordinates) -> None:
    belief = GaussianBelief(("k11", "steel_modulus"), np.array([0.1, 1.0]), np.diag([400.0, 4.0]))
    told = coordinates.with_belief(belief)
    assert told.origin[0] == 0.1
    assert told.prior_precision[3, 3] == 4.0
    assert told.prior_precision[1, 1] == coordinates.prior_precision[1, 1]


def test_wider_figures_leave_springs_level_and_sensors_as_they_were(
    coordinates: JointCoordinates,
) -> None:
    wider = coordinates.with_wider_figures(3.0)
    stds = np.sqrt(np.diag(np.linalg.inv(wider.prior_precision)))
    ratios = stds * np.sqrt(np.diag(coordinates.prior_precision))
    figures = [3 + i for i in range(len(FIGURES))]
    others = [i for i in range(coordinates.n_dim) if i not in figures]
    np.testing.assert_allclose(ratios[figures], 3.0)
    np.testing.assert_allclose(ratios[others], 1.0)


def test_no_figure_falls_below_a_tenth_of_the_described_one() -> None:
    """A nacelle's inertia is uncertain by a fifth: five deviations below, nothing would be left."""
    coordinates = JointCoordinates(NOMINAL, (UncertainFigure("nacelle_roll_inertia", 0.2),), 0.1)
    u = coordinates.origin
    u[3] = -7.0
    assert coordinates.departures(u)[0] == pytest.approx(-0.9)
    assert coordinates.slopes(u)[3, 3] == 0.0


def test_priors_that_were_changed_stay_changed(coordinates: JointCoordinates) -> None:
    """A sensor that may be far off, then another one, then an unknown level: all three count."""
    level, gain = coordinates.n_dim - 2, coordinates.n_dim - 1
    found = coordinates.with_prior(gain, 3.0, 40.0).with_prior(3, 1.0, 5.0).with_level_std(1.0)
    assert found.prior_precision[gain, gain] == pytest.approx(40.0**-2)
    assert found.prior_precision[3, 3] == pytest.approx(5.0**-2)
    assert (found.origin[gain], found.origin[3]) == (3.0, 1.0)
    u = found.origin.copy()
    u[level] = 2.0
    assert found.level(u) == pytest.approx(2.0)
    assert coordinates.level(u) == pytest.approx(0.2)
    assert coordinates.prior_precision[gain, gain] == pytest.approx(1.0)


def test_springs_beforehand_are_known_to_a_factor_either_way() -> None:
    """ln k11 and ln k22 have a standard deviation of 1: 90 % within exp(±1.645) of nominal. Of k12
    the logit of its squared share has 2 beside them, by quadrature."""
    widths = JointCoordinates(NOMINAL, (), 0.1).spring_intervals()
    assert widths[:2] == pytest.approx(2 * 1.6449, rel=0.03)
    z = ndtri((np.arange(400) + 0.5) / 400)
    share = NOMINAL[2] ** 2 / (NOMINAL[0] * NOMINAL[1])
    k12 = np.exp(z[:, None] / np.sqrt(2)) * np.sqrt(expit(logit(share) + 2 * z) / share)
    low, high = np.quantile(k12, [0.05, 0.95])
    assert widths[2] == pytest.approx(np.log(high / low), rel=0.03)
