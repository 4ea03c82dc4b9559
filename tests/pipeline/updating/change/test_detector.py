"""What raises an alarm, what it is called, and what is left alone."""

import numpy as np
import pytest

from pipeline.updating.change.detector import ChangeDetector, ChangeState, Verdict
from pipeline.updating.change.likelihood_ratios import FAMILY, SHIFTS, STIFFNESS_SHIFTS
from pipeline.updating.change.settings import ChangeSettings
from pipeline.updating.change.sufficient_statistics import (
    CUT_MOMENTS,
    PRODUCTS,
    UNCUT_MOMENTS,
    WatchedWindow,
)
from pipeline.updating.prior import UpdatingError
from tests.pipeline.updating.change.streams import (
    SENSITIVITIES,
    STDS,
    STILL,
    WINDOW,
    judged,
    known_of,
    run,
    stepped,
    window_of,
)
from tests.tiers import and_at_night


@pytest.mark.parametrize("n", and_at_night(50, 100))
def test_alarms_come_at_most_as_often_as_the_person_allowed(n):
    """One in so many windows allowed; 20 streams of as many windows without a change."""
    settings = ChangeSettings(years_between_false_alarms=n * WINDOW / (365.25 * 86400))
    alarms = sum(run([STILL] * n, seed=[2, s], settings=settings)[2] is not None for s in range(20))
    # at most 1 − exp(−1) = 63 % of the streams; binomial: beyond 17 of 20 once in 100
    assert alarms <= 17


LOST = np.array([0.0, -0.1, 0.0])  # a tenth of k22
SOFTENED = SENSITIVITIES.stiffness @ LOST + [0, 0, 0, 0, -0.006]  # the last one is not the model's


def test_a_softer_foundation_is_found_within_an_hour():
    _, verdict, alarm = run(stepped(80, 60, SOFTENED), seed=3)
    assert alarm is not None
    assert alarm <= 65
    assert verdict.probability > 0.5


def test_a_softer_foundation_is_called_so_and_measured_although_unknown_modes_move_with_it():
    change, state = judged(stepped(70, 60, SOFTENED), seed=14)
    assert change.kind == "foundation"
    assert state.sums.starts_ns[change.candidate] == pytest.approx(60 * 6e11, abs=6e11)
    stds = np.sqrt(np.diag(change.step.covariance))
    assert np.all(np.abs(change.step.ratios - LOST) < 4 * stds)
    assert stds.max() < 0.02


@pytest.mark.parametrize("n_after", [6, 60])
def test_a_shift_of_one_mode_alone_is_a_modal_drift_however_sure_it_is(n_after):
    """6 windows and 60, by when one mode's likelihood ratio has a thousand nats; twelve streams."""
    shift = np.array([0.0, 0.0, 0.0, 0.0, 0.01])
    shifts = stepped(60 + n_after, 60, shift)
    changes = [judged(shifts, seed=[4, stream])[0] for stream in range(12)]
    kinds = [change.kind for change in changes]
    assert "foundation" not in kinds
    assert kinds.count("modal-drift") >= 9
    for change in changes:
        assert int(np.nanargmax(np.abs(change.shifts) / change.shift_stds)) == 4
        assert change.shifts[4] == pytest.approx(0.01, abs=0.002)


def test_a_tide_moves_every_frequency_and_is_no_change():
    _, _, alarm = run([STILL] * 300, seed=5, tide=1.5)
    assert alarm is None


def test_one_outlying_estimate_is_no_change_however_far_it_lies():
    still = [STILL] * 80
    still[60] = np.array([0.0, 0.05, 0.0, 0.0, 0.0])
    _, _, alarm = run(still, seed=6)
    assert alarm is None


def test_after_a_restart_the_sums_are_those_of_the_windows_since():
    state, *_ = run([STILL] * 30, seed=10)
    again = ChangeDetector().restarted(state, 20)
    kept = state.sums.segments[:, 20:]
    assert np.array_equal(again.sums.segments[PRODUCTS], kept[PRODUCTS])
    assert np.array_equal(again.sums.segments[UNCUT_MOMENTS], kept[UNCUT_MOMENTS])
    assert np.array_equal(again.sums.segments[CUT_MOMENTS], kept[UNCUT_MOMENTS])
    assert again.sums.starts_ns == state.sums.starts_ns[20:]


def test_a_window_that_saw_nothing_changes_nothing():
    state, *_ = run([STILL] * 3, seed=11)
    assert ChangeDetector().updated(state, WatchedWindow(0, WINDOW, ())) is state


def drawn_change(generator):
    """A change as the detector expects it: whether of the foundation, and the shifts of ln f; the
    mode that the model lacks is as sensitive as the others are on average."""
    if generator.random() < 0.5:
        size = generator.choice(STIFFNESS_SHIFTS)
        shift = SENSITIVITIES.stiffness @ (size * generator.standard_normal(3))
        typical = np.sqrt((SENSITIVITIES.stiffness[:4] ** 2).sum(axis=1).mean())
        shift[4] = size * typical * generator.standard_normal()
        return True, shift
    moved = generator.random(len(STDS)) < generator.choice([1 / len(STDS), FAMILY, 1.0])
    return False, moved * generator.choice(SHIFTS) * generator.standard_normal(len(STDS))


@pytest.mark.parametrize("trials", and_at_night(range(100), range(200)))
def test_of_changes_called_the_foundations_with_a_probability_that_share_is_one(trials):
    """Of 100 changes (by night 200) drawn as expected beforehand, six to fifteen of 25 windows ago,
    those that can be seen; what cannot has no most probable start either."""
    detector, stated, truths = ChangeDetector(), [], []
    for trial in trials:
        generator = np.random.default_rng([12, trial])
        foundation, shift = drawn_change(generator)
        state, begun = ChangeState(), generator.integers(10, 20)
        for number in range(25):
            window = window_of(number, generator, shift=shift * (number >= begun))
            state = detector.updated(state, window, known_of(state))
        verdict = detector.verdict(state, SENSITIVITIES, window_duration=WINDOW)
        if verdict.log_total < np.log(1000.0):
            continue
        stated.append(detector.change(state, verdict, SENSITIVITIES).foundation_probability)
        truths.append(foundation)
    stated, truths = np.array(stated), np.array(truths)
    for low, high in ((0.0, 0.2), (0.2, 0.8), (0.8, 1.0)):
        chosen = (stated >= low) & (stated <= high)
        expected = stated[chosen].mean()
        error = np.sqrt(max(expected * (1 - expected), 0.02) / chosen.sum())
        assert truths[chosen].mean() == pytest.approx(expected, abs=2.6 * error)


def test_a_shift_that_says_too_little_is_left_undecided():
    """Two modes that one spring would move alike, by little: nobody can tell."""
    shift = np.array([0.0, 0.0, 0.004, 0.004, 0.0])
    settings = ChangeSettings(years_between_false_alarms=0.02, certainty=0.999)
    state, verdict, alarm = run(stepped(70, 60, shift), seed=13, settings=settings)
    assert alarm is not None
    change = ChangeDetector(settings).change(state, verdict, SENSITIVITIES)
    assert change.kind == "undecided"
    assert 0.001 < change.foundation_probability < 0.999


@pytest.mark.parametrize(
    ("settings", "told"),
    [
        ({"years_between_false_alarms": 0.0}, "positive; one is 0.0"),
        ({"certainty": 0.4}, "certainty is 0.4"),
        ({"candidates": 3}, "candidates is 3"),
    ],
)
def test_settings_that_make_no_sense_are_told(settings, told):
    with pytest.raises(UpdatingError, match=told):
        ChangeSettings(**settings)


@pytest.mark.parametrize("duration", [600.0, 1800.0])
def test_the_changes_expected_in_a_year_of_windows_are_those_of_the_settings(duration):
    settings = ChangeSettings(changes_per_year=3.0)
    detector, generator = ChangeDetector(settings), np.random.default_rng(61)
    state = detector.updated(ChangeState(), window_of(0, generator), None)
    verdict = detector.verdict(state, known_of(state), window_duration=duration)
    windows_in_a_year = 365.25 * 86400 / duration
    assert verdict.hazard * windows_in_a_year == pytest.approx(3.0, rel=2e-3)


def test_the_chance_of_a_change_is_bayes_rule_on_the_hazard_and_the_ratio():
    """Odds = hazard × R: where the windows say nothing, R = 1 and the hazard is left."""
    verdict = Verdict(np.log(np.full((2, 1), 0.5)), log_threshold=5.0, hazard=0.01)
    assert verdict.probability == pytest.approx(0.01 / 1.01)
    assert not verdict.alarm
    loud = Verdict(np.log(np.full((2, 1), 500.0)), log_threshold=5.0, hazard=0.01)
    assert loud.probability == pytest.approx(10 / 11)
    assert loud.alarm
