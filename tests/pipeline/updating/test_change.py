"""The detectors against their own definition, and what they find and leave alone."""

import numpy as np
import pytest

from pipeline.updating.change import (
    ChangeDetector,
    ChangeSettings,
    SeenFrequency,
    WatchedWindow,
    _log_each,
    _steps,
)

STDS = np.array([0.002, 0.001, 0.0008, 0.0015, 0.001])
SENSITIVITIES = np.array(
    [[0.05, 0.02, 0.0], [0.0, 0.1, 0.02], [0.08, 0.0, 0.1], [0.0, 0.05, 0.1], [0.0, 0.0, 0.0]]
)
WINDOW = 600.0  # [s]


def window_of(number, generator, *, shift=0.0, level=0.0, stds=STDS, weight=1.0):
    values = shift + 0.004 * level + stds * generator.standard_normal(len(stds))
    seen = tuple(
        SeenFrequency(i, float(v), float(s))
        for i, (v, s) in enumerate(zip(values, stds, strict=True))
    )
    return WatchedWindow(int(number * 6e11), WINDOW, seen, weight=weight, water_level=level)


def run(shifts, *, seed, settings=None, tide=0.0):
    """State after each window and the number of the first alarm, None for none."""
    detector, generator = ChangeDetector(settings), np.random.default_rng(seed)
    state = detector.initial_state()
    for number, shift in enumerate(shifts):
        level = tide * np.sin(2 * np.pi * number / 74.5)
        state = detector.updated(state, window_of(number, generator, shift=shift, level=level))
        verdict = detector.verdict(state, SENSITIVITIES, window_duration=WINDOW)
        if verdict.alarm:
            return state, verdict, number
    return state, verdict, None


def stepped(n, at, shift):
    return [shift if number >= at else np.zeros(len(STDS)) for number in range(n)]


def test_the_likelihood_ratio_of_a_step_is_that_of_the_gaussians_written_out():
    """One mode, 12 windows, a step at the eighth: p(y | step) / p(y), the mean flat in both."""
    generator = np.random.default_rng(1)
    detector, values = ChangeDetector(), 0.001 * generator.standard_normal(12)
    state = detector.initial_state()
    for number, value in enumerate(values):
        seen = (SeenFrequency(0, float(value), 0.001),)
        state = detector.updated(state, WatchedWindow(number, WINDOW, seen))
    scatter = (10 + state.scatter[0]) / (10 + state.scatter[1])
    values = values - values[0]
    after, tau = (np.arange(12) >= 8).astype(float), 0.004
    noise = scatter[0] * 0.001**2 * np.eye(12)
    wide = 1e3**2 * np.ones((12, 12))

    def log_density(covariance):
        _, logdet = np.linalg.slogdet(covariance)
        return -0.5 * (logdet + values @ np.linalg.solve(covariance, values))

    exact = log_density(noise + wide + tau**2 * np.outer(after, after)) - log_density(noise + wide)
    g, h = _steps(state, state.uncut)
    assert _log_each(g, h)[1, 8, 0] == pytest.approx(exact, abs=1e-3)


def test_alarms_come_at_most_as_often_as_the_person_allowed():
    """One in 100 windows allowed; 20 streams of 100 windows without a change."""
    settings = ChangeSettings(years_between_false_alarms=100 * WINDOW / (365.25 * 86400))
    still = [np.zeros(len(STDS))] * 100
    alarms = sum(run(still, seed=[2, s], settings=settings)[2] is not None for s in range(20))
    # both detectors together at most 1 − exp(−1) = 63 % of the streams;
    # binomial: beyond 17 of 20 once in 100
    assert alarms <= 17


def test_a_softer_foundation_is_found_called_so_and_measured():
    lost = np.array([0.0, -0.1, 0.0])
    detector = ChangeDetector()
    state, verdict, alarm = run(stepped(80, 60, SENSITIVITIES @ lost), seed=3)
    assert alarm is not None
    assert alarm <= 64
    change = detector.change(state, verdict, SENSITIVITIES)
    assert change.kind == "foundation"
    assert state.starts_ns[change.candidate] == pytest.approx(60 * 6e11, abs=6e11)
    assert np.abs(change.ratios - lost).max() < 4 * np.sqrt(np.diag(change.covariance).max())
    assert verdict.probability > 0.5


def test_a_shift_that_no_stiffness_explains_is_a_modal_drift():
    shift = np.array([0.0, 0.0, 0.0, 0.0, 0.01])
    state, verdict, alarm = run(stepped(90, 60, shift), seed=4)
    assert alarm is not None
    change = ChangeDetector().change(state, verdict, SENSITIVITIES)
    assert change.kind == "modal-drift"
    assert int(np.nanargmax(np.abs(change.shifts) / change.shift_stds)) == 4
    assert change.shifts[4] == pytest.approx(0.01, abs=0.002)


def test_a_tide_moves_every_frequency_and_is_no_change():
    _, _, alarm = run([np.zeros(len(STDS))] * 300, seed=5, tide=1.5)
    assert alarm is None


def test_one_outlying_estimate_is_no_change_however_far_it_lies():
    still = [np.zeros(len(STDS)) for _ in range(80)]
    still[60] = np.array([0.0, 0.05, 0.0, 0.0, 0.0])
    _, _, alarm = run(still, seed=6)
    assert alarm is None


def test_scatter_above_the_stated_deviation_is_learned_and_no_change():
    generator = np.random.default_rng(7)
    wild = [0.003 * generator.standard_normal(len(STDS)) for _ in range(250)]
    state, _, _ = run(wild, seed=8)
    factor = (10 + state.scatter[0]) / (10 + state.scatter[1])
    assert factor.min() > 2


def test_the_sums_stay_the_same_size_for_years():
    state, *_ = run([np.zeros(len(STDS))] * 300, seed=9)
    assert len(state.starts_ns) == ChangeSettings().candidates
    assert state.shares.sum() == pytest.approx(300)
    assert state.starts_ns == tuple(sorted(state.starts_ns))


def test_after_a_restart_the_sums_are_those_of_the_windows_since():
    detector = ChangeDetector()
    state, *_ = run([np.zeros(len(STDS))] * 30, seed=10)
    again = detector.restarted(state, 20)
    assert np.array_equal(again.information[0], state.information[21])
    assert again.starts_ns == state.starts_ns[21:]


def test_the_walking_stiffness_follows_a_foundation_that_softens_slowly():
    detector, generator = ChangeDetector(), np.random.default_rng(11)
    state = detector.initial_state()
    for number in range(120):
        lost = np.array([0.0, -0.2 * max(number - 60, 0) / 60, 0.0])
        window = window_of(number, generator, shift=SENSITIVITIES @ lost)
        state = detector.updated(state, window, SENSITIVITIES)
    assert state.walk_mean[1] < -0.05
    assert abs(state.walk_mean[0]) < 0.05
