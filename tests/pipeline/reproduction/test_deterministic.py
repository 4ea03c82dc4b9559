"""Eq. 6 by hand, its minimum at the truth, and every start's end reported."""

import numpy as np
import pytest

from pipeline.messages import Mode
from pipeline.modal_assurance import modal_assurance_criterion
from pipeline.reproduction.deterministic import ModalObjective, deterministic_update
from tests.pipeline.updating.small_tower import NOMINAL, SmallTower

TOWER = SmallTower()
TRUTH = np.array([1.1, 0.9, 1.05])
LABELS = tuple(str(number) for number in range(1, 9))


def exact_modes(scale: float = 1.0) -> dict[str, Mode]:
    modes = TOWER.subset(LABELS).modal((TRUTH * NOMINAL)[None])
    return {
        label: Mode(
            label, frequency, 0.0, 0.01, 0.0, scale * shape, np.zeros((len(shape) + 2, 0)), 0
        )
        for label, frequency, shape in zip(
            LABELS, modes.frequencies[0], modes.shapes[0], strict=True
        )
    }


def test_the_objective_is_the_sum_of_eq_6() -> None:
    identified = exact_modes()
    modes = TOWER.subset(LABELS).modal(NOMINAL[None])
    error = modes.frequencies[0] / [mode.frequency for mode in identified.values()] - 1
    shapes = np.array([mode.shape for mode in identified.values()])
    mac = np.diag(modal_assurance_criterion(modes.shapes[0], shapes))
    objective = ModalObjective(identified, TOWER)
    assert objective(np.ones(3)) == pytest.approx((error**2).sum() + (1 - mac).sum())


def test_the_objective_vanishes_at_the_truth_whatever_the_scale_of_the_shapes() -> None:
    assert ModalObjective(exact_modes(scale=-7.0), TOWER)(TRUTH) == pytest.approx(0, abs=1e-12)


def test_exact_modes_lead_the_simplex_from_nominal_to_the_truth() -> None:
    (descent,) = deterministic_update(ModalObjective(exact_modes(), TOWER), [1.0])
    assert descent.end == pytest.approx(TRUTH, abs=1e-4)
    assert descent.objective < 1e-8


def test_every_start_is_reported_with_its_own_end_in_the_order_given() -> None:
    objective = ModalObjective(exact_modes(), TOWER)
    descents = deterministic_update(objective, [0.25, 4.0])
    assert [descent.start.tolist() for descent in descents] == [[0.25] * 3, [4.0] * 3]
    for descent in descents:
        assert descent.objective == objective(descent.end) <= objective(descent.start)


def test_there_is_no_model_where_the_springs_are_not_positive_definite() -> None:
    assert ModalObjective(exact_modes(), TOWER)(np.array([0.5, 0.5, 1.5])) == np.inf
