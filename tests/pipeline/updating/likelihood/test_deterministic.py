"""Eq. 6 by hand, its minimum at the truth, and every start's end reported."""

import numpy as np
import pytest

from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.updating.likelihood.deterministic import (
    DescentSettings,
    IdentifiedModes,
    ModalObjective,
    deterministic_update,
)
from pipeline.updating.prior import Prior, UpdatingError
from tests.pipeline.updating.small_tower import NOMINAL, SmallTower

TOWER = SmallTower()
PRIOR = Prior(NOMINAL)
TRUTH = np.array([1.1, 0.9, 1.05])
CHANNELS = np.arange(len(TOWER.layout.channels))
LABELS = tuple(str(number) for number in range(1, 9))


def exact_modes(ratios=TRUTH, labels=LABELS, scale=1.0):
    modes = TOWER.subset(labels).modal((ratios * NOMINAL)[None])
    return IdentifiedModes(tuple(labels), modes.frequencies[0], modes.shapes[0] * scale, CHANNELS)


def test_the_objective_is_the_sum_of_eq_6():
    identified = exact_modes()
    modes = TOWER.subset(LABELS).modal(NOMINAL[None])
    error = modes.frequencies[0] / identified.frequencies - 1
    mac = np.diag(modal_assurance_criterion(modes.shapes[0], identified.shapes))
    objective = ModalObjective(identified, TOWER)
    assert objective(np.ones(3)) == pytest.approx((error**2).sum() + (1 - mac).sum())


def test_the_objective_vanishes_at_the_truth_whatever_the_scale_of_the_shapes():
    for pairing in ("label", "mac"):
        assert ModalObjective(exact_modes(scale=-7.0), TOWER, pairing=pairing)(
            TRUTH
        ) == pytest.approx(0, abs=1e-12)


def test_exact_modes_lead_the_simplex_from_nominal_to_the_truth():
    (descent,) = deterministic_update(ModalObjective(exact_modes(), TOWER), PRIOR, [1.0])
    assert descent.converged
    assert descent.end == pytest.approx(TRUTH, abs=1e-4)
    assert descent.objective < 1e-8 < descent.start_objective


def test_every_start_is_reported_with_its_own_end_in_the_order_given():
    objective = ModalObjective(exact_modes(), TOWER)
    starts = [0.25, 1.0, 4.0, (1.0, 0.9, 1.2)]
    descents = deterministic_update(objective, PRIOR, starts)
    assert [tuple(descent.start) for descent in descents] == [
        (0.25, 0.25, 0.25),
        (1.0, 1.0, 1.0),
        (4.0, 4.0, 4.0),
        (1.0, 0.9, 1.2),
    ]
    for descent in descents:
        assert descent.objective == objective(descent.end) <= descent.start_objective


def test_a_bounded_simplex_stays_in_the_prior_s_box():
    far = exact_modes(np.array([6.0, 6.0, 6.0]))
    settings = DescentSettings(bounded=True)
    (descent,) = deterministic_update(ModalObjective(far, TOWER), PRIOR, [4.0], settings)
    assert descent.end.max() <= 4.0
    assert descent.end.min() >= 0.25


def test_pairing_by_mac_does_not_care_what_the_modes_are_called():
    identified = exact_modes()
    shuffled = IdentifiedModes(
        identified.labels[::-1], identified.frequencies, identified.shapes, CHANNELS
    )
    by_mac = ModalObjective(shuffled, TOWER, pairing="mac")
    assert by_mac(TRUTH) == pytest.approx(0, abs=1e-12)
    assert by_mac.pairs(TRUTH) == LABELS
    assert ModalObjective(shuffled, TOWER)(TRUTH) > 0.1


def test_there_is_no_model_where_the_springs_are_not_positive_definite():
    objective = ModalObjective(exact_modes(), TOWER)
    impossible = np.array([0.5, 0.5, 1.5])
    assert objective(impossible) == np.inf
    assert objective.pairs(impossible) == ()
    with pytest.raises(UpdatingError, match=r"1\.5"):
        deterministic_update(objective, PRIOR, [impossible])


def test_a_channel_that_was_not_measured_is_left_out_of_the_mac():
    identified = exact_modes()
    fewer = IdentifiedModes(
        identified.labels, identified.frequencies, identified.shapes[:, 2:], CHANNELS[2:]
    )
    assert ModalObjective(fewer, TOWER)(TRUTH) == pytest.approx(0, abs=1e-12)


@pytest.mark.parametrize(
    ("start", "settings", "word"),
    [
        ((1.0, 1.0), DescentSettings(), "three ratios"),
        (5.0, DescentSettings(bounded=True), "5.0"),
        ((1.0, float("nan"), 1.0), DescentSettings(), "nan"),
    ],
)
def test_a_start_that_cannot_be_used_is_refused_with_its_value(start, settings, word):
    with pytest.raises(UpdatingError, match=word):
        deterministic_update(ModalObjective(exact_modes(), TOWER), PRIOR, [start], settings)


def test_modes_that_the_model_does_not_have_are_named():
    identified = exact_modes()
    foreign = IdentifiedModes(
        (*LABELS[:-1], "flap"), identified.frequencies, identified.shapes, CHANNELS
    )
    with pytest.raises(UpdatingError, match="flap"):
        ModalObjective(foreign, TOWER)


def test_identified_modes_without_frequency_or_shape_are_refused():
    with pytest.raises(UpdatingError, match="nan"):
        IdentifiedModes(("1",), np.array([np.nan]), np.ones((1, len(CHANNELS))), CHANNELS)
    with pytest.raises(UpdatingError, match="form"):
        IdentifiedModes(("1",), np.array([1.0]), np.ones((1, 2)), CHANNELS)
