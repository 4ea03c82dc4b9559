"""Where a show runs: in the caller's thread (a file) or in its own (a viewer, which may hang).

Why a thread: the SDK holds the caller for as long as a viewer takes nothing, and a frozen window
must not hold a measurement.
"""

import contextlib
import logging
import queue
import threading
from collections.abc import Callable
from typing import Protocol

from pipeline.messages import Message

BACKLOG = 10_000  # messages that may wait for a viewer: hours of blocks, some 13 MB
CLOSING_PATIENCE = 5.0  # for a viewer to take what waits, at the end [s]
_log = logging.getLogger(__name__)


class Drawing(Protocol):
    """What a stage runs (pipeline.viewer.rerun_stream.Show)."""

    def take(self, message: Message) -> None:
        """Draw one message."""

    def finish(self) -> None:
        """Hand over what waits, let go."""

    def abandon(self) -> None:
        """Let go without drawing more."""

    def leave_behind(self) -> None:
        """Let nobody wait for what the output has not taken."""


class DirectDrawing:
    """Draws in the caller's thread.

    strict   True (tests): an exception goes to the caller. False: it is logged once, with its
             traceback, and nothing more is drawn; no picture is worth a session's measurements.
    """

    def __init__(self, drawing: Drawing, *, strict: bool) -> None:
        self._drawing = drawing
        self._strict = strict
        self._failed = False

    def take(self, message: Message) -> None:
        """Draw one message."""
        self._guarded(lambda: self._drawing.take(message))

    def close(self) -> None:
        """Draw what waits and let go of the output."""
        if self._failed:
            self._drawing.abandon()
        else:
            self._guarded(self._drawing.finish)

    def _guarded(self, step: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            step()
        except Exception:
            # Why so wide: the pipeline must outlive its pictures, whatever breaks in them.
            self._failed = True
            if self._strict:
                raise
            _log.exception("the viewer failed and shows nothing more; the session goes on")


class DrawingThread:
    """Draws in a thread of its own; `take` never waits.

    Messages that find BACKLOG others waiting are left out, which is logged once.
    """

    def __init__(
        self, drawing: Drawing, *, backlog: int = BACKLOG, patience: float = CLOSING_PATIENCE
    ) -> None:
        self._drawing = drawing
        self._stage = DirectDrawing(drawing, strict=False)
        self._waiting: queue.Queue[Message | None] = queue.Queue(maxsize=backlog)
        self._patience = patience
        self._left_out = 0
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def take(self, message: Message) -> None:
        """Leave one message to be drawn."""
        try:
            self._waiting.put_nowait(message)
        except queue.Full:
            if not self._left_out:
                _log.warning("the viewer takes nothing; what it misses is still recorded")
            self._left_out += 1

    def close(self) -> None:
        """Wait for what is left to be drawn, `patience` seconds at most, then leave it."""
        with contextlib.suppress(queue.Full):  # full and stuck: the thread will not end either
            self._waiting.put(None, timeout=self._patience)
        self._thread.join(self._patience)
        if self._thread.is_alive():
            _log.warning("the viewer did not take the last of the session; it is left behind")
            self._drawing.leave_behind()

    def _run(self) -> None:
        while (message := self._waiting.get()) is not None:
            self._stage.take(message)
        self._stage.close()
