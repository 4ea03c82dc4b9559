"""Where a farm's posteriors and events come from: recordings, or sessions that run."""

import logging
import threading
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from functools import partial
from pathlib import Path

from pipeline.farm.settings import FarmError
from pipeline.messages import FoundationEvent, FoundationPosterior, Message
from pipeline.recording.reader import read_messages
from pipeline.recording.rotation import session_in
from pipeline.recording.salvage import what_to_do
from pipeline.recording.writer import ACTIVE_SUFFIX
from pipeline.transport.bus import Bus, Inbox
from sensors.acquisition.blocks import NANOSECONDS

logger = logging.getLogger(__name__)

FIRST_PATIENCE = 10.0  # for the first posterior of a session that runs [s]
QUIET_STORE = 1.0  # without a further one: all have come that were kept [s]


_UNFINISHED = f"*.mcap{ACTIVE_SUFFIX}"

FarmMessage = FoundationPosterior | FoundationEvent
FARM_MESSAGES = (FoundationPosterior, FoundationEvent)


class _Collected:
    """The last posterior of every turbine, and every event once."""

    def __init__(self) -> None:
        self._latest: dict[str, FoundationPosterior] = {}
        self._first_ns: dict[str, int] = {}  # of its posteriors, the earliest
        self._events: dict[tuple[str, int], FoundationEvent] = {}

    def take(self, message: Message) -> None:
        """Take one of FARM_MESSAGES, of any time."""
        if isinstance(message, FoundationEvent):
            self._events[message.turbine, message.since_ns] = message
            return
        assert isinstance(message, FoundationPosterior)
        first_ns = self._first_ns.get(message.turbine, message.time_ns)
        self._first_ns[message.turbine] = min(first_ns, message.time_ns)
        before = self._latest.get(message.turbine)
        if before is None or message.time_ns >= before.time_ns:
            self._latest[message.turbine] = message

    @property
    def posteriors(self) -> list[FoundationPosterior]:
        """The last one of every turbine."""
        return list(self._latest.values())

    @property
    def events(self) -> list[FoundationEvent]:
        """Every one once."""
        return list(self._events.values())

    def span_ns(self, turbine: str) -> tuple[int, int] | None:
        """Times of a turbine's first and last posterior [ns]; None: it has none."""
        last = self._latest.get(turbine)
        return None if last is None else (self._first_ns[turbine], last.time_ns)

    def messages(self) -> list[FarmMessage]:
        """Posteriors, then events; nothing where there is no posterior."""
        return [*self._latest.values(), *self._events.values()] if self._latest else []


def recorded_turbines(paths: Sequence[Path]) -> list[FarmMessage]:
    """The last posterior of every turbine and the events in recordings, or in all of some folders.

    Of a turbine that has posteriors in several sessions the latest by time is used; each other
    session is named in a warning. Of a time that several sessions saw, such as recordings that were
    analysed twice, the latest one's events count: others date the same change to another window.

    Parameters
    ----------
    paths : sequence of Path
        Recordings, folders with recordings or sessions, or folders of such folders.

    Raises
    ------
    FarmError
        Where there is no posterior.
    RecordingError
        For a file that cannot be read.
    """
    collected = _Collected()
    latest: dict[str, tuple[int, Path]] = {}  # turbine → end of its window [ns], session
    sessions: list[_Collected] = []
    for session in _sessions(paths):
        own = _Collected()
        sessions.append(own)
        for file in session:
            for message in read_messages(file, FARM_MESSAGES):
                own.take(message)
                collected.take(message)
        for posterior in own.posteriors:
            found = (posterior.time_ns, session[-1])
            before = latest.get(posterior.turbine)
            if before is None:
                latest[posterior.turbine] = found
                continue
            used, unused = (found, before) if found[0] >= before[0] else (before, found)
            latest[posterior.turbine] = used
            logger.warning("%s", _not_used(posterior.turbine, unused, used))
    if not collected.posteriors:
        names = ", ".join(map(str, paths))
        raise FarmError(f"no posterior is recorded in {names}; `pilewatch run` makes some")
    return [*collected.posteriors, *_events_once(sessions)]


def _events_once(sessions: Sequence[_Collected]) -> Iterator[FoundationEvent]:
    """Yield each turbine's events from its latest session on, without those of a time that one
    before had seen.

    Why by the event's time and not by whole sessions: what an earlier session saw before the used
    one began is in no other's record.
    """
    # of two that end together the one that was given later comes first, as it is used
    backwards = sessions[::-1]
    for turbine in dict.fromkeys(each.turbine for own in sessions for each in own.events):
        events: dict[int, FoundationEvent] = {}
        seen: list[tuple[int, int]] = []
        for own in sorted(backwards, key=partial(_last_ns, turbine), reverse=True):
            for event in own.events:
                if event.turbine == turbine and not any(_within(event, each) for each in seen):
                    events.setdefault(event.since_ns, event)
            span = own.span_ns(turbine)
            if span is not None:
                seen.append(span)
        yield from events.values()


def _last_ns(turbine: str, session: _Collected) -> int:
    """Time of a session's last posterior [ns]; one without any comes after all others."""
    span = session.span_ns(turbine)
    return 0 if span is None else span[1]


def _within(event: FoundationEvent, span: tuple[int, int]) -> bool:
    """Whether an event may be of a span of time, by how well it is dated."""
    earliest = min(event.since_ns, event.since_earliest_ns)
    return earliest <= span[1] and max(event.since_ns, event.since_latest_ns) >= span[0]


def _not_used(turbine: str, unused: tuple[int, Path], used: tuple[int, Path]) -> str:
    """Return in words which of two sessions of one turbine is not used, and why."""
    if unused[0] == used[0]:
        why = f"{used[1]} has one of the same time and was given later"
    else:
        why = f"{used[1]} has a later one ({_utc(used[0])})"
    return f"{turbine}: the posterior in {unused[1]} ({_utc(unused[0])}) is not used: {why}"


def _utc(time_ns: int) -> str:
    return f"{datetime.fromtimestamp(time_ns // NANOSECONDS, UTC):%Y-%m-%d %H:%M:%S} UTC"


def _sessions(paths: Sequence[Path]) -> Iterator[list[Path]]:
    """Yield the files of each session: a folder's with its starts; other recordings one by one."""
    for path in paths:
        if not path.is_dir():
            yield [path]
            continue
        found = [*_sessions_in(path)] or [*_sessions_below(path)]
        if not found:
            raise FarmError(_without_recording(path))
        yield from found


def _sessions_below(folder: Path) -> Iterator[list[Path]]:
    for below in sorted(each for each in folder.iterdir() if each.is_dir()):
        found = [*_sessions_in(below)]
        if not found and any(below.glob(_UNFINISHED)):
            logger.warning("not used: %s", _without_recording(below))
        yield from found


def _sessions_in(folder: Path) -> Iterator[list[Path]]:
    session, _ = session_in(folder)
    others = [[file] for file in sorted(folder.glob("*.mcap")) if file not in session]
    yield from [*others, session] if session else others


def _without_recording(folder: Path) -> str:
    for unfinished in sorted(folder.glob(_UNFINISHED)):
        return (
            f"the folder {folder} holds only {unfinished.name}: its run goes on (give no file, but "
            f"--out {folder}), or was killed; {what_to_do(unfinished)}"
        )
    return f"the folder {folder} holds no recording (*.mcap), nor does a folder in it"


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
