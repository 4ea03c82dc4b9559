"""How long a mode is remembered that the windows see no more."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.mode_evidence import ModeEvidence
from pipeline.updating.evidence.observations import ModeObservation
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

DAY, WEEK, MONTH = 144, 1008, 4320  # windows of ten minutes


def seen_in(n_windows: int) -> ModeEvidence:
    observation = ModeObservation("m1", np.array([1.0, 1.0]), np.diag([1e-3, 0.0]), n_blocks=0)
    mode = ModeEvidence.empty(observation)
    return replace(mode, n_windows=n_windows, last_window=n_windows)


@pytest.mark.parametrize(
    ("n_windows", "kept_for", "gone_after"),
    [
        (1, DAY - 1, DAY + 1),  # a spurious pole: a day
        (8, WEEK, 9 * DAY),  # a mode that is seldom excited: a day for each window with it
        (10 * DAY, MONTH - 1, MONTH + 1),  # a mode of the tower: a month at most
    ],
)
def test_the_oftener_a_mode_was_seen_the_longer_it_is_waited_for(
    n_windows: int, kept_for: int, gone_after: int
) -> None:
    mode = seen_in(n_windows)
    assert not mode.forgotten(n_windows + kept_for)
    assert mode.forgotten(n_windows + gone_after)


def test_a_mode_that_wanders_far_from_its_mean_is_still_the_same_mode() -> None:
    """A tide of 3 ‰ a window and 6 % in all: three standard deviations of one window from the
    mean, one from the window before."""
    tower, evidence = LinearTower(), ModalEvidence(channels=LAYOUT.channel_names)
    for number in range(21):
        generator = np.random.default_rng(number)
        drift = np.full(6, 0.003 * number)
        estimate = drawn_estimate(
            np.ones(3), generator, window=number, tower=tower, labels=("3",), bias=drift[:1]
        )
        evidence = evidence.with_estimate(estimate)
    (mode,) = evidence.modes
    assert mode.n_windows == 21
