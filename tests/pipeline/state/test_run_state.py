"""RunState: each message folded once; summary, status, figures and indicators agree on it."""

from dataclasses import replace

import pytest

from pipeline.messages import (
    FoundationPosterior,
    FoundationTruth,
    QualityWarning,
    WindowRejected,
    same_window,
)
from pipeline.monitoring.status import status_figures
from pipeline.monitoring.summary import run_figures, turbine_figures
from pipeline.state.run_state import RunState
from pipeline.viewer.pictures.status_text import SessionStatus
from tests.pipeline.example_messages import START_NS, block, rejection, status
from tests.pipeline.report.example_session import estimate as long_window
from tests.pipeline.report.example_session import session
from tests.pipeline.state.test_run_modes import WINDOW, estimate, mode


def folded(**settings: object) -> RunState:
    """The state after the example session, by a clock that stands still."""
    run = RunState(**settings)  # type: ignore[arg-type]
    for message in session():
        run.fold(message, START_NS)
    return run


def test_summary_status_and_report_are_functions_of_one_state() -> None:
    run = folded()
    (turbine,) = run.turbines
    summary = run_figures(run, turbine, source="replay:x")
    assert summary == {"source": "replay:x"} | turbine_figures(run, turbine)
    assert summary == run_figures(run, turbine, source="replay:x")  # asked again, nothing moves
    answer = status_figures(run, START_NS)
    assert answer["books"] == summary["books"]
    assert len(answer["gaps"]) == summary["stream"]["gaps"]
    assert answer["posteriors"][0]["windows"] == summary["posterior"]["windows"]


def test_the_indicators_are_the_same_from_few_windows_as_from_all() -> None:
    status_of_all = SessionStatus("t1")
    for message in session():
        status_of_all.take(message)
    assert len(status_of_all.state.estimates) <= 5 < len(folded().turbine("t1").estimates)
    assert status_of_all.state.n_rejected == folded().turbine("t1").rejections.total()
    assert status_of_all.state.n_gaps == len(folded().turbine("t1").gaps)


def test_the_books_of_a_farm_are_those_of_its_turbines() -> None:
    run = RunState()
    for turbine in ("t1", "t2"):
        for sequence in range(3):
            run.fold(block(sequence, turbine=turbine))
    run.fold(WindowRejected("t2", 0, START_NS, START_NS + WINDOW, "gap", "gap of 2 s"))
    run.fold(estimate(0, mode("m1", 0.3, 0.1)))
    both, second = run.books.as_json(), run.books.as_json("t2")
    assert [each["turbine"] for each in both["units"]] == ["t1", "t2"]
    assert [each["turbine"] for each in second["units"]] == ["t2"]
    assert second["turbines"] == [each for each in both["turbines"] if each["turbine"] == "t2"]
    assert run.published == 6


def test_what_is_let_go_stays_counted() -> None:
    run = RunState(kept=2)
    for window in range(5):
        run.fold(estimate(window, mode("m1", 1.0, 0.1)))
        run.fold(status("recorder"))
    state = run.turbine("t1")
    assert [each.window for each in state.estimates] == [3, 4]
    assert state.gone["windows"] == 3
    assert state.received["ModalEstimate"] == 5
    assert list(state.statuses) == ["recorder"]


def test_a_live_run_keeps_few_truths_and_the_latest_received_last(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.state.turbine_state.MOST_TRUTHS", 2)
    run = RunState(kept=5)
    for time_ns in (3, 1, 4, 2, 1):
        run.fold(FoundationTruth("t1", time_ns, 1.0, 1.0, 0.1 * time_ns))
    state = run.turbine("t1")
    assert list(state.truths) == [2, 1]
    assert state.truth is not None
    assert state.truth.time_ns == 1


def test_the_truth_is_that_of_the_posteriors_window_though_a_later_one_has_come() -> None:
    """A replay at full speed is ahead of the windows' answers by a third of an hour."""
    given = next(each for each in session() if isinstance(each, FoundationPosterior))
    state = RunState().turbine("t1")
    for time_ns in (100, 300):
        state.fold(FoundationTruth("t1", time_ns, 1.0, 1.0, 0.1 * time_ns))
    assert state.truth is not None
    assert state.truth.time_ns == 300
    for end_ns, since in ((50, 100), (299, 100), (300, 100), (301, 300), (400, 300)):
        state.fold(replace(given, time_ns=end_ns))
        assert state.truth is not None
        assert state.truth.time_ns == since


def test_modes_and_warnings_of_a_live_run_are_of_all_windows_although_few_are_kept() -> None:
    live, whole = RunState(kept=1000), RunState()
    for window in range(30):
        seen = mode("m1", 1.0 + 0.01 * window, 0.1 + 0.001 * abs(window - 3))
        text = f"two modes near {1 + window} Hz"
        warned = estimate(window, seen, warnings=(QualityWarning("close", text),))
        for run in (live, whole, live):  # as after a restart
            run.fold(warned)
    kept, of_all = live.turbine("t1"), whole.turbine("t1")
    assert [each.window for each in kept.estimates] == [22, 23, 24, 25, 26, 27, 28, 29]
    assert kept.gone["windows"] == 22
    assert [each.as_json() for each in kept.modes] == [each.as_json() for each in of_all.modes]
    assert kept.modes[0].shape == (1.0, 1.03)  # of the window that saw it sharpest, long gone
    assert kept.warnings == of_all.warnings
    assert len(kept.warnings) == 30


def test_modes_and_warnings_are_kept_beside_the_nodes_of_a_session_of_another_name() -> None:
    """A live session has its scenario's name until a unit sends under its own: on main before, its
    summary had no modes and no warning of a window, whatever was identified."""
    run = RunState(kept=3, once=True)
    run.fold(replace(status("recorder"), turbine="scenario"))
    warned = replace(estimate(0, mode("m1", 1.0, 0.1)), warnings=(QualityWarning("code", "text"),))
    run.fold(warned)
    (reported,) = run.measured.values()
    assert set(reported.statuses) == {"recorder"}
    assert [each.name for each in reported.modes] == ["m1"]
    assert [each.code for each in reported.warnings] == ["code"]
    assert len(run_figures(run, reported.turbine, source="live", live=True)["modes"]) == 1


def test_what_a_live_run_keeps_of_tracks_and_warnings_is_bounded(monkeypatch) -> None:
    monkeypatch.setattr("pipeline.state.turbine_state.MOST_TRACKS", 3)
    monkeypatch.setattr("pipeline.state.turbine_state.MOST_WINDOW_WARNINGS", 2)
    run = RunState(kept=1000)
    for window in range(6):
        warning = QualityWarning(f"code {window}", "")
        modes = (mode("m1", 9.0, 0.1), mode(f"new {window}", window, 0.1))
        run.fold(estimate(window, *modes, warnings=(warning,)))
    state = run.turbine("t1")
    assert [each.name for each in state.modes] == ["new 4", "new 5", "m1"]
    assert state.modes[-1].seen_in_windows == 6
    assert [each.code for each in state.warnings] == ["code 4", "code 5"]


def test_a_rejection_that_comes_again_is_kept_once_beside_others() -> None:
    run = RunState()
    for window in (0, 1, 0, 1, 2):
        run.fold(rejection(window))
    kept = run.turbine("t1")
    assert [each.window for each in kept.rejected] == [0, 1, 2]
    assert kept.rejections == {"gap": 5}


def test_a_block_that_comes_again_counts_again_unless_it_is_asked_otherwise() -> None:
    counts = []
    for run in (RunState(), RunState(once=True)):
        for number in (0, 1, 1):
            run.fold(block(number))
        counts.append(run.turbine("t1").published)
    assert counts == [3, 2]


def test_late_blocks_and_those_of_a_unit_that_starts_again_under_its_name_count() -> None:
    run = RunState(once=True)
    again = [replace(block(n), start_ns=block(100 + n).start_ns) for n in (0, 1)]
    for each in (*map(block, (0, 1, 3, 2, 2)), *again, again[1]):
        run.fold(each)
    assert run.published == 6


def test_of_more_turbines_than_a_live_run_keeps_the_one_with_fewest_messages_goes(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.state.run_state.MOST_TURBINES_KNOWN", 3)
    live, whole = RunState(kept=10), RunState()
    for run in (live, whole):
        for turbine, n_blocks in (("a", 2), ("b", 1), ("c", 3), ("d", 1), ("d", 1)):
            for sequence in range(n_blocks):
                run.fold(block(sequence, turbine=turbine))
    assert list(live.turbines) == ["a", "c", "d"]
    assert list(whole.turbines) == ["a", "b", "c", "d"]


def test_answers_are_of_one_window_by_their_blocks_or_else_by_their_start() -> None:
    """Older recordings do not say which blocks a window is of."""
    origins = (("tower", "session-1", 0),)
    first, second = estimate(0), estimate(1)
    assert same_window(first, replace(first, end_ns=1))
    assert not same_window(first, second)
    assert not same_window(first, replace(first, turbine="t2"))
    assert same_window(replace(first, origins=origins), first)
    assert same_window(first, replace(first, origins=origins))
    assert same_window(replace(first, origins=origins), replace(second, origins=origins))
    later = (("tower", "session-1", 1),)
    assert not same_window(replace(first, origins=origins), replace(first, origins=later))


MONTH = 2_592_000  # [s]


def test_measured_time_is_what_was_sampled_of_units_in_parallel_once_pauses_not() -> None:
    run = RunState()
    for number in (*range(10), *range(MONTH, MONTH + 10)):
        run.fold(block(number))
        run.fold(block(number, unit="nacelle"))
    run.fold(block(MONTH + 5))  # sent again
    state = run.reported("t1")
    assert (state.measured_time, state.duration) == (20.0, MONTH + 10.0)
    figures = turbine_figures(run, "t1", wall=2.0)
    assert (figures["measured_s"], figures["duration_s"]) == (20.0, MONTH + 10.0)
    assert figures["timing"]["realtime_factor"] == 10.0


def test_units_that_measure_one_after_the_other_both_count_and_so_does_a_late_block() -> None:
    run = RunState()
    for number in range(10):
        run.fold(block(number))
    for number in range(10, 30):
        run.fold(block(number, unit="nacelle"))
    assert run.reported("t1").measured_time == 30.0
    late = RunState()
    for number in (0, 1, 3, 4, 2):
        late.fold(block(number))
    assert late.reported("t1").measured_time == 5.0


def test_windows_stand_for_samples_that_have_gone() -> None:
    run = RunState()
    for window in range(3):
        run.fold(long_window(window))
    assert run.reported("t1").measured_time == 3 * 600.0
