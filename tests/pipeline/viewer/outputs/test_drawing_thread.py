"""Pictures never hold or break a session."""

import logging
import threading

import pytest

from pipeline.messages import Message
from pipeline.viewer.outputs.drawing_thread import DirectDrawing, DrawingThread
from tests.pipeline.viewer.session import node_status

MESSAGE = node_status("running", 0)


class Drawing:
    """Notes what it was asked to draw; can hang or break."""

    def __init__(self, *, breaks: bool = False) -> None:
        self.open = threading.Event()
        self.open.set()
        self.drawn: list[Message] = []
        self.ended = ""
        self._breaks = breaks

    def take(self, message: Message) -> None:
        self.open.wait(30.0)
        if self._breaks:
            raise RuntimeError("no picture")
        self.drawn.append(message)

    def finish(self) -> None:
        self.ended = "finished"

    def disconnect(self) -> None:
        self.ended = "abandoned"

    def stop_waiting(self) -> None:
        self.ended = "left behind"


def test_a_broken_drawing_is_logged_once_and_then_left_alone(caplog: pytest.LogCaptureFixture):
    drawing = Drawing(breaks=True)
    thread = DirectDrawing(drawing, strict=False)
    with caplog.at_level(logging.ERROR):
        for _ in range(3):
            thread.take(MESSAGE)
        thread.close()
    assert len(caplog.records) == 1
    assert drawing.ended == "abandoned"


def test_an_exception_while_drawing_is_raised_in_tests():
    with pytest.raises(RuntimeError, match="no picture"):
        DirectDrawing(Drawing(breaks=True), strict=True).take(MESSAGE)


def test_a_drawing_in_its_own_thread_gets_every_message_in_order():
    drawing = Drawing()
    thread = DrawingThread(drawing)
    messages = [node_status("running", sequence) for sequence in range(50)]
    for message in messages:
        thread.take(message)
    thread.close()
    assert drawing.drawn == messages
    assert drawing.ended == "finished"


def test_a_frozen_viewer_blocks_nothing(caplog: pytest.LogCaptureFixture):
    drawing = Drawing()
    drawing.open.clear()
    thread = DrawingThread(drawing, backlog=5, timeout=0.05)
    with caplog.at_level(logging.WARNING):
        for _ in range(20):
            thread.take(MESSAGE)  # returns though nothing is drawn
        thread.close()
    assert drawing.ended == "left behind"
    left = [each for each in threading.enumerate() if each.name == "viewer"]
    assert left  # it hangs
    assert all(each.daemon for each in left)  # and the process ends without it
    assert [record.levelname for record in caplog.records] == ["WARNING", "WARNING"]
    drawing.open.set()


def test_a_viewer_that_breaks_in_its_thread_breaks_nothing_else(caplog: pytest.LogCaptureFixture):
    thread = DrawingThread(Drawing(breaks=True))
    with caplog.at_level(logging.ERROR):
        thread.take(MESSAGE)
        thread.take(MESSAGE)
        thread.close()
    assert [record.levelname for record in caplog.records] == ["ERROR"]
