"""What is left of a session in the end: `summary.json`."""

import json
from dataclasses import replace

import pytest

from pipeline.messages import (
    FoundationEvent,
    FoundationTruth,
    QualityWarning,
    StreamGap,
    WindowRejected,
)
from pipeline.monitoring.summary import SessionSummary
from pipeline.runtime.lock_step import NodeAccount
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from tests.pipeline.example_messages import START_NS, block, status
from tests.pipeline.state.test_run_modes import WINDOW, estimate, mode


def test_an_empty_session_is_valid_json_with_unknowns_as_null() -> None:
    figures = SessionSummary("live", "t1").as_json(wall=1.0)
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    assert figures["posterior"]["k11"]["median"] is None
    assert figures["posterior"]["correlation"] is None
    assert figures["stream"] == {
        "published": 0,
        "recorded": None,
        "lost": 0,
        "recovered": 0,
        "late": 0,
        "duplicate": 0,
        "gaps": 0,
        "gap_s": 0.0,
    }
    assert figures["timing"]["identify_s_per_window"] is None


def test_of_a_live_session_that_names_no_turbine_the_first_that_sends_is_reported() -> None:
    summary = SessionSummary("live", "turbine", live=True)
    summary.handle(replace(status("recorder", recorded=2), turbine="turbine"))
    for name in ("a", "b"):
        summary.handle(block(0, turbine=name))
    figures = summary.as_json(wall=1.0)
    assert summary.main.turbine == figures["turbine"] == "a"
    assert [each["turbine"] for each in figures["turbines"]] == ["a", "b"]
    assert figures["stream"]["recorded"] == 2


def test_a_state_claimed_for_a_turbine_does_not_hide_the_sessions_own() -> None:
    summary = SessionSummary("live", "turbine", live=True)
    summary.handle(replace(status("recorder", recorded=2), turbine="turbine"))
    summary.handle(block(0, turbine="a"))
    summary.handle(replace(status("forger"), turbine="a"))
    assert summary.as_json(wall=1.0)["stream"]["recorded"] == 2


def test_no_number_that_somebody_sends_keeps_the_summary_from_being_written() -> None:
    summary = SessionSummary("live", "t1")
    summary.handle(estimate(0, mode("m1", float("inf"), 0.1)))
    summary.handle(replace(status("identification"), busy_s=float("nan")))
    figures = summary.as_json(wall=1.0)
    assert json.loads(json.dumps(figures, allow_nan=False)) == figures
    assert figures["timing"]["identify_s_per_window"] is None


def test_rejections_are_timed_from_the_first_sample() -> None:
    summary = SessionSummary("replay:x", "t1")
    first = block(0)
    summary.run.fold(first)
    start = first.start_ns + WINDOW
    summary.handle(WindowRejected("t1", 1, start, start + WINDOW, "gap", "gap of 2 s"))
    (rejected,) = summary.as_json(wall=1.0)["windows"]["rejected"]
    assert rejected == {"start": 600.0, "code": "gap", "reason": "gap of 2 s"}


def test_accounts_come_from_the_nodes_themselves() -> None:
    summary = SessionSummary("replay:x", "t1")
    for sequence in range(3):
        summary.run.fold(block(sequence))
    summary.handle(status("recorder", recorded=2, lost=1))
    assert summary.as_json(wall=1.0)["stream"] == {
        "published": 3,
        "recorded": 2,
        "lost": 1,
        "recovered": 0,
        "late": 0,
        "duplicate": 0,
        "gaps": 0,
        "gap_s": 0.0,
    }


def test_no_block_is_called_lost_or_not_before_every_node_that_takes_blocks_has_heard_one() -> None:
    """A bus that delivered nothing ended in "3600 published, None recorded, 0 lost"."""
    heard = {"AccelerationBlock": 3}
    summary = SessionSummary("replay:x", "t1")
    for sequence in range(3):
        summary.run.fold(block(sequence))
    summary.handle(status("updating"))
    assert summary.as_json(wall=1.0)["stream"]["lost"] is None
    summary.handle(status("recorder", received=heard))
    assert summary.as_json(wall=1.0)["stream"]["lost"] == 0
    summary.handle(status("identification-0"))
    assert summary.as_json(wall=1.0)["stream"]["lost"] is None
    summary.handle(status("identification-1", received=heard))  # the share with this turbine
    assert summary.as_json(wall=1.0)["stream"]["lost"] == 0
    summary.handle(status("viewer", lost=3))
    assert summary.as_json(wall=1.0)["stream"]["lost"] == 3


def test_blocks_of_a_live_session_are_counted_by_hearing_and_once() -> None:
    replayed, live = SessionSummary("replay:x", "t1"), SessionSummary("live", "t1", live=True)
    assert set(live.inputs) - set(replayed.inputs) == {AccelerationBlock}
    for sequence in (0, 1, 2, 1, 2, 3):
        live.handle(block(sequence))
    other = replace(block(0), session="after a restart", start_ns=block(9).start_ns)
    live.handle(other)
    assert live.main.published == 5
    assert live.main.duration == pytest.approx(10.0)


def test_a_farms_blocks_are_all_counted_and_the_time_is_of_the_own_turbine() -> None:
    live = SessionSummary("live", "t1", live=True)
    for turbine in ("t1", "t2", "t2", "t3", "t4", "t5"):
        live.handle(replace(block(0), turbine=turbine))
    live.handle(replace(block(7), turbine="t5"))
    assert live.run.published == 6
    assert live.main.duration == pytest.approx(1.0)


def test_every_doubt_is_told_once() -> None:
    doubt = QualityWarning("clipped", "channel a is clipped")
    summary = SessionSummary("replay:x", "t1")
    for window in range(3):
        summary.handle(estimate(window, mode("m1", 1.0, 0.1), warnings=(doubt,)))
    assert summary.as_json(wall=1.0)["warnings"] == [
        {"code": "clipped", "text": "channel a is clipped"}
    ]


def test_what_each_node_dropped_is_told_once_however_many_statuses_came() -> None:
    summary = SessionSummary("live", "t1", live=True)
    account = NodeAccount(summary, "t1", clock=lambda: START_NS)
    for dropped in range(1, 10):  # a second each; the summary hears its own statuses too
        for node in ("recorder", "updating"):
            told = QualityWarning("malformed", f"the last one that {node} dropped: {dropped}")
            list(account.handle(replace(status(node), warnings=(told,))))
        list(account.handle(account.status("running", malformed=dropped, refusal=f"{dropped}")))
    warnings = summary.as_json(wall=1.0)["warnings"]
    assert [each["text"][-1] for each in warnings] == ["9", "9", "9"]


def test_the_truth_is_kept_for_the_summary() -> None:
    summary = SessionSummary("replay:x", "t1")
    summary.handle(FoundationTruth("t1", 0, k11=1.0, k22=2.0, k12=3.0))
    assert summary.main.truth is not None


def test_a_change_is_told_with_its_time_from_the_first_sample() -> None:
    summary = SessionSummary("replay:x", "t1")
    first = block(0)
    summary.run.fold(first)
    noticed = first.start_ns + 3 * WINDOW
    since = first.start_ns + 2 * WINDOW
    told = "k22 fell by 10 %"
    summary.handle(
        FoundationEvent("t1", 2, noticed, "foundation", 0.99, since, since, since, (), (), told)
    )
    (event,) = summary.as_json(wall=1.0)["events"]
    assert event == {
        "kind": "foundation",
        "probability": 0.99,
        "noticed": 1800.0,
        "since": 1200.0,
        "text": told,
        "changes": {},
        "revised": None,
    }


def gap(start: int, end: int, unit: str = "tower") -> StreamGap:
    """[s]"""
    return StreamGap("t1", unit, "s", start * NANOSECONDS, end * NANOSECONDS, start, end - start)


def test_who_joins_a_unit_that_runs_is_not_told_that_all_before_is_missing() -> None:
    began = START_NS // NANOSECONDS
    for live, gaps in ((True, 1), (False, 2)):
        summary = SessionSummary("live", "t1", live=live)
        summary.handle(gap(began - 10**6, began))
        summary.handle(WindowRejected("t1", 0, 0, WINDOW, "gap", "gap of a million seconds"))
        for sequence in (0, 9):
            summary.handle(block(sequence))
        summary.handle(gap(began + 1, began + 9))
        figures = summary.as_json(wall=1.0)
        assert figures["stream"]["gaps"] == gaps
        assert len(figures["windows"]["rejected"]) == gaps - 1
        assert (figures["stream"]["gap_s"] == 8.0) == live


@pytest.mark.parametrize("kept", [1, 2, 1000])
def test_time_that_several_units_lack_at_once_is_missing_once(
    monkeypatch: pytest.MonkeyPatch, kept: int
) -> None:
    monkeypatch.setattr("pipeline.monitoring.summary.KEPT_WINDOWS", kept)
    summary = SessionSummary("live", "t1", live=True)
    for begin in (0, 100, 200):
        for unit in ("tower", "nacelle", "pile"):
            summary.handle(gap(begin, begin + 60, unit))
    summary.handle(gap(230, 290))
    stream = summary.as_json(wall=1.0)["stream"]
    assert (stream["gaps"], stream["gap_s"]) == (10, 210.0)
    assert summary.main.missing == 210.0
    summary.handle(gap(230, 290))
    assert summary.main.missing == 210.0  # as a restarted node reports it


def test_a_live_session_of_years_keeps_the_latest_and_counts_all(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.monitoring.summary.KEPT_WINDOWS", 3)
    summary = SessionSummary("live", "t1", live=True)
    for window in range(10):
        summary.handle(estimate(window, mode("m1", 1.0, 0.1)))
        summary.handle(gap(2 * window, 2 * window + 1))
    summary.handle(replace(status("identification"), busy_s=5.0))
    assert [each.window for each in summary.main.estimates] == [7, 8, 9]
    figures = summary.as_json(wall=1.0)
    assert figures["timing"]["identify_s_per_window"] == 0.5
    assert figures["windows"]["identified"] == 10
    assert (figures["stream"]["gaps"], figures["stream"]["gap_s"]) == (10, 10.0)


def test_a_farms_summary_has_every_turbine() -> None:
    summary = SessionSummary("replay:x", "t1")
    for turbine in ("t1", "t2", "t3"):
        for sequence in range(3):
            summary.run.fold(block(sequence, turbine=turbine))
        summary.handle(replace(estimate(0, mode("m1", 0.3, 0.1)), turbine=turbine))
    summary.handle(StreamGap("t2", "tower", "s", START_NS, START_NS + 4 * NANOSECONDS, 3, 4))
    figures = summary.as_json(wall=1.0)

    turbines = figures["turbines"]
    assert [each["turbine"] for each in turbines] == ["t1", "t2", "t3"]
    assert [each["windows"]["identified"] for each in turbines] == [1, 1, 1]
    assert [each["stream"]["gaps"] for each in turbines] == [0, 1, 0]
    assert [each["stream"]["published"] for each in turbines[1:]] == [3, 3]
    assert figures["stream"]["published"] == 9
    assert {**figures, "turbines": None} == {**turbines[0], "turbines": None}
