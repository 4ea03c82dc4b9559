"""The updating node between two messages."""

from dataclasses import replace

import numpy as np
import pytest

from pipeline.messages import (
    FoundationPosterior,
    ModalEstimate,
    QualityWarning,
    StreamEnd,
    UnitOrigin,
    WindowRejected,
)
from pipeline.nodes.operating_state import CHANGING, OperationSettings
from pipeline.nodes.updating import MOST_DIFFERENT, TurbineUpdating, UpdatingNode
from pipeline.updating.likelihood.pairing import PairingSettings
from pipeline.updating.samplers.emcee_sampler import SamplerSettings
from pipeline.updating.samplers.importance import ImportanceSettings
from pipeline.updating.samplers.registry import SamplingSettings
from pipeline.updating.settings import UpdatingSettings
from pipeline.updating.updater import FoundationUpdater
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate

SETTINGS = UpdatingSettings(
    pairing=PairingSettings(search_draws=60, refined=2),
    sampling=SamplingSettings(importance=ImportanceSettings(effective_draws=100, pilot=100)),
    sampler=SamplerSettings(burn_in=10, block=20, most_steps=60),
)


def node_of(seed=1) -> TurbineUpdating:
    return TurbineUpdating(FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=seed))


def estimate_of(window):
    generator = np.random.default_rng([4, window])
    return drawn_estimate(np.array([1.1, 0.9, 1.0]), generator, window=window, tower=LinearTower())


def test_each_estimate_is_answered_with_one_posterior_of_all_windows_so_far():
    node = node_of()
    answers = [list(node.handle(estimate_of(window))) for window in range(2)]
    assert [[each.n_windows for each in answer] for answer in answers] == [[1], [2]]


def test_a_rejected_estimate_lets_the_last_posterior_stand():
    node = node_of()
    list(node.handle(estimate_of(0)))
    before = node.state
    (answer,) = node.handle(replace(estimate_of(1), modes=()))
    assert isinstance(answer, WindowRejected)
    assert node.state is before
    (answer,) = node.handle(estimate_of(2))
    assert isinstance(answer, FoundationPosterior)
    assert answer.n_windows == 2


def test_an_estimate_by_which_the_updating_fails_is_rejected_and_the_next_is_used(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """An error ended the node, and did so again at every start with the same estimate."""
    node = node_of()
    before = node.state
    with monkeypatch.context() as patched:
        patched.setattr(FoundationUpdater, "watched", lambda *_: {}["a fault"])
        (answer,) = node.handle(estimate_of(0))
    assert isinstance(answer, WindowRejected)
    assert (answer.code, answer.window) == ("failed", 0)
    assert "KeyError('a fault')" in answer.reason
    assert "KeyError" in caplog.text
    assert node.state is before
    (answer,) = node.handle(estimate_of(1))
    assert isinstance(answer, FoundationPosterior)


def test_the_node_works_when_its_answer_is_never_looked_at():
    node = node_of()
    node.handle(estimate_of(0))
    assert node.state.evidence.n_windows == 1


def test_a_node_that_continues_from_a_state_gives_what_it_would_have_given():
    whole = node_of()
    list(whole.handle(estimate_of(0)))
    (expected,) = whole.handle(estimate_of(1))
    first = node_of()
    list(first.handle(estimate_of(0)))
    second = node_of()
    assert not list(second.restore(first.snapshot(), ()))
    (continued,) = second.handle(estimate_of(1))
    assert np.array_equal(continued.draws, expected.draws)


def test_other_messages_are_not_answered():
    assert list(node_of().handle(StreamEnd("small", "tower", "s", 0, 0))) == []


def origin(first_sample, session="s", boot=0):
    return (UnitOrigin("tower", session, boot, first_sample),)


def test_a_window_counts_once_whatever_its_clock_said_and_later_ones_count_too():
    """On today's main one window stamped 2036 makes every later one an old one, for good."""
    node = node_of()
    wrong_ns = 12 * 365 * 86_400 * 10**9
    first, second, third = (replace(estimate_of(k), origins=origin(1200 * k)) for k in range(3))
    future = replace(first, start_ns=first.start_ns + wrong_ns, end_ns=first.end_ns + wrong_ns)
    heard = (future, second, second, future, third)
    answers = [list(node.handle(each)) for each in heard]
    assert [[each.n_windows for each in answer] for answer in answers] == [[1], [2], [2], [1], [3]]
    assert [answer[0].origins for answer in answers] == [each.origins for each in heard]


def test_the_first_window_of_another_boot_of_the_same_name_counts():
    node = node_of()
    (first,) = node.handle(replace(estimate_of(0), origins=origin(0)))
    (second,) = node.handle(replace(estimate_of(1), origins=origin(0, boot=1)))
    assert (first.n_windows, second.n_windows) == (1, 2)


def test_an_estimate_without_duration_is_refused_and_ends_nothing():
    node = node_of()
    (refused,) = node.handle(replace(estimate_of(0), end_ns=estimate_of(0).start_ns))
    assert refused.code == "no-duration"


def test_only_windows_of_the_allowed_states_are_used():
    node = TurbineUpdating(
        FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=1),
        LAYOUT,
        OperationSettings(("parked",)),
    )
    states = ("parked", "operating", CHANGING, "")
    for window, state in enumerate(states):
        (answer,) = node.handle(replace(estimate_of(window), operating_state=state))
        assert isinstance(answer, WindowRejected) == (state in ("operating", CHANGING))
        if isinstance(answer, WindowRejected):
            assert answer.code == "operating-state"
            assert f"the turbine was {state}" in answer.reason


TURNING = QualityWarning("turning-rotor", "what shakes at .1 and at .3 Hz are harmonics")
STOPPING = QualityWarning("non-stationary", "a stop or a start")


def updating_of(*states):
    updater = FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=1)
    return TurbineUpdating(updater, LAYOUT, OperationSettings(states))


@pytest.mark.parametrize("warning", [TURNING, STOPPING])
def test_a_window_of_an_unknown_state_that_shows_another_one_is_not_used(warning):
    node = updating_of("parked", "idling")
    (refused,) = node.handle(replace(estimate_of(0), warnings=(warning,)))
    assert isinstance(refused, WindowRejected)
    assert refused.code == warning.code
    assert refused.reason == (
        f"{warning.text}; nothing reports the turbine's state, and only parked and idling windows "
        "update the foundation"
    )
    assert node.state.evidence.n_windows == 0
    (posterior,) = node.handle(estimate_of(1))
    assert posterior.n_windows == 1


@pytest.mark.parametrize(("warning", "state"), [(TURNING, "operating"), (STOPPING, "stop")])
def test_a_window_of_a_state_that_the_operator_allows_is_used(warning, state):
    shown = replace(estimate_of(0), warnings=(warning,))
    (used,) = updating_of("parked", state).handle(shown)
    assert isinstance(used, FoundationPosterior)


@pytest.mark.parametrize("warning", [TURNING, STOPPING])
def test_the_controllers_word_counts_more_than_what_a_window_shows(warning):
    parked = replace(estimate_of(0), warnings=(warning,), operating_state="parked")
    (used,) = updating_of("parked").handle(parked)
    assert isinstance(used, FoundationPosterior)


@pytest.mark.parametrize("code", ["silent-channel", "duplicate-channel", "clipped"])
def test_a_channel_that_spoils_the_shapes_keeps_its_window_from_the_posterior(code):
    node = updating_of("parked")
    spoiled = replace(
        estimate_of(0), warnings=(QualityWarning(code, "b is bad"),), operating_state="parked"
    )
    (refused,) = node.handle(spoiled)
    assert (refused.code, refused.reason) == (code, "b is bad; not used")
    assert node.state.evidence.n_windows == 0


def test_a_controller_that_reports_the_speed_alone_reports_a_turning_rotor():
    node = updating_of("parked")
    (refused,) = node.handle(replace(estimate_of(0), rotor_speed=6.4))
    assert refused.code == "turning-rotor"
    assert "the rotor turns at 6.4 rpm; nothing reports the turbine's state" in refused.reason
    (used,) = node.handle(replace(estimate_of(1), rotor_speed=0.5))
    assert isinstance(used, FoundationPosterior)


def test_a_window_whose_shapes_are_spoilt_is_not_used():
    node = node_of()
    warning = QualityWarning("clipped", "z145-ss is clipped")
    (refused,) = node.handle(replace(estimate_of(0), warnings=(warning,)))
    assert (refused.code, refused.reason) == ("clipped", "z145-ss is clipped; not used")
    assert node.state.evidence.n_windows == 0


def test_a_live_layout_that_differs_from_the_scenarios_is_warned_of():
    node = TurbineUpdating(FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=1), LAYOUT)
    node.handle(LAYOUT)
    assert not node.statistics.warnings
    first, *others = LAYOUT.channels
    moved = replace(first, elevation=first.elevation + 3.0)
    node.handle(replace(LAYOUT, channels=(moved, *others)))
    (warning,) = node.statistics.warnings
    assert warning.code == "layout-differs"
    assert first.name in warning.text
    node.handle(LAYOUT)
    assert not node.statistics.warnings


def test_layouts_of_units_that_are_made_up_leave_bounded_warnings():
    node = TurbineUpdating(FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=1), LAYOUT)
    first, *others = LAYOUT.channels
    moved = (replace(first, elevation=first.elevation + 3.0), *others)
    for number in range(100):
        node.handle(replace(LAYOUT, unit=f"forged {number}", channels=moved))
    texts = [each.text for each in node.statistics.warnings]
    assert len(texts) == MOST_DIFFERENT
    assert texts[-1].startswith("unit forged 99 ")


def test_each_turbine_has_an_updating_of_its_own():
    made = []

    def make(turbine):
        made.append(turbine)
        return node_of()

    node = UpdatingNode(make)
    heard = [replace(estimate_of(0), turbine=turbine) for turbine in ("t1", "t2")]
    answers = [answer for each in heard for answer in node.handle(each)]
    assert made == ["t1", "t2"]
    assert [each.n_windows for each in answers] == [1, 1]


def test_the_models_shapes_are_at_the_estimates_channels_in_their_order() -> None:
    """A logger that came back with its channels backwards, and one with fewer of them."""
    window = estimate_of(0)
    (described,) = node_of().handle(window)
    n_channels = len(LAYOUT.channels)
    assert described.model_shapes.shape[1] == n_channels
    for kept in (range(n_channels)[::-1], [4, 0, 1]):
        (answer,) = node_of().handle(at_channels(window, list(kept)))
        assert isinstance(answer, FoundationPosterior)
        assert answer.model_labels == described.model_labels
        close = np.abs(answer.model_shapes - described.model_shapes[:, list(kept)])
        assert close.max() < 0.01  # where few channels are left the median is another one


def at_channels(estimate: ModalEstimate, kept: list[int]) -> ModalEstimate:
    """The estimate of some of its channels, or of all in another order."""
    rows = [0, 1, *(2 + channel for channel in kept)]
    modes = tuple(
        replace(mode, shape=mode.shape[kept], covariance_factor=mode.covariance_factor[rows])
        for mode in estimate.modes
    )
    return replace(estimate, channels=tuple(estimate.channels[k] for k in kept), modes=modes)
