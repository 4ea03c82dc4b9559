"""Which water levels of a first period have evidence of their own."""

import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import SeenWindow
from pipeline.updating.structural.periods.calibration import evidence_by_level


@pytest.mark.parametrize(
    ("low", "high", "levels"),
    [(3, 3, [(0.0, 3), (2.0, 3)]), (2, 4, [(2.0, 4)]), (2, 0, [(0.0, 2)])],
    ids=["three windows each", "too few at low water", "two windows in all"],
)
def test_a_water_level_has_evidence_of_its_own_by_three_windows(
    low: int, high: int, levels: list[tuple[float, int]]
) -> None:
    rises = [0.0] * low + [2.0] * high
    windows = [SeenWindow(n, 600.0, 1.0, rise, ()) for n, rise in enumerate(rises)]
    whole, found = evidence_by_level(windows, ModalEvidence(channels=("top",)))
    assert whole.n_windows == len(windows)
    assert [(rise, each.n_windows) for rise, each in found] == levels
