"""A farm's prior of a turbine whose structure is uncertain: what they share is counted once."""

import numpy as np

from pipeline.updating.population import StiffnessPopulation
from pipeline.updating.structural.inference import _with_population
from pipeline.updating.structural.prior import (
    N_SPRINGS,
    GaussianBelief,
    JointCoordinates,
    UncertainFigure,
)

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])
OWN = 0.02  # standard deviation of the farm's springs as described [-]
COMMON = np.array([[0.05, 0.1, 0.0], [0.0, 0.03, 0.0]])  # of added mass, and of one left exact
COORDINATES = JointCoordinates(
    NOMINAL, (UncertainFigure("steel_modulus", 0.01), UncertainFigure("added_mass", 0.15)), 0.1
)
FARM = StiffnessPopulation(
    turbines=("t1", "t2"),
    nominal=NOMINAL,
    means=np.array([[0.1, -0.1, 0.0]]),
    covariances=OWN**2 * np.eye(3)[None],
    outlier_shares=np.array([1e-6]),
    outlier_std=0.1,
    figures=("added_mass", "rna_mass"),
    common=COMMON,
)


def block(belief: GaussianBelief, *names: str) -> np.ndarray:
    """Covariance of some coordinates."""
    covariance = np.linalg.inv(belief.precision)
    places = [belief.names.index(name) for name in names]
    return np.asarray(covariance[np.ix_(places, places)])


def test_springs_follow_the_figure_whose_error_they_share() -> None:
    belief = _with_population(FARM, COORDINATES, None)
    assert belief.names == ("k11", "k22", "k12", "added_mass")
    found = block(belief, "k11", "k22", "added_mass")
    expected = np.array(
        [
            [OWN**2 + 0.05**2, 0.05 * 0.1, 0.05],
            [0.05 * 0.1, OWN**2 + 0.1**2 + 0.03**2, 0.1],
            [0.05, 0.1, 1.0],
        ]
    )
    np.testing.assert_allclose(found, expected, rtol=0.06, atol=2e-4)
    np.testing.assert_allclose(belief.mean[:2], [0.1, -0.1], atol=0.002)


def test_a_calibrated_figure_keeps_what_the_calibration_reports_of_it() -> None:
    known = GaussianBelief(("added_mass", "steel_modulus"), np.array([0.5, 0.0]), 4 * np.eye(2))
    belief = _with_population(FARM, COORDINATES, known)
    added = belief.names.index("added_mass")
    np.testing.assert_allclose(block(belief, "added_mass", "steel_modulus"), np.eye(2) / 4)
    assert belief.mean[added] == 0.5
    np.testing.assert_allclose(belief.mean[:2], [0.1 + 0.5 * 0.05, -0.1 + 0.5 * 0.1], atol=0.002)
    assert len(belief.mean) == N_SPRINGS + 2
