"""Pages of an OPC UA server's history, of channels as dense and as sparse as they come."""

import asyncio
from datetime import UTC, datetime
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from asyncua import ua

from sensors.acquisition.blocks import NANOSECONDS
from sensors.feeds.opcua import history as histories
from sensors.feeds.opcua import opcua_feed
from sensors.feeds.opcua.opcua_feed import DataChanges
from sensors.feeds.opcua.values import moment_of, stamp_ns
from sensors.feeds.reconnect import LinkError

BEGIN_NS = int(datetime(2025, 3, 1, tzinfo=UTC).timestamp()) * NANOSECONDS
STEP_NS = NANOSECONDS // 100
MOST_REQUESTS = 400  # a loop that does not end is a failure and no wait


def value_at(time_ns: int) -> ua.DataValue:
    return ua.DataValue(ua.Variant(1.0), SourceTimestamp=moment_of(time_ns))


class Historian:
    """Keeps times of values; answers as a server does, a number of values of a variable at most."""

    def __init__(self, kept: dict[str, list[int]], *, goes_by_time: bool = True) -> None:
        self.kept, self._goes_by_time = kept, goes_by_time
        self.requests: list[tuple[str, ...]] = []

    async def read(self, _: Any, nodes: dict[str, Any], begin: int, end: int) -> list[Any]:
        self.requests.append(tuple(nodes))
        assert len(self.requests) < MOST_REQUESTS
        answers = []
        for name in nodes:
            inside = [t for t in self.kept[name] if begin <= t < end or not self._goes_by_time]
            taken = inside[: histories.HISTORY_VALUES]
            answers.append(
                SimpleNamespace(
                    StatusCode=ua.StatusCode(0),
                    ContinuationPoint=b"more" if len(taken) < len(inside) else None,
                    HistoryData=SimpleNamespace(DataValues=[value_at(each) for each in taken]),
                )
            )
        return answers

    def pages(
        self, known: dict[str, int], monkeypatch: pytest.MonkeyPatch, newest: dict[str, int]
    ) -> list[list[tuple[str, int]]]:
        """Channels and times that a client is given up to the present values, page by page."""
        monkeypatch.setattr(histories, "_read", self.read)
        monkeypatch.setattr(histories, "HISTORIAN_PAUSE", 0.0)
        present = [(name, value_at(time_ns)) for name, time_ns in newest.items()]

        async def given() -> list[list[Any]]:
            nodes = dict.fromkeys(self.kept)
            return [page async for page in histories.history(None, nodes, known, present)]

        pages = asyncio.run(given())
        return [[(name, stamp_ns(value) or 0) for name, value in page] for page in pages]


def test_a_channel_that_was_silent_is_caught_up_beside_a_dense_one(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dense = [BEGIN_NS + i * STEP_NS for i in range(120 * 100)]
    sparse = [BEGIN_NS, BEGIN_NS + 119 * NANOSECONDS]
    historian = Historian({"x": dense, "y": sparse})
    known = {"x": BEGIN_NS + 100 * NANOSECONDS, "y": BEGIN_NS}
    pages = historian.pages(known, monkeypatch, {"x": dense[-1], "y": sparse[-1]})
    given = [each for page in pages for each in page]
    assert sorted(given) == [*(("x", t) for t in dense if t > known["x"]), ("y", sparse[-1])]
    assert len(historian.requests) == 2
    assert historian.requests[0] == ("y",)  # nothing of a channel is read that is known


@pytest.mark.parametrize("seed", range(20))
def test_every_value_of_a_gap_comes_once_and_in_order(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    draw = np.random.default_rng(seed)
    monkeypatch.setattr(histories, "HISTORY_VALUES", int(draw.integers(1, 9)))
    span = 100 * NANOSECONDS
    kept, known, newest = {}, {}, {}
    for name in "abcd"[: draw.integers(1, 5)]:
        many = int(draw.choice([2, 5, 60]))
        steps = np.sort(draw.choice(span // histories.MICROSECOND, many, replace=False))
        kept[name] = [BEGIN_NS + int(each) * histories.MICROSECOND for each in steps]
        known[name] = kept[name][int(draw.integers(many - 1))]
        newest[name] = kept[name][-1]
    pages = Historian(kept).pages(known, monkeypatch, newest)
    given = [each for page in pages for each in page]
    wanted = [(name, t) for name, times in kept.items() for t in times if t > known[name]]
    assert sorted(given) == sorted(wanted)
    spans = [(min(t for _, t in page), max(t for _, t in page)) for page in pages if page]
    assert all(before[1] < after[0] for before, after in pairwise(spans))


def test_what_a_historian_writes_late_is_asked_for_without_what_came(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dense = [BEGIN_NS + i * STEP_NS for i in range(120 * 100)]
    historian = Historian({"x": dense, "y": [BEGIN_NS]})
    pages = historian.pages(
        {"x": BEGIN_NS, "y": BEGIN_NS}, monkeypatch, {"x": dense[-1], "y": dense[-1]}
    )
    assert sum(len(page) for page in pages) == len(dense) - 1
    assert sum("x" in asked for asked in historian.requests) < 3 + 2 * histories.HISTORIAN_TRIES


def test_a_server_that_does_not_go_by_the_times_asked_for_is_left(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    dense = [BEGIN_NS + i * STEP_NS for i in range(200 * 100)]
    historian = Historian({"x": dense}, goes_by_time=False)
    pages = historian.pages({"x": BEGIN_NS}, monkeypatch, {"x": dense[-1]})
    assert [t for page in pages for _, t in page] == dense[1 : histories.HISTORY_VALUES]


def test_values_that_wait_have_a_bound_and_the_others_are_read_from_the_history(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(opcua_feed, "MOST_VALUES_WAITING", 3)

    async def taken() -> list[int | None]:
        node = SimpleNamespace(nodeid=1)
        changes = DataChanges({1: "x"})
        for i in range(10):
            change = SimpleNamespace(
                monitored_item=SimpleNamespace(Value=value_at(BEGIN_NS + i * STEP_NS))
            )
            changes.datachange_notification(node, None, change)
        times = [stamp_ns(value) for _, value in await changes.batch()]
        with pytest.raises(LinkError, match="more than 3 values"):
            await changes.batch()
        return times

    assert asyncio.run(taken()) == [BEGIN_NS + i * STEP_NS for i in range(3)]
