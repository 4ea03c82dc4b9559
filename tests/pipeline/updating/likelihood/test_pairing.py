"""Which model mode an identified mode is, found from the whole prior."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.likelihood.pairing import (
    PairingSearch,
    PairingSettings,
    PairingTargets,
    assigned,
    macs,
)
from pipeline.updating.prior import Prior, UpdatingError
from tests.pipeline.updating.small_tower import (
    LAYOUT,
    NOMINAL,
    SmallTower,
    drawn_estimate,
    drawn_mode,
)

TOWER = SmallTower()


@pytest.fixture(scope="module")
def search():
    settings = PairingSettings(search_draws=200)
    return PairingSearch(TOWER, Prior(NOMINAL), settings, np.random.default_rng(0))


def targets_of(estimate):
    evidence = ModalEvidence(channels=LAYOUT.channel_names).with_estimate(estimate)
    return PairingTargets.of(evidence.modes, 1), [mode.frequency for mode in evidence.modes]


def true_labels(ratios, frequencies):
    """The label of the true mode nearest to each identified frequency."""
    model = TOWER.modal((ratios * NOMINAL)[None]).frequencies[0]
    return [int(np.argmin(np.abs(np.log(model / each)))) for each in frequencies]


def test_a_foundation_anywhere_in_the_box_is_paired_without_a_wrong_pair(search):
    generator = np.random.default_rng(1)
    for ratios in Prior(NOMINAL).draws(12, generator):
        estimate = drawn_estimate(ratios, generator)
        targets, frequencies = targets_of(estimate)
        pairing = search.best(targets)
        close = np.diff(sorted(frequencies)).min() < 0.01 * min(frequencies)
        if not close:  # two true modes within 1 %: the nearest frequency is no judge
            assert list(pairing.model_modes) == true_labels(ratios, frequencies)


def test_missing_modes_leave_the_others_rightly_paired(search):
    generator = np.random.default_rng(2)
    ratios = np.array([0.85, 1.2, 0.95])
    estimate = drawn_estimate(ratios, generator, labels=("2", "3", "5", "6", "8"))
    targets, frequencies = targets_of(estimate)
    assert list(search.best(targets).model_modes) == true_labels(ratios, frequencies)


def test_spurious_modes_are_left_alone(search):
    generator = np.random.default_rng(3)
    ratios = np.array([1.2, 0.85, 0.9])
    estimate = drawn_estimate(ratios, generator)
    spurious = [
        drawn_mode(frequency, generator.standard_normal(8), generator, 0.001, 0.02)
        for frequency in (0.9, 3.1, 7.4)
    ]
    modes = sorted([*estimate.modes, *spurious], key=lambda mode: mode.frequency)
    targets, frequencies = targets_of(replace(estimate, modes=tuple(modes)))
    pairing = search.best(targets)
    alone = [f for f, mode in zip(frequencies, pairing.model_modes, strict=True) if mode < 0]
    assert alone == pytest.approx([0.9, 3.1, 7.4], rel=0.01)
    assert pairing.paired_share == pytest.approx(12 / 15)


def test_a_wrong_start_cannot_win_against_the_search(search):
    generator = np.random.default_rng(4)
    ratios = np.array([1.0, 1.0, 1.0])
    targets, _ = targets_of(drawn_estimate(ratios, generator))
    assert search.best(targets, start=np.array([3.5, 0.5, 0.3])).model_modes == (
        search.best(targets).model_modes
    )


def test_the_refined_stiffness_lies_near_the_truth(search):
    ratios = np.array([0.9, 1.1, 1.0])
    targets, _ = targets_of(drawn_estimate(ratios, np.random.default_rng(5)))
    assert search.best(targets).ratios == pytest.approx(ratios, rel=0.1)


def test_ways_downhill_are_the_same_alone_as_together(search):
    targets, _ = targets_of(
        drawn_estimate(np.array([0.9, 1.1, 1.0]), np.random.default_rng(186003))
    )
    starts = np.array([[3.5, 0.5, 0.3], [0.5, 2.0, 0.9], [0.95, 1.05, 1.0]])
    together = search._followed(targets, starts, (0.03, 0.004))
    for start, end in zip(starts, together, strict=True):
        (alone,) = search._followed(targets, start[None], (0.03, 0.004))
        assert alone.ratios == pytest.approx(end.ratios, rel=1e-9)


def test_a_pair_that_costs_more_than_a_rejection_is_never_made():
    targets, _ = targets_of(drawn_estimate(np.ones(3), np.random.default_rng(6), labels=("3", "4")))
    costs = np.array([[1.0, 0.5], [20.0, 0.1]])
    pairing = assigned(costs, targets, np.ones(3), rejection=9.0)
    assert pairing.model_modes == (0, 1)
    pairing = assigned(costs + 9.0, targets, np.ones(3), rejection=9.0)
    assert pairing.model_modes == (-1, -1)
    assert pairing.cost == 9.0


@pytest.mark.parametrize(("mac", "partner"), [(0.6, 0), (0.5, -1)])
def test_a_mode_three_standard_deviations_off_is_left_alone(mac: float, partner: int) -> None:
    """1 − MAC of .45 is three times .15: at one frequency, a MAC of .6 still makes a pair."""
    targets, _ = targets_of(drawn_estimate(np.ones(3), np.random.default_rng(6), labels=("3",)))
    settings = PairingSettings()
    costs = np.array([[((1 - mac) / settings.mac_scale) ** 2]])
    pairing = assigned(costs, targets, np.ones(3), rejection=settings.rejection)
    assert pairing.model_modes == (partner,)


def test_the_cheapest_sum_is_taken_rather_than_the_cheapest_pair_first():
    targets, _ = targets_of(drawn_estimate(np.ones(3), np.random.default_rng(7), labels=("3", "4")))
    pairing = assigned(np.array([[0.0, 1.0], [0.5, 8.0]]), targets, np.ones(3), rejection=9.0)
    assert pairing.model_modes == (1, 0)


def test_a_mode_beyond_the_models_reach_is_not_held_against_the_model(search):
    generator = np.random.default_rng(8)
    estimate = drawn_estimate(np.ones(3), generator)
    beyond = drawn_mode(60.0, generator.standard_normal(8), generator, 0.001, 0.02)
    evidence = ModalEvidence(channels=LAYOUT.channel_names).with_estimate(
        replace(estimate, modes=(*estimate.modes, beyond))
    )
    targets = PairingTargets.of(evidence.modes, 1, reach=40.0)
    assert search.best(targets).paired_share == 1.0


def test_absent_channels_do_not_enter_the_mac():
    shapes = np.random.default_rng(9).standard_normal((1, 2, 8))
    targets = PairingTargets(
        log_frequencies=np.zeros(1),
        shapes=np.where(np.arange(8) < 5, shapes[0, :1], 0.0),
        available=(np.arange(8) < 5).astype(float)[None],
        weights=np.ones(1),
        judged=np.ones(1),
    )
    assert macs(targets, shapes)[0, 0, 0] == pytest.approx(1.0)


def test_settings_that_cannot_pair_anything_are_refused():
    with pytest.raises(UpdatingError, match="positive"):
        PairingSettings(tolerances=(0.03, 0.0))
