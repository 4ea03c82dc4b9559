"""Posteriors made apart from each other are those of a session that goes from window to window."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import pytest

from pipeline.archive.posteriors import (
    WINDOWS_OF_CALL,
    PosteriorPass,
    StretchCall,
    UpdatingPlan,
    _made,
    posteriors,
)
from pipeline.archive.store import StoredFrame, messages_in, packed, unpacked
from pipeline.archive.work import Call
from pipeline.messages import (
    FoundationEvent,
    FoundationPosterior,
    Message,
    ModalEstimate,
    WindowRejected,
)
from pipeline.nodes.operating_state import OperationSettings
from pipeline.updating.updater import FoundationUpdater
from sensors.acquisition.blocks import NANOSECONDS
from sensors.structure.description import load_turbine
from tests.pipeline.updating.small_tower import LAYOUT, LinearTower, drawn_estimate
from tests.pipeline.updating.test_state import SETTINGS

SEED = 5
BEFORE, AFTER = np.array([1.1, 0.9, 1.0]), np.array([1.1, 0.81, 1.0])
CHANGED_AT, N_WINDOWS = 16, 24


@dataclass(frozen=True, slots=True, eq=False)
class LinearPlan(UpdatingPlan):
    """Of a tower that is evaluated in microseconds."""

    def made(self) -> FoundationUpdater:
        return FoundationUpdater(LinearTower(), self.layout, self.settings, seed=self.seed)


PLAN = LinearPlan(
    load_turbine("iea15mw_monopile"), LAYOUT, SETTINGS, OperationSettings(), seed=SEED
)


def estimates() -> Iterator[ModalEstimate]:
    """A tenth of k22 is lost in the seventeenth window."""
    for window in range(N_WINDOWS):
        generator = np.random.default_rng([77, window])
        truth = BEFORE if window < CHANGED_AT else AFTER
        drawn = drawn_estimate(truth, generator, window=window, tower=LinearTower())
        start_ns = window * 600 * NANOSECONDS
        yield replace(drawn, start_ns=start_ns, end_ns=start_ns + 600 * NANOSECONDS)


class Kept:
    """Results by their keys, as a folder keeps them."""

    def __init__(self) -> None:
        self.results: dict[str, bytes] = {}
        self.made = 0

    def __call__(
        self, key: str, make: Callable[[], tuple[StoredFrame, ...]]
    ) -> tuple[StoredFrame, ...]:
        if key not in self.results:
            self.made += 1
            self.results[key] = packed(make())
        return unpacked(self.results[key])


def history(kept: Kept) -> tuple[list[Message], list[Call]]:
    """The whole pass, and the calls that it made, which are done at once."""
    messages, calls = list[Message](), list[Call]()
    for each in PosteriorPass(PLAN, kept).answers(estimates()):
        if isinstance(each, Call):
            calls.append(each)
            done = kept(each.key, partial(each.function, each.argument))
            messages += messages_in(done)
        else:
            messages.append(each)
    return messages, calls


@pytest.fixture(scope="module")
def kept() -> Kept:
    return Kept()


@pytest.fixture(scope="module")
def passed(kept: Kept) -> tuple[list[Message], list[Call]]:
    return history(kept)


@pytest.fixture(scope="module")
def archived(passed: tuple[list[Message], list[Call]]) -> list[Message]:
    return passed[0]


@pytest.fixture(scope="module")
def live() -> list[Message]:
    """A session's."""
    updater, answers = PLAN.made(), []
    state = updater.initial_state()
    for estimate in estimates():
        state, said = updater.watched(state, estimate)
        answers += said
    return answers


def of_posteriors(messages: list[Message]) -> list[FoundationPosterior]:
    return [each for each in messages if isinstance(each, FoundationPosterior)]


def test_every_window_has_one_posterior_in_order(archived: list[Message]) -> None:
    assert [each.window for each in of_posteriors(archived)] == list(range(N_WINDOWS))


def test_posteriors_are_a_sessions_but_for_their_draws(
    archived: list[Message], live: list[Message]
) -> None:
    """Of n effective draws each, two medians differ by √(2 · ¼ / n) / .399 standard deviations,
    3.29 of which are the width of the interval: .05 of it where n is 110. Their mean over windows
    is zero within four of its own standard deviations."""
    differences = np.array(
        [
            [
                (ours.parameter(name).median - theirs.parameter(name).median)
                / (theirs.parameter(name).p95 - theirs.parameter(name).p05)
                for name in ("k11", "k22", "k12")
            ]
            for ours, theirs in zip(of_posteriors(archived), of_posteriors(live), strict=True)
        ]
    )

    assert np.sqrt((differences**2).mean()) < 0.07
    assert np.abs(differences.mean(axis=0)).max() < 4 * 0.05 / np.sqrt(N_WINDOWS)


def test_a_change_is_noticed_in_the_window_in_which_a_session_notices_it(
    archived: list[Message], live: list[Message]
) -> None:
    (ours,) = [each for each in archived if isinstance(each, FoundationEvent)]
    (theirs,) = [each for each in live if isinstance(each, FoundationEvent)]

    assert (ours.window, ours.kind, ours.since_ns) == (theirs.window, theirs.kind, theirs.since_ns)
    assert ours.probability == pytest.approx(theirs.probability, abs=1e-3)
    (k22,) = [each for each in ours.changes if each.name == "k22"]
    assert k22.p05 < -0.1 < k22.p95


def test_where_and_when_a_stretch_is_done_changes_no_bit(
    passed: tuple[list[Message], list[Call]], kept: Kept
) -> None:
    """The last first, by an updater that has done nothing else; in their pass, the state of the
    serial one had gone on."""
    _made.clear()

    for call in reversed(passed[1][-3:]):
        assert packed(posteriors(call.argument)) == kept.results[call.key]


def test_a_pass_over_kept_results_makes_nothing(archived: list[Message], kept: Kept) -> None:
    made = kept.made

    again, _ = history(kept)

    assert kept.made == made
    assert [type(each) for each in again] == [type(each) for each in archived]


def test_most_posteriors_are_left_to_others(passed: tuple[list[Message], list[Call]]) -> None:
    """What is serial thins out as windows gather, down to one in `ANCHORS_APART`."""
    apart = sum(len(call.argument.estimates) for call in passed[1])

    assert apart >= 0.5 * N_WINDOWS
    assert all(len(call.argument.estimates) <= WINDOWS_OF_CALL for call in passed[1])


def test_an_anchor_stands_where_as_many_windows_as_half_of_all_came_since_the_last(
    passed: tuple[list[Message], list[Call]],
) -> None:
    """At the windows 0, 1, 2, 4, 8 and, of the change, 16: between them 3, 5 to 7, 9 to 14, 15."""
    lengths = [len(call.argument.estimates) for call in passed[1]]
    assert lengths[:4] == [1, 3, WINDOWS_OF_CALL, 1]


def test_a_window_without_duration_is_rejected_as_in_a_session(kept: Kept) -> None:
    first = next(estimates())
    _, refused = PosteriorPass(PLAN, kept).answers([replace(first, end_ns=first.start_ns)])
    assert isinstance(refused, WindowRejected)
    assert refused.code == "no-duration"


def test_other_windows_before_or_another_seed_are_another_result() -> None:
    updater = PLAN.made()
    empty = updater.saved(updater.initial_state())
    payload = (b"window",)
    other = replace(PLAN, seed=SEED + 1)

    keys = {
        StretchCall(PLAN, empty, payload).key,
        StretchCall(PLAN, empty + b"x", payload).key,
        StretchCall(PLAN, empty, (b"other",)).key,
        StretchCall(other, empty, payload).key,
    }

    assert len(keys) == 4
    assert posteriors.__module__ == "pipeline.archive.posteriors"  # found by workers
