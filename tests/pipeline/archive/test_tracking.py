"""Modes of an archive are followed over hours of which nothing was recorded."""

from dataclasses import astuple

import numpy as np
import pytest

from pipeline.archive.tracking import ArchiveTracking
from pipeline.messages import FoundationTruth, ModalEstimate, WindowRejected
from tests.pipeline.example_estimates import WINDOW, estimate, mode
from tests.pipeline.example_messages import LAYOUT

SHAPE = np.linspace(0.2, 1.0, 8)


@pytest.mark.parametrize(("windows_missing", "same"), [(0, False), (12, True)])
def test_what_moves_by_a_percent_is_another_mode_at_once_and_the_same_after_two_hours(
    windows_missing: int, same: bool
) -> None:
    """Tide and temperature move a frequency meanwhile: the longer the gap, the farther."""
    tracking = ArchiveTracking(LAYOUT.channel_names, float(WINDOW))
    windows = [estimate(mode(1.0, SHAPE), number=number) for number in range(5)]
    later = estimate(mode(1.012, SHAPE), number=5 + windows_missing)
    followed = list(tracking.followed([*windows, later]))
    assert all(isinstance(each, ModalEstimate) for each in followed)
    names = [each.modes[0].name for each in followed if isinstance(each, ModalEstimate)]
    assert (names[-1] == names[0]) is same


def test_a_truth_that_several_tasks_read_is_given_once() -> None:
    tracking = ArchiveTracking(LAYOUT.channel_names, float(WINDOW))
    truths = [FoundationTruth("t1", time_ns, 1.0, 2.0, 3.0) for time_ns in (10, 10, 20, 10, 20, 30)]
    assert [each.time_ns for each in tracking.followed(truths)] == [10, 20, 30]


def followed_mode(*answers: ModalEstimate | WindowRejected) -> list[float]:
    """What is expected of the one mode of some windows, after them."""
    tracking = ArchiveTracking(LAYOUT.channel_names, float(WINDOW))
    list(tracking.followed(answers))
    (track,) = tracking.state.tracker.tracks
    return [value for value in astuple(track) if isinstance(value, float)]


def windows_at(*numbers: int) -> list[ModalEstimate]:
    return [estimate(mode(1.0, SHAPE), number=number) for number in numbers]


def test_a_gap_widens_what_is_expected_of_a_mode_for_twelve_windows_and_no_longer() -> None:
    after = {n: followed_mode(*windows_at(0, 1, 2, 3 + n)) for n in (11, 12, 13, 1000)}
    assert after[12] == after[13] == after[1000]
    assert after[11] != after[12]


def test_a_rejected_window_widens_what_is_expected_as_one_that_is_missing_does() -> None:
    before, (lost, last) = windows_at(0, 1, 2), windows_at(3, 4)
    rejected = WindowRejected("t1", 3, lost.start_ns, lost.end_ns, "nan", "no value")
    assert followed_mode(*before, rejected, last) == followed_mode(*before, last)
    assert followed_mode(*before, lost, last) != followed_mode(*before, last)
