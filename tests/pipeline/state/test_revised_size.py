"""An event keeps its first size; the posteriors since give the revised one."""

from dataclasses import replace

import pytest

from pipeline.messages import RelativeStiffness
from pipeline.monitoring.summary import SessionSummary
from pipeline.state.turbine_state import TurbineState
from pipeline.viewer.pictures.status_text import SessionStatus
from tests.pipeline.example_messages import block
from tests.pipeline.report.example_session import WINDOW_NS, event, posterior

EVENT, POSTERIOR = event(), posterior(3)


def posterior_after(event, windows, median):
    spring = RelativeStiffness("k22", median, median - 0.02, median + 0.02, event.since_ns)
    return replace(POSTERIOR, time_ns=event.time_ns + windows * WINDOW_NS, relative=(spring,))


def folded(messages):
    state = TurbineState(EVENT.turbine)
    for message in messages:
        state.fold(message)
    return state


def test_the_latest_posterior_before_the_next_event_gives_the_size():
    second = replace(EVENT, time_ns=EVENT.time_ns + 5 * WINDOW_NS)
    state = folded(
        [
            EVENT,
            posterior_after(EVENT, 0, 0.86),
            posterior_after(EVENT, 3, 0.9),
            second,
            posterior_after(second, 0, 0.5),
        ]
    )
    first, last = (state.revised_size(event) for event in (EVENT, second))
    assert first is not None
    assert last is not None
    assert first.springs[0].median == 0.9
    assert first.n_posteriors == 2
    assert last.springs[0].median == 0.5
    assert "k22 -10.0% (-12.0% to -8.0%)" in first.text


def test_of_a_live_run_that_keeps_few_posteriors_all_are_counted():
    messages = [posterior_after(EVENT, -1, 1.0), EVENT]
    messages += [posterior_after(EVENT, windows, 0.9) for windows in range(7)]
    status = SessionStatus(EVENT.turbine)
    for message in messages:
        status.take(message)
    assert len(status.state.posteriors) < 7
    assert status.state.revised_size(EVENT) == folded(messages).revised_size(EVENT)
    assert "(posteriors: 7)" in status.markdown()


def test_without_a_posterior_since_there_is_none():
    assert folded([EVENT]).revised_size(EVENT) is None


def test_the_summary_has_both_sizes():
    summary = SessionSummary(source="test", turbine=EVENT.turbine)
    for message in (block(0), EVENT, posterior_after(EVENT, 2, 0.9)):
        list(summary.handle(message))
    (event,) = summary.as_json(wall=1.0)["events"]
    assert event["changes"]["k22"]["median"] == EVENT.changes[1].median
    revised = event["revised"]["changes"]["k22"]
    assert revised["median"] == pytest.approx(-0.1)
    assert [revised["p05"], revised["p95"]] == pytest.approx([-0.12, -0.08])
