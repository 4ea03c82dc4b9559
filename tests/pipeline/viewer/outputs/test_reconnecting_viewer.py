"""A viewer that comes late, goes, or comes back: the session goes on and it is told what it missed.

The viewers here are sockets on loopback that understand nothing; what would be drawn on them is
noted.
"""

import logging
import socket
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field

import pytest

from pipeline.messages import FoundationPosterior, FoundationTruth, Message, ModalEstimate
from pipeline.viewer.outputs.outputs import ViewerError
from pipeline.viewer.outputs.reconnecting_viewer import ReconnectingViewer, RememberedResults
from pipeline.viewer.outputs.viewer_process import free_port, proxy_address
from sensors.acquisition.blocks import AccelerationBlock
from sensors.acquisition.layout import SensorLayout
from tests.pipeline.viewer.session import Episode, session

RESULTS = (ModalEstimate, FoundationPosterior)


@dataclass
class Drawn:
    """A show that notes what it would draw."""

    messages: list[Message] = field(default_factory=list)
    ends: list[str] = field(default_factory=list)

    def take(self, message: Message) -> None:
        self.messages.append(message)

    def finish(self) -> None:
        self.ends.append("finished")

    def abandon(self) -> None:
        self.ends.append("abandoned")

    def leave_behind(self) -> None:
        """Nobody waits anyway."""

    def count(self, *kinds: type) -> int:
        return sum(isinstance(message, kinds) for message in self.messages)


class ScheduleStep:
    """A late show at a free port, and the shows that it began."""

    def __init__(self) -> None:
        self.port = free_port(0)
        self.begun: list[Drawn] = []
        self.show = ReconnectingViewer(proxy_address(self.port), self._begin, period=0.0)

    def _begin(self) -> Drawn:
        self.begun.append(Drawn())
        return self.begun[-1]

    def viewer(self) -> socket.socket:
        """Somebody who listens there from now on."""
        return socket.create_server(("127.0.0.1", self.port))


def in_windows(n_windows: int) -> list[list[Message]]:
    """A session's messages, each part up to and with a window's posterior."""
    parts: list[list[Message]] = [[]]
    for message in session(Episode(n_windows=n_windows, block=60)):
        parts[-1].append(message)
        if isinstance(message, FoundationPosterior):
            parts.append([])
    return parts[:n_windows]


def play(show: ReconnectingViewer, messages: list[Message]) -> None:
    for message in messages:
        show.take(message)


@pytest.fixture
def stage() -> Iterator[ScheduleStep]:
    stage = ScheduleStep()
    yield stage
    stage.show.abandon()


def test_a_viewer_that_comes_late_gets_the_results_so_far_and_every_block_from_then_on(
    stage: ScheduleStep, caplog: pytest.LogCaptureFixture
):
    first, second = in_windows(2)
    play(stage.show, first)
    assert not stage.begun
    with closing(stage.viewer()):
        play(stage.show, second)
        stage.show.finish()
    (late,) = stage.begun
    assert late.count(SensorLayout, FoundationTruth) == 2
    assert late.count(*RESULTS) == 4
    assert late.count(AccelerationBlock) == sum(isinstance(m, AccelerationBlock) for m in second)
    assert late.ends == ["finished"]


def test_what_is_drawn_first_is_what_the_rest_needs(stage: ScheduleStep):
    play(stage.show, in_windows(1)[0])
    with closing(stage.viewer()):
        stage.show.finish()
    kinds = [type(message) for message in stage.begun[0].messages]
    assert kinds[0] is SensorLayout
    assert kinds.index(ModalEstimate) < kinds.index(FoundationPosterior)


def test_a_viewer_that_is_killed_and_back_at_once_gets_a_show_of_its_own(
    stage: ScheduleStep, caplog: pytest.LogCaptureFixture
):
    first, second, third = in_windows(3)
    viewer = stage.viewer()
    play(stage.show, first)
    taken, _ = viewer.accept()
    viewer.close()
    taken.close()
    with closing(stage.viewer()), caplog.at_level(logging.WARNING):
        play(stage.show, second)
        play(stage.show, third)
        stage.show.finish()
    before, after = stage.begun
    assert before.ends == ["abandoned"]
    assert before.count(FoundationPosterior) == 1
    assert after.count(FoundationPosterior) == 3
    assert ["has gone" in record.message for record in caplog.records] == [True]


def test_a_viewer_that_never_comes_is_told_of_once_and_holds_nobody(
    caplog: pytest.LogCaptureFixture,
):
    with caplog.at_level(logging.WARNING):
        show = ReconnectingViewer("rerun+http://127.0.0.1:1/proxy", Drawn, period=0.0)
        play(show, in_windows(1)[0])
        show.finish()
    (record,) = caplog.records
    assert "no viewer listens there yet" in record.message
    assert "rerun --bind 127.0.0.1 --port 1" in record.message


def test_a_viewer_that_goes_while_a_show_begins_is_tried_again():
    calls: list[Drawn] = []

    def gone_at_first() -> Drawn:
        calls.append(Drawn())
        if len(calls) == 1:
            raise ViewerError("it has just gone")
        return calls[-1]

    with closing(socket.create_server(("127.0.0.1", 0))) as viewer:
        show = ReconnectingViewer(proxy_address(viewer.getsockname()[1]), gone_at_first, period=0.0)
        play(show, in_windows(1)[0])
        show.finish()
    assert calls[1].count(FoundationPosterior) == 1


def test_the_past_is_bounded_and_holds_no_blocks():
    past = RememberedResults(size=3)
    for message in session(Episode(n_windows=4, block=60)):
        past.keep(message)
    kept = list(past)
    assert not any(isinstance(message, AccelerationBlock) for message in kept)
    assert sum(isinstance(message, RESULTS) for message in kept) <= 3
    assert any(isinstance(message, SensorLayout) for message in kept)
