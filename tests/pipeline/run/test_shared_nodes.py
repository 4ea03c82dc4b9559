"""What a person may ask of a session whose turbines or nodes are shared."""

import threading
from pathlib import Path

import pytest

from pipeline.nodes.identification import IdentificationNode
from pipeline.nodes.node import Node, Plan
from pipeline.recording.session_recorder import SessionRecorder
from pipeline.run.options import SessionOptions
from pipeline.run.processes import processes
from pipeline.run.run import run_node, run_session
from pipeline.scenario import load_scenario
from pipeline.sources.sources import open_source, simulated
from sensors.errors import InputError


def test_shares_need_processes(tmp_path: Path) -> None:
    source = simulated(load_scenario("farm"))
    with pytest.raises(InputError, match="--shards 2 needs --processes"):
        run_session(source, SessionOptions(out=tmp_path, shards=2, rrd=False))
    with pytest.raises(InputError, match="--shards is 0"):
        run_session(source, SessionOptions(out=tmp_path, shards=0, way="processes", rrd=False))


@pytest.mark.parametrize(
    ("source", "node", "complaint"),
    [
        ("live", "updatin", "no such node; identification, recorder are"),
        ("simulate:parked", "updating", "is for --source live, not for simulate:parked"),
    ],
)
def test_nodes_elsewhere_are_nodes_of_a_live_session(
    source: str, node: str, complaint: str, tmp_path: Path
) -> None:
    options = SessionOptions(out=tmp_path, elsewhere=(node,), rrd=False)
    with pytest.raises(InputError, match=complaint):
        run_session(open_source(source), options)


def test_the_turbines_of_a_source_are_known_beforehand() -> None:
    assert simulated(load_scenario("farm")).turbines == tuple(f"iea15mw-{n}" for n in (1, 2, 3, 4))
    assert open_source("live", "parked").turbines == ("iea15mw",)


@pytest.mark.parametrize(
    ("node", "shards", "names"),
    [
        (IdentificationNode, 1, ["identification"]),
        (IdentificationNode, 3, [f"identification-{n}-of-3" for n in (1, 2, 3)]),
        (SessionRecorder, 1, ["recorder"]),
        (SessionRecorder, 3, ["recorder"]),
    ],
)
def test_turbines_are_shared_by_the_nodes_that_compute_and_by_no_other(
    node: type[Node], shards: int, names: list[str]
) -> None:
    plan = Plan(node, lambda: pytest.fail("a node is made in its own process"))
    found = processes(plan, ["pilewatch", "node"], shards)
    assert [each.name for each in found] == names
    shares = [["--shard", f"{number}/{shards}"] for number in range(1, shards + 1)]
    own = shares if len(names) > 1 else [[]]
    assert [list(each._command) for each in found] == [["pilewatch", "node", *each] for each in own]


@pytest.mark.parametrize(
    ("node", "shard", "words"),
    [
        ("updating", None, "updating needs a structure"),
        ("viewer", None, "nothing to draw on"),
        ("recorder", "1/2", "--shard is for identification and updating"),
    ],
)
def test_a_node_without_work_leaves_nothing_behind(
    node: str, shard: str | None, words: str, tmp_path: Path
) -> None:
    options = SessionOptions(out=tmp_path / "nd", rrd=False)
    with pytest.raises(InputError, match=words):
        run_node(node, open_source("live"), options, threading.Event(), shard)
    assert not (tmp_path / "nd").exists()
