"""What is left out of a fit is predicted by the others as a fit without it predicts it."""

import numpy as np
import pytest

from pipeline.updating.structural.joint_model import JointPeak
from pipeline.updating.structural.predictive_checks import held_out_checks
from pipeline.updating.structural.prior import JointCoordinates, UncertainFigure
from tests.pipeline.updating.structural.comparisons import GROUPS, comparison

NOMINAL = np.array([0.098e11, 8.238e11, 0.678e11])


def test_a_mode_that_is_left_out_lies_as_far_off_as_from_a_fit_of_the_others() -> None:
    coordinates = JointCoordinates(NOMINAL, (UncertainFigure("steel_modulus", 0.01),), 0.1)
    found = comparison(1, coordinates.n_dim)
    u = coordinates.origin + 0.1 * np.random.default_rng(2).standard_normal(coordinates.n_dim)
    checks = held_out_checks(JointPeak(u, found, 0.0, 6), coordinates)

    D, J, P = found.variances + found.floors, found.jacobian, coordinates.prior_precision
    for group in range(3):
        others, own = group != GROUPS, group == GROUPS
        hessian = (J[others].T / D[others]) @ J[others] + P
        gradient = J[others].T @ (found.errors[others] / D[others]) + P @ (u - coordinates.origin)
        error = found.errors[own] - J[own] @ np.linalg.solve(hessian, gradient)
        covariance = np.diag(D[own]) + J[own] @ np.linalg.inv(hessian) @ J[own].T
        assert checks.squares[group] == pytest.approx(error @ np.linalg.solve(covariance, error))
        assert checks.frequency_misfits[group] == pytest.approx(
            -error[0] / np.sqrt(covariance[0, 0])
        )
