"""A stranger can make up any number of turbines and units; what is kept of them is bounded."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from pipeline.messages import Message, ModalEstimate, StreamEnd, WindowRejected
from pipeline.nodes.by_turbine import LimitedMembers, NodeByTurbine
from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.node import NodeSnapshot, NodeStatistics
from pipeline.oma.settings import OmaSettings
from pipeline.oma.windows.block_admission import LimitSettings
from pipeline.runtime.snapshots import SnapshotFolder
from sensors.acquisition.scada import ScadaSample
from tests.pipeline.example_messages import LAYOUT, block, rejection

SETTINGS = OmaSettings(window_duration=60.0, hop=60.0)


def test_who_has_said_least_goes_and_of_these_who_was_silent_longest() -> None:
    members = LimitedMembers(3)
    assert [members.note(name) for name in "aabbc"] == [None] * 5
    assert members.note("d") == "c"
    assert members.note("e") == "d"
    assert members.note("e") is None
    assert members.note("f") == "a"
    assert members.gone == 3


FEW = LimitSettings(turbines=4, units=3)


def holdings(node: IdentificationNode) -> list[int]:
    """How many entries each of the node's tables has, nested ones counted through."""

    def size(table: object) -> int:
        return sum(map(size, table.values())) if isinstance(table, dict) and table else 1

    tables = [vars(node)]
    for member in node.members.values():
        units = member.units
        tables += [vars(member), vars(member._log), vars(units), *map(vars, units.by_name.values())]
    return [size(each) for table in tables for each in table.values() if isinstance(each, dict)]


def flood(number: int) -> Iterable[Message]:
    """What a stranger says of a turbine and a unit that nobody has heard of."""
    turbine, unit, name = f"forged {number}", f"forged {number}", f"forged {number}"
    yield replace(LAYOUT, turbine=turbine)
    yield replace(LAYOUT, unit=unit, layout_id=name)
    yield replace(LAYOUT, layout_id=name)
    yield block(number, turbine=turbine)
    yield StreamEnd(LAYOUT.turbine, LAYOUT.unit, name, 1, 1)
    yield StreamEnd(turbine, unit, name, 1, 1)
    yield ScadaSample(turbine, block(number).start_ns, "parked", *(6 * [0.0]))


def test_a_flood_of_names_leaves_bounded_memory_and_the_session_that_ran() -> None:
    node = IdentificationNode(SETTINGS, limits=FEW)
    list(node.handle(LAYOUT))
    said: list[Message] = []
    sizes = []
    for number in range(62):
        said += node.handle(block(number))
        for message in flood(number):
            list(node.handle(message))
        sizes.append(sum(holdings(node)))
    assert max(sizes) == max(sizes[:20])
    windows = [each for each in said if isinstance(each, (ModalEstimate, WindowRejected))]
    assert [each.window for each in windows if each.turbine == "t1"] == [0]
    doubts = [each for each in node.statistics.warnings if each.code == "too-many-turbines"]
    assert [each.text.partition(":")[0] for each in doubts] == [
        "more than 4 turbines",
        "more than 3 units of a turbine",
    ]


def test_a_unit_that_is_let_go_while_its_session_runs_ends_no_node(tmp_path: Path) -> None:
    """Names that are made up come before the tower's first block, one of them has the session."""
    store = SnapshotFolder(tmp_path, "identification")
    node = IdentificationNode(SETTINGS, limits=FEW, store=store)
    list(node.handle(replace(LAYOUT, unit="forged 0", layout_id="forged 0")))
    said: list[Message] = []
    for number in range(70):
        for other in range(4):
            name = f"forged {4 * number + other}"
            forged = replace(block(number, unit=name), session=name)
            said += node.handle(forged)
            said += node.handle(StreamEnd(LAYOUT.turbine, name, name, forged.end_ns, 1))
        if number == 5:
            said += node.handle(LAYOUT)
        said += node.handle(block(number))
    windows = [each for each in said if isinstance(each, ModalEstimate)]
    assert [each.origins[0].unit for each in windows] == [LAYOUT.unit]


def test_units_without_a_layout_never_take_the_place_of_one_that_has_one() -> None:
    """However many of their blocks come between two of its own."""
    node = IdentificationNode(SETTINGS)
    said = list(node.handle(LAYOUT))
    for number in range(62):
        said += node.handle(block(number))
        for other in range(30):
            said += node.handle(block(number, unit=f"forged {other % 4}"))
    windows = [each for each in said if isinstance(each, ModalEstimate | WindowRejected)]
    assert [(type(each), each.window) for each in windows] == [(ModalEstimate, 0)]
    assert node.statistics.rejected["no-layout"] > 1700


def test_nodes_of_the_turbines_that_were_heard_most_are_kept() -> None:
    made: list[Refuser] = []

    def make(_: str) -> Refuser:
        made.append(Refuser())
        return made[-1]

    node = NodeByTurbine(make, most_turbines=FEW.turbines)
    for number in range(20):
        list(node.handle(estimate("t1")))
        list(node.handle(estimate(f"forged {number}")))
    assert made[0].taken == 20
    assert sum(not each.finished for each in made) == len(node.members) == 4
    (warning,) = node.statistics.warnings
    assert warning.text == "more than 4 turbines: 17 times the one with fewest messages went"


def estimate(turbine: str) -> ModalEstimate:
    return ModalEstimate(turbine, 0, 0, 60, LAYOUT.layout_id, LAYOUT.channel_names, ())


class Refuser:
    """A node of one turbine that has nothing to say."""

    revision = 0
    statistics = NodeStatistics()

    def __init__(self) -> None:
        self.taken = 0
        self.finished = False

    def handle(self, message: Message) -> Iterable[Message]:
        self.taken += 1
        return (rejection(0, turbine=message.turbine),)

    def finish(self) -> Iterator[Message]:
        self.finished = True
        return iter(())

    def snapshot(self) -> NodeSnapshot:
        return NodeSnapshot(b"")

    def restore(self, snapshot: NodeSnapshot, past: Iterable[Message]) -> Iterator[Message]:
        return iter(())
