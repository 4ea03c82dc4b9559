"""A viewer may start late, stop or come back; the run continues and it gets what it missed.

The viewers here are sockets on loopback that understand nothing; what would be drawn on them is
noted.
"""

import logging
import socket
import struct
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass, field

import pytest

from pipeline.messages import FoundationPosterior, FoundationTruth, Message, ModalEstimate
from pipeline.viewer.outputs.outputs import ViewerError
from pipeline.viewer.outputs.reconnecting_viewer import (
    ReconnectingViewer,
    RememberedResults,
    ViewerProbe,
)
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

    def disconnect(self) -> None:
        self.ends.append("disconnected")

    def stop_waiting(self) -> None:
        """Nothing waits here."""

    def count(self, *kinds: type) -> int:
        return sum(isinstance(message, kinds) for message in self.messages)


class ViewerPort:
    """A reconnecting viewer at a free port, and the drawings that it opened."""

    def __init__(self) -> None:
        self.port = free_port(0)
        self.drawings: list[Drawn] = []
        self.drawing = ReconnectingViewer(proxy_address(self.port), self._open_drawing, period=0.0)

    def _open_drawing(self) -> Drawn:
        self.drawings.append(Drawn())
        return self.drawings[-1]

    def viewer(self) -> socket.socket:
        """A socket that listens there from now on."""
        return socket.create_server(("127.0.0.1", self.port))


def in_windows(n_windows: int) -> list[list[Message]]:
    """A session's messages, each part up to and with a window's posterior."""
    parts: list[list[Message]] = [[]]
    for message in session(Episode(n_windows=n_windows, block=60)):
        parts[-1].append(message)
        if isinstance(message, FoundationPosterior):
            parts.append([])
    return parts[:n_windows]


def play(drawing: ReconnectingViewer, messages: list[Message]) -> None:
    for message in messages:
        drawing.take(message)


@pytest.fixture
def port() -> Iterator[ViewerPort]:
    port = ViewerPort()
    yield port
    port.drawing.disconnect()


def test_a_viewer_that_comes_late_gets_the_results_so_far_and_every_block_from_then_on(
    port: ViewerPort, caplog: pytest.LogCaptureFixture
):
    first, second = in_windows(2)
    play(port.drawing, first)
    assert not port.drawings
    with closing(port.viewer()):
        play(port.drawing, second)
        port.drawing.finish()
    (late,) = port.drawings
    assert late.count(SensorLayout, FoundationTruth) == 2
    assert late.count(*RESULTS) == 4
    assert late.count(AccelerationBlock) == sum(isinstance(m, AccelerationBlock) for m in second)
    assert late.ends == ["finished"]


def test_what_is_drawn_first_is_what_the_rest_needs(port: ViewerPort):
    play(port.drawing, in_windows(1)[0])
    with closing(port.viewer()):
        port.drawing.finish()
    kinds = [type(message) for message in port.drawings[0].messages]
    assert kinds[0] is SensorLayout
    assert kinds.index(ModalEstimate) < kinds.index(FoundationPosterior)


def test_a_viewer_that_is_killed_and_restarted_gets_a_drawing_of_its_own(
    port: ViewerPort, caplog: pytest.LogCaptureFixture
):
    first, second, third = in_windows(3)
    viewer = port.viewer()
    play(port.drawing, first)
    taken, _ = viewer.accept()
    viewer.close()
    taken.close()
    with closing(port.viewer()), caplog.at_level(logging.WARNING):
        play(port.drawing, second)
        play(port.drawing, third)
        port.drawing.finish()
    before, after = port.drawings
    assert before.ends == ["disconnected"]
    assert before.count(FoundationPosterior) == 1
    assert after.count(FoundationPosterior) == 3
    assert ["has disconnected" in record.message for record in caplog.records] == [True]


def test_a_viewer_that_never_connects_is_logged_once_and_blocks_nothing(
    caplog: pytest.LogCaptureFixture,
):
    with caplog.at_level(logging.WARNING):
        drawing = ReconnectingViewer("rerun+http://127.0.0.1:1/proxy", Drawn, period=0.0)
        play(drawing, in_windows(1)[0])
        drawing.finish()
    (record,) = caplog.records
    assert "no viewer listens there yet" in record.message
    assert "rerun --bind 127.0.0.1 --port 1" in record.message


def test_a_viewer_that_disconnects_while_a_drawing_opens_is_tried_again():
    calls: list[Drawn] = []

    def gone_at_first() -> Drawn:
        calls.append(Drawn())
        if len(calls) == 1:
            raise ViewerError("it has just gone")
        return calls[-1]

    with closing(socket.create_server(("127.0.0.1", 0))) as viewer:
        drawing = ReconnectingViewer(
            proxy_address(viewer.getsockname()[1]), gone_at_first, period=0.0
        )
        play(drawing, in_windows(1)[0])
        drawing.finish()
    assert calls[1].count(FoundationPosterior) == 1


def test_the_past_is_bounded_and_holds_no_blocks():
    past = RememberedResults(size=3)
    for message in session(Episode(n_windows=4, block=60)):
        past.keep(message)
    kept = list(past)
    assert not any(isinstance(message, AccelerationBlock) for message in kept)
    assert sum(isinstance(message, RESULTS) for message in kept) <= 3
    assert any(isinstance(message, SensorLayout) for message in kept)


@pytest.mark.parametrize("is_reset", [False, True])
def test_a_viewer_is_up_until_it_closes_its_connection_or_resets_it(is_reset: bool) -> None:
    with socket.create_server(("127.0.0.1", 0)) as listening:
        probe = ViewerProbe(proxy_address(listening.getsockname()[1]))
        viewer, _ = listening.accept()
        with closing(probe):
            assert probe.is_up()
            if is_reset:  # closed without a farewell, as a process that is killed
                viewer.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
            viewer.close()
            assert not probe.is_up()
