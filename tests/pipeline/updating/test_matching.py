"""Which modes are compared is the pairing's affair, and the scenario's where it names them."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.evidence import EstimateRefused, ModalEvidence
from pipeline.updating.likelihood import LikelihoodSettings
from pipeline.updating.matching import Matcher
from pipeline.updating.pairing import PairingSettings
from pipeline.updating.prior import Prior, UpdatingError
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

TOWER = LinearTower()
TRUTH = np.array([1.1, 0.9, 0.95])


def matcher(**likelihood):
    return Matcher(
        TOWER,
        Prior(TOWER.nominal),
        pairing=PairingSettings(search_draws=60, tried=2, refined=1),
        likelihood=LikelihoodSettings(**likelihood),
        generator=np.random.default_rng(1),
    )


def evidence_of(n_windows):
    evidence = ModalEvidence(channels=LAYOUT.channel_names)
    generator = np.random.default_rng(2)
    for window in range(n_windows):
        estimate = drawn_estimate(TRUTH, generator, window=window, tower=TOWER)
        evidence = evidence.with_estimate(estimate)
    return evidence


def test_only_the_named_modes_are_compared_though_all_are_paired():
    match = matcher(modes=("2", "5")).matched(evidence_of(2))
    assert match.pairing.model_modes == (0, 1, 2, 3, 4, 5)
    assert match.forward.labels == ("2", "5")
    assert [each.identified for each in match.used] == [1, 4]


def test_a_mode_that_the_model_does_not_have_is_refused_by_its_name():
    with pytest.raises(UpdatingError, match=r"'12'.*1, 2, 3"):
        matcher(modes=("2", "12"))


def test_a_last_window_without_any_partner_is_refused_whatever_the_earlier_ones_said():
    evidence = evidence_of(2)
    gone = [replace(mode, last_window=1) for mode in evidence.modes]
    with pytest.raises(EstimateRefused, match="none of the 0 identified modes"):
        matcher().matched(replace(evidence, modes=tuple(gone)))
