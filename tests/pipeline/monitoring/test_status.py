"""A running session says how it does to whoever asks."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from rich.text import Text

from pipeline.cli.tables.running import status_tables
from pipeline.messages import FoundationPosterior, QualityWarning, StreamGap
from pipeline.monitoring.status import STATUS_KEY, StatusNode, endpoint_of
from pipeline.transport.errors import TransportError
from pipeline.transport.zenoh_bus import ZenohBus, asked, free_endpoint, hub
from sensors.errors import InputError
from tests.pipeline.example_messages import START_NS, block, status
from tests.pipeline.updating.test_state import estimate_of, updater_of

SECOND = 10**9  # [ns]


class Clock:
    now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def metrics_node() -> StatusNode:
    """After five blocks a second apart, a gap, a posterior and a node that is two behind."""
    clock = Clock()
    metrics_node = StatusNode("live", clock)
    for sequence in range(5):
        metrics_node.handle(block(sequence))
        clock.now_ns += SECOND
    metrics_node.handle(StreamGap("t1", "tower", "s", START_NS, START_NS + 4 * SECOND, 3, 4))
    updater = updater_of()
    _, posterior = updater.updated(updater.initial_state(), estimate_of(0))
    metrics_node.handle(posterior)
    metrics_node.handle(status("recorder", last_sequence=2, lost=1))
    return metrics_node


def posterior_of_node(node: StatusNode) -> FoundationPosterior:
    """The only posterior that it knows."""
    (known,) = [each.posterior for each in node._run.turbines.values() if each.posterior]
    return known


def test_the_desk_knows_rates_lags_gaps_and_posteriors(metrics_node: StatusNode) -> None:
    answer = metrics_node.as_json()
    (node,) = answer["nodes"]
    assert (node["node"], node["condition"], node["behind_blocks"], node["lost"]) == (
        "recorder",
        "alive",
        2,
        1,
    )
    rates = {each["key"]: each["rate_hz"] for each in answer["streams"]}
    assert rates["pilewatch/t1/tower/acceleration"] == pytest.approx(1.0)
    turbine = estimate_of(0).turbine
    assert rates[f"pilewatch/{turbine}/foundation-posterior"] is None
    assert answer["gaps"][0]["duration_s"] == 4.0
    assert answer["posteriors"][0]["turbine"] == turbine
    assert len(status_tables(json.loads(metrics_node.answer()))) == 4


def test_what_seldom_happens_has_a_column_where_it_has_happened(metrics_node: StatusNode) -> None:
    def columns() -> list[object]:
        return [column.header for column in status_tables(metrics_node.as_json())[0].columns]

    assert "recovered" not in columns()
    metrics_node.handle(replace(status("recorder", last_sequence=3), recovered=2))
    assert columns()[-3:] == ["received", "lost", "recovered"]


def test_what_a_node_doubts_stands_below_the_nodes_in_its_own_words(
    metrics_node: StatusNode,
) -> None:
    warnings = (
        QualityWarning("link-down", "udp://:5: [/x] down"),
        QualityWarning("gap", "3 blocks are missing"),
    )
    metrics_node.handle(replace(status("feed-tower"), warnings=warnings))
    table = status_tables(metrics_node.as_json())[1]
    assert [str(cell) for cell in table.columns[0].cells] == ["feed-tower", "feed-tower"]
    shown = [Text.from_markup(str(cell)).plain for cell in table.columns[1].cells]
    assert shown == [warning.text for warning in warnings]


@pytest.mark.parametrize("forged", [float("nan"), float("inf"), float("-inf")])
def test_no_number_that_somebody_sends_keeps_the_desk_from_answering(
    metrics_node: StatusNode, forged: float
) -> None:
    metrics_node.handle(replace(status("forger"), busy_s=forged))
    nodes = {each["node"]: each for each in json.loads(metrics_node.answer())["nodes"]}
    assert nodes["forger"]["busy_s"] is None
    assert nodes["recorder"]["lost"] == 1
    assert len(status_tables(json.loads(metrics_node.answer()))) == 4


def test_of_several_turbines_the_posteriors_are_one_table(metrics_node: StatusNode) -> None:
    known = posterior_of_node(metrics_node)
    metrics_node.handle(replace(known, turbine="t2", trusted=False, change_probability=0.25))
    springs = tuple(replace(each, median=float("nan")) for each in known.parameters)
    metrics_node.handle(replace(known, turbine="[forged]", parameters=springs))
    *_, table, _ = status_tables(json.loads(metrics_node.answer()))
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == [known.turbine, "t2", r"\[forged]"]
    assert cells[5][1] == "0.25"
    assert cells[6] == ["", "NOT TRUSTED", ""]
    assert cells[2][2].startswith("unknown ± ")


def test_a_posterior_of_no_number_is_unknown(metrics_node: StatusNode) -> None:
    known = posterior_of_node(metrics_node)
    springs = tuple(replace(each, p05=float("nan")) for each in known.parameters)
    metrics_node.handle(replace(known, parameters=springs, ess=float("nan"), trusted=False))
    *_, table, _ = status_tables(json.loads(metrics_node.answer()))
    assert str(table.title).endswith(f"{known.turbine}, NOT TRUSTED")
    assert "unknown effective draws" in str(table.caption)


def test_whoever_connects_can_ask(metrics_node: StatusNode) -> None:
    endpoint = free_endpoint()
    bus = ZenohBus(hub(endpoint))
    try:
        bus.answer(f"{STATUS_KEY}/t1", metrics_node.answer)
        (reply,) = asked(endpoint, f"{STATUS_KEY}/*")
    finally:
        bus.close()
    assert json.loads(reply) == metrics_node.as_json()


def test_nobody_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(TransportError, match="no Zenoh session answers"):
        asked(free_endpoint(), f"{STATUS_KEY}/*")
    with pytest.raises(InputError, match="no session runs in"):
        endpoint_of(tmp_path)


def test_nodes_of_one_name_are_told_apart_by_their_turbines() -> None:
    node = {
        "condition": "alive", "silence_s": 0.5, "behind_blocks": None, "received": 1, "lost": 0,
        **dict.fromkeys(("recovered", "late", "duplicate", "malformed"), 0), "warnings": [],
    }  # fmt: skip
    nodes = [
        {"node": name, "turbine": turbine, **node}
        for name, turbine in (("recorder", "t1"), ("feed-tower", "t1"), ("feed-tower", "t2"))
    ]
    status = {
        "source": "live", "nodes": nodes, "streams": [], "posteriors": [], "connections": {},
        "books": {"alarms": []}, "gaps": [],
    }  # fmt: skip
    table = status_tables(status)[0]
    assert list(table.columns[0].cells) == ["recorder", "feed-tower of t1", "feed-tower of t2"]
