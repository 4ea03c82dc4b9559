"""Which water levels of a first period have evidence of their own."""

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import ModeObservation, SeenWindow
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


def seen(number: int, rise: float, *, known: bool) -> SeenWindow:
    """A window of one mode, which a metre of water lowers by .4 %."""
    values = np.array([1.7 * (1 - 0.004 * rise), 1.0, 0.5])
    mode = ModeObservation("m1", values, np.diag([1.7e-3, 0.0, 0.01]), 40)
    return SeenWindow(number, 600.0, 1.0, rise if known else 0.0, (mode,), level_known=known)


@pytest.mark.parametrize("unknown", [range(0), range(12, 30)], ids=["none", "about high water"])
def test_a_window_whose_level_nothing_reported_is_at_no_level(unknown: range) -> None:
    """Taken for one at the mean level, the mode at high water moves that of the mean level."""
    rises = 1.5 * np.sin(2 * np.pi * 600 * np.arange(75) / 44714)
    windows = [seen(n, rise, known=n not in unknown) for n, rise in enumerate(rises.tolist())]
    whole, found = evidence_by_level(windows, ModalEvidence(channels=("a", "b")))
    assert whole.n_windows == 75
    assert whole.n_unknown_levels == len(unknown)
    assert sum(each.n_windows for _, each in found) == 75 - len(unknown)
    assert all(each.n_unknown_levels == 0 for _, each in found)
    shifts = [each.modes[0].frequency / 1.7 - 1 for _, each in found]
    assert shifts == pytest.approx([-0.004 * rise for rise, _ in found], abs=1e-4)


def test_where_nothing_reported_any_level_all_windows_are_one_group_of_unknown_level() -> None:
    windows = [seen(n, 0.1 * n, known=False) for n in range(10)]
    _, ((rise, group),) = evidence_by_level(windows, ModalEvidence(channels=("a", "b")))
    assert (rise, group.n_windows, group.n_unknown_levels) == (0.0, 10, 10)
