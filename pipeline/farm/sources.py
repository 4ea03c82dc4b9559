"""Where a farm's posteriors and events come from: recordings, or sessions that run."""

import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.farm.settings import FarmError
from pipeline.messages import FoundationEvent, FoundationPosterior, Message
from pipeline.recording.reader import read_messages
from pipeline.transport.bus import Bus, Inbox

FIRST_PATIENCE = 10.0  # for the first posterior of a session that runs [s]
QUIET_STORE = 1.0  # without a further one: all have come that were kept [s]


FarmMessage = FoundationPosterior | FoundationEvent
FARM_MESSAGES = (FoundationPosterior, FoundationEvent)


class _Collected:
    """The last posterior of every turbine, and every event once."""

    def __init__(self) -> None:
        self._latest: dict[str, FoundationPosterior] = {}
        self._events: dict[tuple[str, int], FoundationEvent] = {}

    def take(self, message: Message) -> None:
        """Take one of FARM_MESSAGES, of any time."""
        if isinstance(message, FoundationEvent):
            self._events[message.turbine, message.since_ns] = message
            return
        assert isinstance(message, FoundationPosterior)
        before = self._latest.get(message.turbine)
        if before is None or message.time_ns >= before.time_ns:
            self._latest[message.turbine] = message

    def messages(self) -> list[FarmMessage]:
        """Posteriors, then events; nothing where there is no posterior."""
        return [*self._latest.values(), *self._events.values()] if self._latest else []


def recorded_turbines(paths: Sequence[Path]) -> list[FarmMessage]:
    """The last posterior of every turbine and the events in recordings, or in all of some folders.

    Raises FarmError where there is no posterior, RecordingError for a file that cannot be read.
    """
    collected = _Collected()
    for path in _files(paths):
        for message in read_messages(path, FARM_MESSAGES):
            collected.take(message)
    found = collected.messages()
    if not found:
        names = ", ".join(map(str, paths))
        raise FarmError(f"no posterior is recorded in {names}; `pilewatch run` makes some")
    return found


def _files(paths: Sequence[Path]) -> Iterator[Path]:
    for path in paths:
        if not path.is_dir():
            yield path
            continue
        found = sorted(path.glob("*.mcap"))
        if not found:
            raise FarmError(f"the folder {path} holds no recording (*.mcap)")
        yield from found


class RunningFarm:
    """The last posterior of every turbine of the sessions that a bus reaches, and their events.

    Publishers keep their last ones, so that one who comes late gets them at once.
    """

    def __init__(self, bus: Bus) -> None:
        self._inbox = Inbox()
        self._subscription = bus.subscribe(FARM_MESSAGES, self._inbox)
        self._collected = _Collected()

    def messages(self) -> list[FarmMessage]:
        """Return what is there now. Raises FarmError where no posterior comes in FIRST_PATIENCE."""
        self._take_all(FIRST_PATIENCE)
        found = self._collected.messages()
        if not found:
            raise FarmError(
                f"no posterior came in {FIRST_PATIENCE:g} s; a session has one after its first "
                "window, and `pilewatch status` says how it does"
            )
        return found

    def rounds(
        self, stopping: threading.Event, quiet: float = QUIET_STORE
    ) -> Iterator[list[FarmMessage]]:
        """Yield all that is known, each time that new ones have come and, for `quiet` [s], no
        further one; until `stopping` is set."""
        while not stopping.is_set():
            if self._take_all(0.2, quiet) and (found := self._collected.messages()):
                yield found

    def _take_all(self, patience: float, quiet: float = QUIET_STORE) -> int:
        """Wait for a posterior, then for more as long as they come; how many came."""
        count, deadline = 0, time.monotonic() + patience
        while (left := deadline - time.monotonic()) > 0:
            message = self._inbox.get(timeout=left)
            if message is None:
                break
            self._collected.take(message)
            count, deadline = count + 1, time.monotonic() + quiet
        return count

    def close(self) -> None:
        """Listen no more."""
        self._subscription.close()
