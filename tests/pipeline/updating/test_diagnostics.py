"""What a posterior says of its own limits."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import ModePair, ParameterSummary
from pipeline.updating.acceptance import (
    AcceptanceSettings,
    contraction,
    misfit_warnings,
    mode_information,
    predictive_misfits,
    reduced_chi_square,
    unidentified_springs,
    what_differs,
)


def test_an_interval_as_wide_as_the_priors_has_contracted_by_nothing():
    assert contraction(0.9 * 3.75, 3.75) == pytest.approx(0.0)
    assert contraction(0.0, 3.75) == 1.0


def test_the_information_of_all_modes_sums_to_one_and_an_insensitive_mode_has_none():
    jacobian = np.random.default_rng(1).standard_normal((8, 3))
    jacobian[6:] = 0.0
    shares = mode_information(jacobian, np.full(8, 4.0), [0, 0, 1, 1, 2, 2, 3, 3])
    assert shares.sum() == pytest.approx(1.0)
    assert shares[3] == 0.0


def test_a_mode_as_precise_as_all_others_together_carries_most():
    jacobian = np.vstack([np.eye(3), np.eye(3)])
    shares = mode_information(jacobian, np.array([9.0] * 3 + [1.0] * 3), [0, 0, 0, 1, 1, 1])
    assert shares == pytest.approx([0.9, 0.1])


def test_right_predictions_misfit_by_one_standard_deviation_in_the_mean_square():
    generator = np.random.default_rng(2)
    squares = []
    for _ in range(600):
        error = generator.standard_normal(4)
        draws = error + 0.5 * generator.standard_normal((50, 4))
        squares.append(predictive_misfits(draws, np.full(4, 0.75), np.zeros((50, 4))) ** 2)
    assert np.mean(squares) == pytest.approx(1.0, abs=0.15)


def test_a_misfitting_mode_is_named_with_its_frequency_and_distance():
    pair = ModePair("m8", "20", 1.5365, 0.0017, 1.552, 0.997, True, misfit=-6.8, information=0.01)
    good = ModePair("m9", "6", 1.7858, 0.0014, 1.7862, 1.0, True, misfit=0.4, information=0.01)
    (warning,) = misfit_warnings([pair, good], AcceptanceSettings())
    assert warning.code == "mode-misfit"
    assert all(each in warning.text for each in ("m8", "1.536", "-1.00%", "6.8"))


def test_a_mode_whose_frequency_fits_is_named_by_its_shape():
    pair = ModePair("m4", "3", 0.63, 0.0004, 0.6298, 0.981, True, misfit=0.2, information=0.01)
    assert what_differs(pair) == "in shape: MAC 0.981"
    assert what_differs(replace(pair, misfit=-4.1)) == "frequency -4.1 standard deviations off"


def test_a_stiffness_of_which_nothing_was_learned_is_named():
    wide = ParameterSummary("k11", "N/m", 1.0, 1.0, 0.3, 3.5, contraction=0.05)
    sharp = ParameterSummary("k22", "N·m/rad", 1.0, 1.0, 0.99, 1.01, contraction=0.99)
    (warning,) = unidentified_springs([wide, sharp], AcceptanceSettings())
    assert (
        warning.text == "k11 is not identified by these sensors: its interval is 95% of the prior's"
    )


def test_one_mode_ten_deviations_off_does_not_condemn_the_structure_but_all_by_four_do():
    scatter = np.random.default_rng(3).standard_normal(33)
    one = np.append(scatter, 10.0)
    assert reduced_chi_square(one) < 2
    assert reduced_chi_square(4 * np.sign(scatter)) > 3
