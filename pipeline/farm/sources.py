"""Where a farm's posteriors come from: recordings, or sessions that run."""

import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

from pipeline.farm.settings import FarmError
from pipeline.messages import FoundationPosterior
from pipeline.recording.reader import read_messages
from pipeline.transport.bus import Bus, Inbox

FIRST_PATIENCE = 10.0  # for the first posterior of a session that runs [s]
QUIET_STORE = 1.0  # without a further one: all have come that were kept [s]


def recorded_posteriors(paths: Sequence[Path]) -> list[FoundationPosterior]:
    """Return the last posterior of every turbine in some recordings, or in all of some folders.

    Raises FarmError where there is none, RecordingError for a file that cannot be read.
    """
    latest: dict[str, FoundationPosterior] = {}
    for path in _files(paths):
        for message in read_messages(path, (FoundationPosterior,)):
            assert isinstance(message, FoundationPosterior)
            before = latest.get(message.turbine)
            if before is None or message.time_ns >= before.time_ns:
                latest[message.turbine] = message
    if not latest:
        names = ", ".join(map(str, paths))
        raise FarmError(f"no posterior is recorded in {names}; `pilewatch run` makes some")
    return list(latest.values())


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
    """The last posterior of every turbine of the sessions that a bus reaches.

    Publishers keep their last posteriors, so that one who comes late gets them at once.
    """

    def __init__(self, bus: Bus) -> None:
        self._inbox = Inbox()
        self._subscription = bus.subscribe((FoundationPosterior,), self._inbox)
        self._latest: dict[str, FoundationPosterior] = {}

    def posteriors(self) -> list[FoundationPosterior]:
        """Return the posteriors of now. Raises FarmError where none comes in FIRST_PATIENCE."""
        self._take_all(FIRST_PATIENCE)
        if not self._latest:
            raise FarmError(
                f"no posterior came in {FIRST_PATIENCE:g} s; a session has one after its first "
                "window, and `pilewatch status` says how it does"
            )
        return list(self._latest.values())

    def rounds(
        self, stopping: threading.Event, quiet: float = QUIET_STORE
    ) -> Iterator[list[FoundationPosterior]]:
        """Yield all latest posteriors, each time that new ones have come and, for `quiet` [s], no
        further one; until `stopping` is set."""
        while not stopping.is_set():
            if self._take_all(0.2, quiet):
                yield list(self._latest.values())

    def _take_all(self, patience: float, quiet: float = QUIET_STORE) -> int:
        """Wait for a posterior, then for more as long as they come; how many came."""
        count, deadline = 0, time.monotonic() + patience
        while (left := deadline - time.monotonic()) > 0:
            message = self._inbox.get(timeout=left)
            if message is None:
                break
            assert isinstance(message, FoundationPosterior)
            before = self._latest.get(message.turbine)
            if before is None or message.time_ns >= before.time_ns:
                self._latest[message.turbine] = message
            count, deadline = count + 1, time.monotonic() + quiet
        return count

    def close(self) -> None:
        """Listen no more."""
        self._subscription.close()
