"""The updating node between two messages."""

from dataclasses import replace

import numpy as np

from pipeline.messages import FoundationPosterior, StreamEnd, WindowRejected
from pipeline.nodes.node import Node
from pipeline.nodes.updating import FoundationUpdaterNode
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


def node_of(seed=1) -> FoundationUpdaterNode:
    return FoundationUpdaterNode(FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=seed))


def estimate_of(window):
    generator = np.random.default_rng([4, window])
    return drawn_estimate(np.array([1.1, 0.9, 1.0]), generator, window=window, tower=LinearTower())


def test_each_estimate_is_answered_with_one_posterior_of_all_windows_so_far():
    node: Node = node_of()
    answers = [list(node.handle(estimate_of(window))) for window in range(2)]
    assert [[each.n_windows for each in answer] for answer in answers] == [[1], [2]]
    node.close()


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
    updater = FoundationUpdater(LinearTower(), LAYOUT, SETTINGS, seed=1)
    (continued,) = FoundationUpdaterNode(updater, first.state).handle(estimate_of(1))
    assert np.array_equal(continued.draws, expected.draws)


def test_other_messages_are_not_answered():
    assert list(node_of().handle(StreamEnd("small", "tower", "s", 0, 0))) == []
