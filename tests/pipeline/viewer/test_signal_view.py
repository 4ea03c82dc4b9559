"""When accelerations are drawn, and how far a node is behind them."""

import time

import pytest
import rerun as rr

from pipeline.viewer.signal_view import KnownLayouts, SignalView
from pipeline.viewer.update_rates import UpdateRates
from tests.pipeline.example_messages import LAYOUT, block


def view(min_interval: float = 0.0) -> SignalView:
    layouts = KnownLayouts()
    layouts.add(LAYOUT)
    rates = UpdateRates(
        signals=3.0, swing=18.0, swing_chunk=1.0, nodes=5.0, settling=1.0, min_interval=min_interval
    )
    return SignalView(rr.RecordingStream("signals"), "t1", layouts, rates=rates)


def test_signals_are_due_whenever_a_chunk_of_them_is_gathered() -> None:
    signals, due = view(), []
    for number in range(9):
        due.append(signals.take(block(number)))
        if due[-1]:
            signals.hand_over("tower")
    assert due == 3 * [False, False, True]


def test_signals_wait_for_the_shortest_interval_of_the_machines_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    signals, moments = view(min_interval=0.25), iter([100.0, 100.0, 100.1, 100.24, 100.25])
    monkeypatch.setattr(time, "monotonic", lambda: next(moments))
    assert [signals.take(block(number)) for number in range(3)] == [False, False, True]
    signals.hand_over("tower")
    assert [signals.take(block(number)) for number in range(3, 8)] == [False] * 4 + [True]


def test_a_node_is_behind_by_the_blocks_that_it_has_not_taken() -> None:
    signals = view()
    assert signals.behind(0) == 0.0
    for number in range(8):
        signals.take(block(number))
    assert [signals.behind(last) for last in (-1, 0, 5, 7, 9)] == [0.0, 7.0, 2.0, 0.0, 0.0]
