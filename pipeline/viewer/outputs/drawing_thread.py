"""Draw in the caller's thread (a file) or in a thread of its own (a viewer, which may hang).

Why a thread: the SDK blocks its caller while a viewer does not respond, and a frozen window must
not delay a measurement.
"""

import contextlib
import logging
import queue
import threading
from collections.abc import Callable
from typing import Protocol

from pipeline.messages import Message

BACKLOG = 10_000  # messages that may wait for a viewer: hours of blocks, some 13 MB
CLOSING_TIMEOUT = 5.0  # for a viewer to take what waits, at the end [s]
_log = logging.getLogger(__name__)


class Drawing(Protocol):
    """What draws messages on one output (`pipeline.viewer.rerun_stream.RerunStream`)."""

    def take(self, message: Message) -> None:
        """Draw one message."""

    def finish(self) -> None:
        """Draw what is buffered and close."""

    def disconnect(self) -> None:
        """Close without drawing more."""

    def stop_waiting(self) -> None:
        """Stop waiting for what the output has not accepted."""


class DirectDrawing:
    """Draw in the caller's thread.

    Parameters
    ----------
    strict : bool
        True (tests): an exception goes to the caller. False: it is logged once, with its
        traceback, and nothing more is drawn; the measurements go on.
    """

    def __init__(self, drawing: Drawing, *, strict: bool) -> None:
        self._drawing = drawing
        self._strict = strict
        self._failed = False

    def take(self, message: Message) -> None:
        """Draw one message."""
        self._run_step(lambda: self._drawing.take(message))

    def close(self) -> None:
        """Draw what is buffered and close the output."""
        if self._failed:
            self._drawing.disconnect()
        else:
            self._run_step(self._drawing.finish)

    def _run_step(self, step: Callable[[], None]) -> None:
        if self._failed:
            return
        try:
            step()
        except Exception:
            # Why so wide: the pipeline must outlive any failure of its pictures.
            self._failed = True
            if self._strict:
                raise
            _log.exception("the viewer failed and draws nothing more; the run continues")


class DrawingThread:
    """Draw in a thread of its own; `take` never waits.

    When BACKLOG messages wait, further ones are dropped, which is logged once.
    """

    def __init__(
        self, drawing: Drawing, *, backlog: int = BACKLOG, timeout: float = CLOSING_TIMEOUT
    ) -> None:
        self._drawing = drawing
        self._direct = DirectDrawing(drawing, strict=False)
        self._waiting: queue.Queue[Message | None] = queue.Queue(maxsize=backlog)
        self._timeout = timeout
        self._left_out = 0
        self._thread = threading.Thread(target=self._run, name="viewer", daemon=True)
        self._thread.start()

    def take(self, message: Message) -> None:
        """Queue one message to be drawn."""
        try:
            self._waiting.put_nowait(message)
        except queue.Full:
            if not self._left_out:
                _log.warning(
                    "the viewer does not respond; the messages it misses are still recorded"
                )
            self._left_out += 1

    def close(self) -> None:
        """Wait for the queue to be drawn, at most `timeout` seconds."""
        with contextlib.suppress(queue.Full):  # full and stuck: the thread will not end either
            self._waiting.put(None, timeout=self._timeout)
        self._thread.join(self._timeout)
        if self._thread.is_alive():
            _log.warning("the viewer did not accept the last messages; it is disconnected")
            self._drawing.stop_waiting()

    def _run(self) -> None:
        while (message := self._waiting.get()) is not None:
            self._direct.take(message)
        self._direct.close()
