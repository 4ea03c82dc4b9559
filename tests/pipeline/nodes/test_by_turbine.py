"""Shares of a farm: every turbine is in one share and no other; together they are the farm."""

from dataclasses import replace

import pytest

from pipeline.app import Outputs, build
from pipeline.messages import Message, ModalEstimate, WindowRejected
from pipeline.nodes.node import NodeStatistics
from pipeline.nodes.sharding import Shard, ShardedNode, ShardError, parsed_shard
from pipeline.runtime.lock_step import run_lock_step
from pipeline.scenario import scenario_from_text
from pipeline.sources.sources import simulated
from sensors.acquisition.blocks import AccelerationBlock
from tests.pipeline.example_estimates import estimate, mode
from tests.pipeline.example_messages import block, rejection, status

FARM = """
title = "Two towers, one of them with half the sensors"
seed = 4

[structure]  # which sensors are read does not depend on how well the structure is known
uncertain = "exact"

[farm]
log_std = 0.02

[[farm.members]]
id = "north"

[[farm.members]]
id = "south"
elevations = [80.0, 145.0]
"""


@pytest.mark.parametrize("known", [(), tuple(f"t{n}" for n in range(20))])
def test_every_turbine_is_in_exactly_one_share(known: tuple[str, ...]) -> None:
    shares = [Shard(number, 4, known) for number in (1, 2, 3, 4)]
    for number in range(20):
        assert sum(share.has(f"t{number}") for share in shares) == 1
    if known:  # dealt in turn
        assert [sum(share.has(name) for name in known) for share in shares] == [5, 5, 5, 5]


def test_a_stranger_goes_by_its_name_alone_on_every_machine() -> None:
    """0x0b2c5f96, the CRC-32 of the name, is a multiple of 3."""
    assert [Shard(number, 3).has("iea15mw") for number in (1, 2, 3)] == [True, False, False]


@pytest.mark.parametrize("text", ["0/4", "5/4", "1", "a/b", "1/0"])
def test_a_share_that_there_is_not_is_refused(text: str) -> None:
    with pytest.raises(ShardError, match="shard"):
        parsed_shard(text)


class Echo:
    """Answers everything with a rejection of the same turbine."""

    name = "updating"
    inputs = (ModalEstimate,)
    statistics = NodeStatistics(late=3)

    def handle(self, message: Message) -> list[Message]:
        return [rejection(0)]

    def close(self) -> None: ...


def test_a_share_answers_its_own_turbines_and_keeps_the_nodes_books() -> None:
    names = ("t1", "t2")
    first, second = (ShardedNode(Echo(), Shard(n, 2, names)) for n in (1, 2))
    assert first.name == "updating-1-of-2"
    assert status(first.name).is_of("updating")
    assert not status(first.name).is_of("identification")
    assert list(first.handle(block(0, turbine="t1")))
    assert not list(second.handle(block(0, turbine="t1")))
    assert list(second.handle(status("updating")))
    assert first.statistics == NodeStatistics(late=3)


def test_shares_together_answer_what_the_whole_answers() -> None:
    names = ("t1", "t2", "t3")
    shares = [ShardedNode(Teller(), Shard(number, 2, names)) for number in (1, 2)]
    messages = [block(0, turbine=names[number % 3]) for number in range(7)]
    whole, shared = Listener(), Listener()
    run_lock_step(messages, [Teller(), whole], turbine="t1")
    run_lock_step(messages, [*shares, shared], turbine="t1")
    assert sorted(shared.taken) == sorted(whole.taken)
    assert len(whole.taken) == 7


def test_the_updating_of_a_farm_reads_each_turbine_at_its_own_sensors() -> None:
    source = simulated(scenario_from_text(FARM, "farm.toml"))
    graph = build(source.scenario, source.layout, Outputs(), source.layouts)
    (node,) = (plan.make() for plan in graph if plan.name == "updating")
    reasons = {}
    for turbine in source.turbines:
        (answer,) = node.handle(
            replace(
                replace(estimate(mode(0.5, [1.0] * 8)), channels=("nowhere",) * 8), turbine=turbine
            )
        )
        assert isinstance(answer, WindowRejected)
        reasons[turbine] = answer.reason.partition("the layout has ")[2].split(", ")
    assert source.turbines == ("north", "south")
    assert [len(reasons[turbine]) for turbine in source.turbines] == [8, 4]
    assert reasons["south"] == ["z80-fa", "z145-fa", "z80-ss", "z145-ss"]


class Teller(Echo):
    """Rejects a window for every block."""

    name = "identification"
    inputs = (AccelerationBlock,)

    def handle(self, message: Message) -> list[Message]:
        assert isinstance(message, AccelerationBlock)
        return [rejection(0, turbine=message.turbine)]


class Listener:
    """Keeps whose windows were rejected."""

    name = "listener"
    inputs = (WindowRejected,)
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.taken: list[str] = []

    def handle(self, message: Message) -> tuple[Message, ...]:
        assert isinstance(message, WindowRejected)
        self.taken.append(message.turbine)
        return ()

    def close(self) -> None: ...
