"""Who is alive, what is late, what is missing: from what goes by."""

from dataclasses import replace

import pytest

from pipeline.messages import StreamEnd
from pipeline.state.health import Health
from tests.pipeline.example_messages import START_NS, block, rejection, status

SECOND = 10**9  # [ns]


def watched(*messages: object) -> Health:
    health = Health()
    for message in messages:
        health.observe(message, START_NS)
    return health


def condition(health: Health, seconds: float) -> str:
    (stream,) = (
        stream
        for stream in health.streams(START_NS + round(seconds * SECOND))
        if stream.key.endswith("acceleration")
    )
    return stream.condition


def test_a_stream_of_blocks_is_late_after_three_seconds_of_silence() -> None:
    health = watched(block(0))
    assert condition(health, 2.9) == "alive"
    assert condition(health, 3.1) == "late"


def test_a_stream_without_a_period_is_never_late() -> None:
    (stream,) = watched(rejection(0)).streams(START_NS + 10**6 * SECOND)
    assert stream.condition == "alive"


def test_a_unit_that_said_so_has_ended() -> None:
    end = StreamEnd("t1", "tower", "session-1", START_NS, 1)
    assert condition(watched(block(0), end), 100.0) == "ended"


def test_a_unit_that_starts_again_is_alive_again() -> None:
    end = StreamEnd("t1", "tower", "session-1", START_NS, 1)
    again = replace(block(0), session="session-2")
    assert condition(watched(block(0), end, again), 1.0) == "alive"
    assert condition(watched(block(0), end, again), 10.0) == "late"


def test_a_node_that_falls_silent_is_late_and_one_that_stopped_has_ended() -> None:
    health = watched(status("updating"), status("viewer", state="stopped"))
    nodes = {node.status.node: node for node in health.nodes(START_NS + 10 * SECOND)}
    assert nodes["updating"].condition == "late"
    assert nodes["updating"].silence == 10.0
    assert nodes["viewer"].condition == "ended"


def test_messages_are_counted_by_key() -> None:
    counts = {
        stream.key: stream.messages
        for stream in watched(block(0), block(1), block(0, turbine="t2")).streams(START_NS)
    }
    assert counts == {"pilewatch/t1/tower/acceleration": 2, "pilewatch/t2/tower/acceleration": 1}


def test_a_rate_counts_the_intervals_between_messages() -> None:
    """Eleven blocks, one a second, span ten seconds: one a second, not eleven tenths."""
    health = Health()
    for number in range(11):
        health.observe(block(number), START_NS + number * SECOND)
    (stream,) = health.streams(START_NS + 10 * SECOND)
    assert stream.rate == 1.0


def test_of_more_keys_than_are_watched_those_with_fewest_messages_go(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("pipeline.state.health.MOST_KEYS_WATCHED", 3)
    monkeypatch.setattr("pipeline.state.health.LET_GO", 1)
    turbines = ["a", "a", "b", "c", "c", "c", "b", "a", "d"]
    health = watched(*(block(number, turbine=name) for number, name in enumerate(turbines)))
    found = {each.key.split("/")[1]: each.messages for each in health.streams(START_NS)}
    assert found == {"a": 3, "c": 3, "d": 1}  # of b two had come


def test_a_rate_counts_from_the_first_message_and_needs_a_second() -> None:
    health = Health()
    for number in range(5):
        health.observe(block(number), START_NS + 2 * number * SECOND)
        (stream,) = health.streams(START_NS + 8 * SECOND)
        assert (stream.rate != stream.rate) if number == 0 else (stream.rate == 0.5)
