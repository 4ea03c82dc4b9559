"""A restarted updater goes on as if it had never stopped, or says why it cannot."""

from dataclasses import fields, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.updating.checkpoint import STATE_VERSION, CheckpointError, _unpacked
from pipeline.updating.evidence.modal_evidence import ModalEvidence
from pipeline.updating.evidence.observations import mode_observations
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.importance import ImportanceSettings
from pipeline.updating.samplers.registry import SamplingSettings
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.state import RECENT_WINDOWS, UpdatingState
from pipeline.updating.updater import FoundationUpdater
from sensors.errors import InputError
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

SETTINGS = UpdatingSettings(
    pairing=PairingSettings(search_draws=60, tried=2, refined=1),
    sampling=SamplingSettings(importance=ImportanceSettings(effective_draws=100, pilot=100)),
    sampler=SamplerSettings(walkers=20, burn_in=10, block=20, most_steps=40),
)


def updater_of(**options) -> FoundationUpdater:
    layout = options.pop("layout", LAYOUT)
    return FoundationUpdater(options.pop("forward", LinearTower()), layout, SETTINGS, seed=1)


def estimate_of(window):
    generator = np.random.default_rng([41, window])
    return drawn_estimate(np.array([1.1, 0.9, 1.0]), generator, window=window, tower=LinearTower())


@pytest.mark.parametrize(
    ("window", "compared"), [(2, False), (RECENT_WINDOWS, True), (3 + RECENT_WINDOWS, True)]
)
def test_a_change_that_is_dated_before_all_recent_windows_has_no_period_to_compare_with(
    window, compared
):
    """The one before the event before it is none: it lacks that event's change as well."""
    nothing = ModalEvidence(channels=LAYOUT.channel_names)
    state = UpdatingState(evidence=nothing, joint=("an uncertain structure",))
    for number in range(4 + RECENT_WINDOWS):
        estimate = estimate_of(number)
        seen = mode_observations(estimate, LAYOUT.channel_names)
        state = state.with_window(estimate, seen, 0.0)
    earlier = replace(state, reference=replace(nothing, n_windows=7), reference_ns=12345)

    restarted = earlier.restarted(estimate_of(window).start_ns, nothing)

    if compared:
        assert restarted.reference.n_windows == window - 4
        assert restarted.reference_ns == estimate_of(window - 1).start_ns
    else:
        assert (restarted.reference, restarted.reference_ns) == (None, 0)


@pytest.fixture(scope="module")
def saved():
    """An updater's state after two windows, as bytes."""
    updater = updater_of()
    state = updater.initial_state()
    for window in range(2):
        state, _ = updater.updated(state, estimate_of(window))
    return updater.saved(state)


def test_a_restarted_updater_gives_the_posteriors_it_would_have_given_bit_for_bit(saved):
    whole = updater_of()
    state = whole.initial_state()
    for window in range(4):
        state, expected = whole.updated(state, estimate_of(window))
    restarted = updater_of()
    state = restarted.restored(saved)
    for window in (2, 3):
        state, continued = restarted.updated(state, estimate_of(window))
    for field in fields(expected):
        one, other = (getattr(each, field.name) for each in (expected, continued))
        if isinstance(one, np.ndarray):
            assert np.array_equal(one, other), field.name
        else:
            assert repr(one) == repr(other), field.name  # NaN, where there is no chain, equals NaN


def test_a_window_that_begins_as_the_structure_changed_counts_as_after_it():
    updater = updater_of()
    state = updater.initial_state()
    for window in range(4):
        state, _ = updater.accumulated(state, estimate_of(window))
    since = estimate_of(2).start_ns
    restarted = state.restarted(since, updater.initial_state().evidence)
    assert [each.start_ns for each in restarted.recent] == [since, estimate_of(3).start_ns]
    assert restarted.evidence.n_windows == 2


def test_a_state_in_which_nothing_was_seen_can_be_saved():
    updater = updater_of()
    state = updater.restored(updater.saved(updater.initial_state()))
    assert state.evidence.modes == ()
    assert state.ensemble is None
    assert state.evidence.channels == LAYOUT.channel_names


def test_what_is_restored_saves_to_the_same_bytes(saved):
    updater = updater_of()
    assert updater.saved(updater.restored(saved)) == saved


def test_observations_keep_the_name_that_they_have_in_earlier_checkpoints(saved):
    tree, _ = _unpacked(saved, "checkpoint")
    assert all("sightings" in window for window in tree["state"]["recent"])
    assert len(tree["state"]["recent"]) == 2


def test_a_checkpoint_is_small(saved):
    assert len(saved) < 50_000


def test_another_version_is_named_and_refused(saved):
    other = saved.replace(b" %d\n" % STATE_VERSION, b" %d\n" % (STATE_VERSION + 6), 1)
    with pytest.raises(CheckpointError, match=f"a.checkpoint has version {STATE_VERSION + 6}"):
        updater_of().restored(other, origin="a.checkpoint")


def test_another_turbines_checkpoint_is_refused_with_both_names(saved):
    layout = replace(LAYOUT, turbine="next-door")
    with pytest.raises(CheckpointError, match="'small', not of 'next-door'"):
        updater_of(layout=layout).restored(saved)


def test_a_checkpoint_under_the_other_sign_of_the_coupling_is_refused(saved):
    class Mirrored(LinearTower):
        nominal = LinearTower().nominal * [1, 1, -1]

    words = r"^checkpoint is of nominal springs .*, not of .*; start with --fresh$"
    with pytest.raises(CheckpointError, match=words):
        updater_of(forward=Mirrored()).restored(saved)


@pytest.mark.parametrize("payload", [b"", b"\n", b"pilewatch-updating 1\n", b"PK\x03\x04 zip"])
def test_a_file_that_is_no_checkpoint_says_so_in_one_line(payload):
    with pytest.raises(InputError) as raised:
        updater_of().restored(payload, origin="x")
    assert "\n" not in str(raised.value)


@given(data=st.data())
def test_a_damaged_byte_is_noticed(saved, data):
    at = data.draw(st.integers(len(b"pilewatch-updating 1\n"), len(saved) - 1))
    damaged = saved[:at] + bytes([saved[at] ^ data.draw(st.integers(1, 255))]) + saved[at + 1 :]
    with pytest.raises(CheckpointError):
        LAST.restored(damaged)


LAST = updater_of()
