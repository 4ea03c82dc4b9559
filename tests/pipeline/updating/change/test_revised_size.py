"""The size of a change by all windows since, against the truth of drawn streams."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.updating.change.detector import ChangeDetector, ChangeState
from pipeline.updating.change.event_message import TrackSensitivity
from pipeline.updating.change.revised_size import BeforeEvent, relative_change, revised_step
from tests.pipeline.updating.change.streams import (
    SENSITIVITIES,
    known_of,
    level_at,
    window_of,
)
from tests.tiers import and_at_night

NOTHING_MOVED = np.ones(3)
SOFTENED = np.array([0.0, -0.1, 0.0])
SHIFT = SENSITIVITIES.stiffness @ SOFTENED
PAIRS = tuple(
    TrackSensitivity(track, str(track), SENSITIVITIES.stiffness[track], np.zeros(2))
    for track in range(5)
)


def event_and_after(seed, n_after, tide=1.0):
    """Forty windows before a change of k22, and the sums of those since."""
    detector, generator = ChangeDetector(), np.random.default_rng(seed)
    state = ChangeState()
    for number in range(43):
        shift = SHIFT if number >= 40 else 0.0
        window = window_of(number, generator, shift=shift, level=level_at(number, tide))
        state = detector.updated(state, window, known_of(state))
    candidate = state.sums.starts_ns.index(int(40 * 6e11))
    earlier = BeforeEvent.of(state.sums, candidate, PAIRS, NOTHING_MOVED)
    state = detector.restarted(state, candidate)
    for number in range(43, 43 + n_after):
        window = window_of(number, generator, shift=SHIFT, level=level_at(number, tide))
        state = detector.updated(state, window, known_of(state))
    return earlier, state.sums


def revised(seed, n_after, tide=1.0):
    earlier, since = event_and_after(seed, n_after, tide)
    step = revised_step(earlier, since, PAIRS)
    assert step is not None
    return relative_change(earlier, step)


@pytest.mark.parametrize("seeds", and_at_night(range(10), range(20)))
def test_more_windows_make_the_size_surer_and_it_stays_right(seeds):
    first = [revised(seed, 0, tide=0.0) for seed in seeds]
    later = [revised(seed, 33, tide=0.0) for seed in seeds]
    assert np.mean([std[1] for _, std in later]) < 0.6 * np.mean([std[1] for _, std in first])
    tidal = [revised(seed, 33) for seed in seeds]
    z = np.array([(log - np.log(1 + SOFTENED)) / std for log, std in tidal])
    assert 0.75 < np.sqrt(np.mean(z**2)) < 1.25
    assert np.abs(np.mean([log[1] for log, _ in tidal]) - np.log(0.9)) < 0.005


def test_a_tide_that_no_model_knows_is_taken_out_of_both_sides():
    still, tidal = revised(3, 33, tide=0.0), revised(3, 33, tide=2.0)
    assert abs(still[0][1] - tidal[0][1]) < 2 * tidal[1][1]


def test_a_size_is_less_sure_where_the_level_follows_from_the_modes_or_the_model_is_rough():
    earlier, since = event_and_after(3, 12)
    watered = tuple(replace(each, water=np.array([-0.003, 0.0])) for each in PAIRS)
    surely, in_water, roughly = (
        revised_step(earlier, since, pairs, rough=rough, level_std=level_std)
        for pairs, rough, level_std in (
            (PAIRS, False, 0.0),
            (watered, False, 1.0),
            (PAIRS, True, 0.0),
        )
    )
    for each in (in_water, roughly):
        wider = np.sqrt(np.diag(each.covariance) / np.diag(surely.covariance))
        assert wider.max() > 1.3
        assert wider.min() > 0.9


def test_modes_that_were_not_seen_before_leave_nothing_to_compare():
    earlier, since = event_and_after(5, 3)
    strangers = BeforeEvent(
        tuple(track + 100 for track in earlier.tracks),
        earlier.sums,
        earlier.reference,
        earlier.pairs,
        earlier.ratios,
        earlier.end_ns,
    )
    assert revised_step(strangers, since, PAIRS) is None
    assert revised_step(earlier, ChangeState().sums, PAIRS) is None
