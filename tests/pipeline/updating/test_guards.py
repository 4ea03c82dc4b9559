"""When a narrow interval is not to be believed."""

import pytest

from pipeline.updating.guards import Fit, GuardSettings, contradictions
from pipeline.updating.prior import UpdatingError

RIGHT = Fit(reduced_chi_square=1.1, paired_share=0.91, pairing_cost=1.4)


def test_a_right_structure_raises_no_doubt():
    assert contradictions(RIGHT, GuardSettings()) == ()


@pytest.mark.parametrize(
    ("fit", "code"),
    [
        (Fit(12.0, 0.91, 1.4), "misfit"),
        (Fit(1.1, 0.6, 1.4), "few-pairs"),
        (Fit(1.1, 0.91, 4.6), "pairing-cost"),
    ],
)
def test_each_figure_alone_is_enough_to_doubt(fit, code):
    (doubt,) = contradictions(fit, GuardSettings())
    assert doubt.code == code
    assert "expected" in doubt.text


def test_a_threshold_of_zero_is_refused():
    with pytest.raises(UpdatingError, match="pairing_cost is 0"):
        GuardSettings(pairing_cost=0)
