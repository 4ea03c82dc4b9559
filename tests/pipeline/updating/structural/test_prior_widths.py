"""What the width of a figure's posterior is compared with: its prior's, by another route."""

import numpy as np
import pytest
from scipy.stats import norm

from pipeline.updating.structural.joint_message import HALF_NORMAL_90, NORMAL_90


def test_the_widths_of_both_priors_are_those_of_their_quantiles() -> None:
    """Of |x| with x normal, P(|x| < q) = 2 Φ(q) − 1."""
    assert pytest.approx(2 * norm.isf(0.05)) == NORMAL_90
    assert pytest.approx(norm.ppf(0.975) - norm.ppf(0.525)) == HALF_NORMAL_90


def test_the_widths_of_both_priors_are_those_of_draws() -> None:
    drawn = np.random.default_rng(3).standard_normal(400_000)
    assert np.ptp(np.quantile(drawn, [0.05, 0.95])) == pytest.approx(NORMAL_90, rel=5e-3)
    folded = np.quantile(abs(drawn), [0.05, 0.95])
    assert np.ptp(folded) == pytest.approx(HALF_NORMAL_90, rel=5e-3)
