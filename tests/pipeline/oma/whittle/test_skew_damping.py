"""What a fit says of a mode a few lines wide, whose damping it knows to a third."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.oma.whittle.fit import WhittleFit, modes_of_fit
from tests.pipeline.oma.whittle.test_spectral_model import N_MODAL, two_modes

RELATIVE_STD = 0.5  # of ln b


def test_damping_is_its_mean_over_the_logarithm_and_the_frequency_is_known_less() -> None:
    modes, band = two_modes()
    variances = np.full(N_MODAL, 1e-6)
    variances[:2] = 0.04  # of the positions [lines²]
    variances[2] = RELATIVE_STD**2
    fit = WhittleFit(modes, 0.0, np.diag(1 / variances), np.eye(N_MODAL), converged=True)
    vague, sharp = modes_of_fit(fit, band)
    at_peak = modes.half_widths / np.hypot(modes.positions, modes.half_widths)
    assert vague.damping_ratio == pytest.approx(at_peak[0] * np.exp(RELATIVE_STD**2 / 2), rel=1e-4)
    assert vague.damping_ratio_std == pytest.approx(at_peak[0] * RELATIVE_STD, rel=1e-4)
    known = 0.2 / band.duration
    assert vague.frequency_std == pytest.approx(known * np.hypot(1, RELATIVE_STD), rel=1e-4)
    assert sharp.damping_ratio == pytest.approx(at_peak[1], rel=1e-4)
    assert sharp.frequency_std == pytest.approx(known, rel=1e-4)


@pytest.mark.parametrize("correlation", [0.9, -0.9])
def test_a_damping_ratio_is_known_as_half_width_over_frequency_is(correlation: float) -> None:
    """Position and half width of a slow mode, each known to 5 %: where they rise together their
    quotient hardly moves. Against draws of both."""
    modes, band = two_modes()
    modes = replace(modes, positions=np.array([20.0, 60.0]), half_widths=np.array([0.4, 1.0]))
    position_std, width_std = 1.0, 0.05
    covariance = np.diag(np.full(N_MODAL, 1e-8))
    covariance[np.ix_([0, 2], [0, 2])] = [
        [position_std**2, correlation * position_std * width_std],
        [correlation * position_std * width_std, width_std**2],
    ]
    fit = WhittleFit(modes, 0.0, np.linalg.inv(covariance), np.eye(N_MODAL), converged=True)
    slow, _ = modes_of_fit(fit, band)
    normal = np.random.default_rng(5).standard_normal((2, 200_000))
    off = np.linalg.cholesky(covariance[np.ix_([0, 2], [0, 2])]) @ normal
    position, width = 20.0 + off[0], 0.4 * np.exp(off[1])
    drawn = width / np.hypot(position, width)
    assert slow.damping_ratio_std == pytest.approx(drawn.std(), rel=0.05)
