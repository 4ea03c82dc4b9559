"""What a node says of its own work is what it did."""

from collections import Counter
from collections.abc import Iterator

from pipeline.messages import Message, QualityWarning
from pipeline.nodes.node import NodeStatistics
from pipeline.runtime.lock_step import NodeAccount
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import block, rejection


class Worker:
    """Works for two seconds on every message, by a clock of its own."""

    name = "worker"
    inputs: tuple[type, ...] = (AccelerationBlock,)
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.now_ns = 0

    def work(self) -> None:
        self.now_ns += 2 * NANOSECONDS

    def close(self) -> None:
        pass


class Sink(Worker):
    """Answers nothing."""

    def handle(self, message: Message) -> tuple[Message, ...]:
        self.work()
        return ()


class Answering(Worker):
    """Works before its first answer, between its answers, and after the last."""

    def handle(self, message: Message) -> Iterator[Message]:
        self.work()
        yield rejection(0)
        self.work()
        yield rejection(1)
        self.work()


def busy_after_three_blocks(node: Worker) -> float:
    account = NodeAccount(node, "t1", lambda: node.now_ns)
    for sequence in range(3):
        for _ in account.handle(block(sequence)):
            node.now_ns += 100 * NANOSECONDS  # on its way: not the node's work
    return account.status("running").busy_s


def test_the_work_of_a_node_that_answers_nothing_counts() -> None:
    assert busy_after_three_blocks(Sink()) == 6.0


def test_all_work_of_a_node_counts_and_what_others_do_with_its_answers_does_not() -> None:
    assert busy_after_three_blocks(Answering()) == 18.0


def test_blocks_lost_on_the_way_and_those_that_the_node_misses_are_one_count() -> None:
    node = Sink()
    node.statistics = NodeStatistics(lost=3)
    assert NodeAccount(node, "t1", lambda: 0).status("running", lost=4).lost == 7


def test_counts_of_two_nodes_are_added_field_by_field() -> None:
    one = NodeStatistics(1, 2, 3, 4, Counter(a=1), (QualityWarning("a", "one"),))
    other = NodeStatistics(10, 20, 30, 40, Counter(a=1, b=5), (QualityWarning("b", "other"),))
    both = one + other
    assert (both.lost, both.late, both.duplicate, both.recorded) == (11, 22, 33, 44)
    assert both.rejected == {"a": 2, "b": 5}
    assert [each.code for each in both.warnings] == ["a", "b"]
    assert NodeStatistics() + one == one
