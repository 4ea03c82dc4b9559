"""The size of a change: the model's frequencies before and after it, read back as stiffness."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from pipeline.messages import StiffnessChange
from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.event_message import (
    TrackSensitivity,
    _sentence,
    _stiffness_changes,
    measured_half_way,
    sensitivities_of,
    stiffness_slopes,
)
from pipeline.updating.change.likelihood_ratios import StiffnessStep
from pipeline.updating.change.sufficient_statistics import SeenFrequency, WatchedWindow
from pipeline.updating.prior import Prior
from tests.pipeline.updating.small_tower import NOMINAL, SmallTower

TOWER = SmallTower()
PRIOR = Prior(NOMINAL)
BEFORE = np.array([1.1, 0.9, 0.95])
LOST = np.array([0.0, -0.09, 0.0])  # a tenth of k22
PAIRS = tuple(
    TrackSensitivity(track, label, slopes, np.zeros(2))
    for track, (label, slopes) in enumerate(
        zip(TOWER.labels, stiffness_slopes(TOWER, PRIOR, BEFORE), strict=True)
    )
)
DETECTOR = ChangeDetector()


def log_frequencies(ratios):
    """(12,)"""
    return np.log(TOWER.modal(PRIOR.stiffness(ratios)[None]).frequencies[0])


def measured(generator, *, std, n_before=12, n_after=3, lost=LOST):
    """The change found in drawn windows, by the slopes before it and half way."""
    state = ChangeState()
    for number in range(n_before + n_after):
        truth = log_frequencies(BEFORE + lost * (number >= n_before))
        values = truth + std * generator.standard_normal(len(truth))
        seen = tuple(SeenFrequency(j, float(v), std) for j, v in enumerate(values))
        known = sensitivities_of(state.sums.tracks, PAIRS)
        state = DETECTOR.updated(state, WatchedWindow(int(number * 6e11), 600.0, seen), known)
    known = sensitivities_of(state.sums.tracks, PAIRS)
    found = DETECTOR.change(state, DETECTOR.verdict(state, known, window_duration=600.0), known)
    return found, measured_half_way(
        found, state, DETECTOR, TOWER, PRIOR, before=BEFORE, pairs=PAIRS
    )


def test_without_noise_the_size_is_that_of_the_model_and_by_the_slopes_before_it_is_not():
    straight, half_way = measured(np.random.default_rng(31), std=1e-6)
    assert half_way.step.ratios == pytest.approx(LOST, abs=0.001)
    assert abs(straight.step.ratios[1] - LOST[1]) > 0.005
    assert half_way.candidate == straight.candidate == 12


def test_the_interval_of_the_size_holds_it_as_often_as_it_says():
    """90 % of 100 streams for each spring; binomial: outside 82 to 97 once in 100."""
    inside, errors = [], []
    for seed in range(100):
        _, found = measured(np.random.default_rng([32, seed]), std=0.001)
        stds = np.sqrt(np.diag(found.step.covariance))
        errors.append((found.step.ratios - LOST) / stds)
        inside.append(np.abs(errors[-1]) < 1.6449)
    assert np.all(np.sum(inside, axis=0) >= 82)
    assert np.all(np.sum(inside, axis=0) <= 97)
    assert np.mean(errors, axis=0) == pytest.approx(0, abs=0.3)  # three of their own std


def test_a_change_after_which_nothing_could_stand_keeps_its_first_size():
    """Nearly all of k22 gone: k12 would couple more than the springs hold."""
    lost = StiffnessStep(np.array([0.0, -0.85, 0.0]), np.eye(3))
    found = replace(measured(np.random.default_rng(33), std=1e-4)[0], step=lost)
    state = ChangeState()
    again = measured_half_way(found, state, DETECTOR, TOWER, PRIOR, before=BEFORE, pairs=PAIRS)
    assert again is found


def test_slopes_that_one_track_lacks_half_way_leave_the_size_as_it_was():
    """Where one of the modes has no slope there, no size is made of NaN."""

    def lacking(modes, prior, ratios):
        slopes = stiffness_slopes(modes, prior, ratios)
        if not np.array_equal(ratios, BEFORE):
            slopes[0] = np.nan
        return slopes

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("pipeline.updating.change.event_message.stiffness_slopes", lacking)
        straight, half_way = measured(np.random.default_rng(31), std=1e-4)
    np.testing.assert_array_equal(half_way.step.ratios, straight.step.ratios)


def test_a_change_is_a_share_of_the_spring_before_it_with_its_90_percent_interval() -> None:
    ratios, stds = np.array([0.11, -0.09, 0.19]), np.array([0.01, 0.02, 0.03])
    step = SimpleNamespace(ratios=ratios, covariance=np.diag(stds**2))
    found = _stiffness_changes(SimpleNamespace(step=step), ChangeState(), BEFORE)
    for place, each in enumerate(found):
        centre, reach = ratios[place] / BEFORE[place], 1.6449 * stds[place] / BEFORE[place]
        assert each.median == pytest.approx(centre)
        assert [each.p05, each.p95] == pytest.approx([centre - reach, centre + reach], rel=1e-3)
    assert [each.name for each in found] == ["k11", "k22", "k12"]


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("foundation", "the foundation has changed {since}: k22 -9.0% (-12.0% to -6.0%)"),
        (
            "modal-drift",
            "the modes have changed {since}, in a way that no foundation explains; most of all the "
            "one at 1.1 Hz, by -1.20%",
        ),
        (
            "modes",
            "the modes have changed {since}, most of all the one at 1.1 Hz, by -1.20%; that it was "
            "the foundation has a probability of 0.35, and would then be k22 -9.0% (-12.0% to "
            "-6.0%)",
        ),
    ],
)
def test_an_event_is_a_sentence_with_its_time_its_probability_and_its_size(kind, text):
    """Of three modes one moved by ten and one by two of its std; one was not seen."""
    change = SimpleNamespace(
        kind=kind,
        foundation_probability=0.351,
        shifts=np.log1p([-0.012, 0.002, np.nan]),
        shift_stds=np.array([0.0012, 0.001, 0.001]),
        log_frequencies=np.log([1.1, 2.57, 3.0]),
    )
    size = StiffnessChange("k22", -0.09, -0.12, -0.06, -0.09, 0.02)
    window = SimpleNamespace(end_ns=int(7200e9), window=12)
    since = "since about 90 min before the end of window 12 with probability 0.998"
    found = _sentence(change, [size], SimpleNamespace(probability=0.998), window, int(1800e9))
    assert found == text.format(since=since)
