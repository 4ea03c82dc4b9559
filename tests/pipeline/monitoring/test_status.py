"""A running session says how it does to whoever asks."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from pipeline.cli.tables.running import status_tables
from pipeline.messages import QualityWarning, StreamGap
from pipeline.monitoring.status import KEY, StatusNode, endpoint_of
from pipeline.transport.errors import TransportError
from pipeline.transport.zenoh_bus import ZenohBus, asked, free_endpoint, hub
from sensors.errors import InputError
from tests.pipeline.example_messages import START_NS, block, status
from tests.pipeline.updating.test_serialisation import estimate_of, updater_of

SECOND = 10**9  # [ns]


class Clock:
    now_ns = START_NS

    def __call__(self) -> int:
        return self.now_ns


@pytest.fixture
def desk() -> StatusNode:
    """After five blocks a second apart, a gap, a posterior and a node that is two behind."""
    clock = Clock()
    desk = StatusNode("live", clock)
    for sequence in range(5):
        desk.handle(block(sequence))
        clock.now_ns += SECOND
    desk.handle(StreamGap("t1", "tower", "s", START_NS, START_NS + 4 * SECOND, 3, 4))
    updater = updater_of()
    _, posterior = updater.updated(updater.initial_state(), estimate_of(0))
    desk.handle(posterior)
    desk.handle(status("recorder", last_sequence=2, lost=1))
    return desk


def test_the_desk_knows_rates_lags_gaps_and_posteriors(desk: StatusNode) -> None:
    answer = desk.as_json()
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
    assert len(status_tables(json.loads(desk.answer()))) == 4


def test_what_seldom_happens_has_a_column_where_it_has_happened(desk: StatusNode) -> None:
    def columns() -> list[object]:
        return [column.header for column in status_tables(desk.as_json())[0].columns]

    assert "recovered" not in columns()
    desk.handle(replace(status("recorder", last_sequence=3), recovered=2))
    assert columns()[-3:] == ["received", "lost", "recovered"]


def test_what_a_node_doubts_stands_below_the_nodes_in_its_own_words(desk: StatusNode) -> None:
    doubts = (
        QualityWarning("link-down", "udp://:5: [/x] down"),
        QualityWarning("gap", "3 blocks are missing"),
    )
    desk.handle(replace(status("feed-tower"), warnings=doubts))
    table = status_tables(desk.as_json())[1]
    assert [str(cell) for cell in table.columns[0].cells] == ["feed-tower", "feed-tower"]
    assert [str(cell) for cell in table.columns[1].cells] == [doubt.text for doubt in doubts]


@pytest.mark.parametrize("forged", [float("nan"), float("inf"), float("-inf")])
def test_no_number_that_somebody_sends_keeps_the_desk_from_answering(
    desk: StatusNode, forged: float
) -> None:
    desk.handle(replace(status("forger"), busy_s=forged))
    nodes = {each["node"]: each for each in json.loads(desk.answer())["nodes"]}
    assert nodes["forger"]["busy_s"] is None
    assert nodes["recorder"]["lost"] == 1
    assert len(status_tables(json.loads(desk.answer()))) == 4


def test_of_several_turbines_the_posteriors_are_one_table(desk: StatusNode) -> None:
    (known,) = desk._posteriors.values()
    desk.handle(replace(known, turbine="t2", trusted=False, change_probability=0.25))
    springs = tuple(replace(each, median=float("nan")) for each in known.parameters)
    desk.handle(replace(known, turbine="[forged]", parameters=springs))
    *_, table, _ = status_tables(json.loads(desk.answer()))
    cells = [list(column.cells) for column in table.columns]
    assert cells[0] == [known.turbine, "t2", r"\[forged]"]
    assert cells[5][1] == "0.25"
    assert cells[6] == ["", "NOT TRUSTED", ""]
    assert cells[2][2].startswith("unknown ± ")


def test_a_posterior_of_no_number_is_unknown(desk: StatusNode) -> None:
    (known,) = desk._posteriors.values()
    springs = tuple(replace(each, p05=float("nan")) for each in known.parameters)
    desk.handle(replace(known, parameters=springs, ess=float("nan"), trusted=False))
    *_, table, _ = status_tables(json.loads(desk.answer()))
    assert str(table.title).endswith(f"{known.turbine}, NOT TRUSTED")
    assert "unknown effective draws" in str(table.caption)


def test_whoever_connects_can_ask(desk: StatusNode) -> None:
    endpoint = free_endpoint()
    bus = ZenohBus(hub(endpoint))
    try:
        bus.answer(f"{KEY}/t1", desk.answer)
        (reply,) = asked(endpoint, f"{KEY}/*")
    finally:
        bus.close()
    assert json.loads(reply) == desk.as_json()


def test_nobody_there_is_one_line(tmp_path: Path) -> None:
    with pytest.raises(TransportError, match="no Zenoh session answers"):
        asked(free_endpoint(), f"{KEY}/*")
    with pytest.raises(InputError, match="no session runs in"):
        endpoint_of(tmp_path)
