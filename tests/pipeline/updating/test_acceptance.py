"""When a narrow interval is not to be believed."""

import pytest

from pipeline.messages import QualityWarning
from pipeline.updating.acceptance import (
    AcceptanceSettings,
    Fit,
    contradictions,
    refusal,
    unconverged,
)
from pipeline.updating.prior import UpdatingError

RIGHT = Fit(reduced_chi_square=1.1, paired_share=0.91, pairing_cost=1.4)


def test_a_right_structure_raises_no_doubt():
    assert contradictions(RIGHT, AcceptanceSettings()) == ()


@pytest.mark.parametrize(
    ("fit", "code"),
    [
        (Fit(12.0, 0.91, 1.4), "misfit"),
        (Fit(1.1, 0.6, 1.4), "few-pairs"),
        (Fit(1.1, 0.91, 4.6), "pairing-cost"),
    ],
)
def test_each_figure_alone_is_enough_to_doubt(fit, code):
    (warning,) = contradictions(fit, AcceptanceSettings())
    assert warning.code == code
    assert "expected" in warning.text


def test_a_threshold_of_zero_is_refused():
    with pytest.raises(UpdatingError, match="pairing_cost is 0"):
        AcceptanceSettings(pairing_cost=0)


def test_a_refusing_share_above_the_doubting_one_is_refused():
    with pytest.raises(UpdatingError, match=r"refused_share is 0\.9"):
        AcceptanceSettings(refused_share=0.9)


@pytest.mark.parametrize(
    ("share", "cost", "code"), [(0.2, 3.0, "few-pairs"), (0.6, 7.2, "pairing-cost")]
)
def test_modes_that_are_hardly_the_models_give_no_posterior_at_all(share, cost, code):
    refused = refusal(share, cost, AcceptanceSettings())
    assert refused is not None
    assert refused.code == code
    assert "no posterior" in refused.text


def test_a_doubtful_pairing_still_gives_a_posterior():
    assert refusal(0.6, 3.9, AcceptanceSettings()) is None


def test_chains_that_are_short_or_disagree_are_not_to_be_trusted():
    assert unconverged([QualityWarning("chain-short", "")])
    assert unconverged(
        [QualityWarning("importance-efficiency", ""), QualityWarning("not-converged", "")]
    )
    assert not unconverged([QualityWarning("importance-efficiency", "")])


def test_thresholds_stand_well_between_the_right_structures_and_the_wrong_ones():
    """What simulated hours gave (module docstring): the cost of the worst right structure is 1.3,
    of the best wrong one 2.9; a threshold near either would be crossed by the next seed."""
    settings = AcceptanceSettings()
    worst_right, best_wrong = 1.3, 2.9
    assert settings.pairing_cost / worst_right > 1.35
    assert best_wrong / settings.pairing_cost > 1.35
    assert settings.refused_cost > 4.3  # a flooded monopile is untrusted, seldom refused
    assert settings.refused_cost < 7.2  # other blades are refused
    assert settings.reduced_chi_square > 2.3
    assert settings.paired_share < 0.87
    assert 0.24 < settings.refused_share < 0.57
