"""A sink that folds every message into a run's state, which any thread may ask for."""

import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from pipeline.messages import Message
from pipeline.nodes.node import Sink
from pipeline.state.run_state import RunState


class StateSink(Sink):
    """Keeps the state of a run.

    Parameters
    ----------
    kept : int
        Windows, rejections, gaps and events that are kept of a turbine, each.
    clock : callable
        → [ns since 1970-01-01 UTC]
    """

    def __init__(self, kept: int, clock: Callable[[], int]) -> None:
        self._clock = clock
        self._run = RunState(kept=kept)
        self._lock = threading.Lock()

    def handle(self, message: Message) -> Iterable[Message]:
        """Take note of a message. Gives nothing back."""
        with self._lock:
            self._run.fold(message, self._clock())
        return ()

    @contextmanager
    def _asked(self) -> Iterator[tuple[RunState, int]]:
        """The state and the time [ns], while no message comes in between."""
        with self._lock:
            yield self._run, self._clock()
