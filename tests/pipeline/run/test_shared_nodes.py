"""What a person may ask of a session whose turbines or nodes are shared."""

from pathlib import Path

import pytest

from pipeline.run.options import SessionOptions
from pipeline.run.run import run_session
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
