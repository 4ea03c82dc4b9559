"""Alarm messages wait on disk, and one thread a channel delivers them, oldest first.

    FOLDER/webhook-1/1760000000000000.json  one message a file; removed when it is delivered
    FOLDER/webhook-1/refused/               messages that the receiver refused MOST_REFUSALS times

While a receiver is away its channel tries again after 1, 2, 4 … seconds, at most every five
minutes. A message that is refused for itself does not hold up those behind it, and theirs are no
attempts of its own: a burst of messages does not use up its MOST_REFUSALS. Restarts and cuts
lose nothing up to a bound: beyond MOST_WAITING the oldest are dropped and counted.
"""

import json
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

from pipeline.monitoring.alarms.channels import AlarmChannel, DeliveryFailed
from sensors.acquisition.blocks import NANOSECONDS
from sensors.atomic_write import written_whole

logger = logging.getLogger(__name__)

MOST_WAITING = 1000  # messages of one channel
MOST_REFUSALS = 12  # of one message: with the pauses about half an hour, longer than greylisting
FIRST_PAUSE, LONGEST_PAUSE = 1.0, 300.0  # between attempts [s]
REFUSED_DELIVERY = "refused"


@dataclass(frozen=True, slots=True)
class WaitingMessage:
    """An alarm message with the state of its delivery, as its file has it."""

    message: dict[str, Any]
    """As `AlarmMessage.as_json` has it, with `serial`, `host` and `session`."""
    queued_ns: int
    """When it was put into the outbox [ns since 1970-01-01 UTC]."""
    refusals: int = 0
    """How often the receiver refused it for itself [-]."""
    recipients: tuple[str, ...] = ()
    """Recipients that have not got it; empty: all."""

    def encoded(self) -> bytes:
        """Return the message as JSON."""
        return json.dumps(asdict(self), ensure_ascii=False).encode()


def decoded_waiting(content: bytes) -> WaitingMessage:
    """Return the message of a file, of earlier versions too (the message alone).

    Raises
    ------
    ValueError
        If it is none.
    """
    table = json.loads(content)
    if not isinstance(table, dict):
        raise ValueError(f"{content[:40]!r} is no alarm message")
    if "message" not in table:
        return WaitingMessage(table, int(table.get("last_ns", 0)))
    if not isinstance(table["message"], dict):
        raise ValueError(f"{content[:40]!r} is no alarm message")
    return WaitingMessage(
        table["message"],
        int(table.get("queued_ns", 0)),
        int(table.get("refusals", 0)),
        tuple(str(each) for each in table.get("recipients", ())),
    )


class Outbox:
    """The messages of one channel that wait. One thread puts, another takes.

    Parameters
    ----------
    folder : Path
        Of the channel.
    most : int
        Messages that are kept.
    clock : callable
        Time [ns since 1970-01-01 UTC].
    """

    def __init__(
        self, folder: Path, most: int = MOST_WAITING, clock: Callable[[], int] = time.time_ns
    ) -> None:
        self._folder, self._most, self._clock = folder, most, clock
        folder.mkdir(parents=True, exist_ok=True)
        kept = [*self.waiting(), *(folder / REFUSED_DELIVERY).glob("*.json")]
        self._next = max((int(path.stem) for path in kept), default=0) + 1
        self.dropped = 0  # beyond `most`

    def waiting(self) -> list[Path]:
        """Files of messages, oldest first."""
        files = (path for path in self._folder.glob("*.json") if path.stem.isdecimal())
        return sorted(files, key=lambda path: int(path.stem))

    def put(self, message: dict[str, Any]) -> None:
        """Keep a message until it is delivered. Raises OSError if the disk is full.

        Its serial is the time [µs], so that no other message has had it, whatever is left of the
        folder: receivers know by it what they have got. One of the same moment, or of a clock that
        was set back, has the next number.
        """
        queued_ns = self._clock()
        serial = max(self._next, queued_ns // 1000)
        path = self._folder / f"{serial:016d}.json"
        waiting = WaitingMessage(message | {"serial": serial}, queued_ns)
        self._next = serial + 1
        written_whole(path, waiting.encoded())
        files = self.waiting()
        for oldest in files[: max(0, len(files) - self._most)]:
            oldest.unlink(missing_ok=True)
            self.dropped += 1

    def age(self) -> float:
        """Return how long the oldest message has waited [s]; 0 if none waits."""
        for path in self.waiting():
            try:
                queued_ns = decoded_waiting(path.read_bytes()).queued_ns
            except (OSError, ValueError):
                continue
            return max(0, self._clock() - queued_ns) / NANOSECONDS
        return 0.0

    def set_aside(self, path: Path) -> None:
        """Keep a refused message where it is not tried again."""
        (self._folder / REFUSED_DELIVERY).mkdir(exist_ok=True)
        path.replace(self._folder / REFUSED_DELIVERY / path.name)


@dataclass(frozen=True, slots=True)
class DeliveryState:
    """What became of one channel's messages since the session's start."""

    channel: str
    """Name of the channel."""
    delivered: int
    """Messages that the receiver confirmed [-]."""
    failed: int
    """Attempts that failed [-]."""
    refused: int
    """Messages that were set aside after MOST_REFUSALS refusals [-]."""
    dropped: int
    """Messages beyond MOST_WAITING [-]."""
    waiting: int
    """Messages in the outbox [-]."""
    age: float
    """How long the oldest of them has waited [s]."""
    last_ns: int
    """When a message was last confirmed [ns since 1970-01-01 UTC]; 0: never."""
    problem: str
    """Why the last attempt failed; "" if it did not."""


class DeliveryThread(threading.Thread):
    """Delivers what waits in one channel's outbox until it is stopped.

    Parameters
    ----------
    channel : Channel
        To the receiver.
    outbox : Outbox
        Of that channel.
    pause : float
        Before the second attempt; each further one waits twice as long [s].
    clock : callable
        Time [ns since 1970-01-01 UTC].
    """

    def __init__(
        self,
        channel: AlarmChannel,
        outbox: Outbox,
        pause: float = FIRST_PAUSE,
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__(name=f"notices-{channel.name}", daemon=True)
        self._channel, self._outbox = channel, outbox
        self._pause, self._clock = pause, clock
        self._stopping = threading.Event()
        self._woken = threading.Event()
        self.problem = ""  # why the last attempt failed; "" if it did not
        self.refused = 0  # messages set aside
        self._delivered = self._failed = self._last_ns = 0
        self._refused_once: set[Path] = set()  # they wait for the end of the pause

    @property
    def channel(self) -> str:
        """Name of the channel."""
        return self._channel.name

    def state(self) -> DeliveryState:
        """Return the state of this moment; any thread may ask."""
        return DeliveryState(
            self._channel.name,
            self._delivered,
            self._failed,
            self.refused,
            self._outbox.dropped,
            len(self._outbox.waiting()),
            self._outbox.age(),
            self._last_ns,
            self.problem,
        )

    def wake(self) -> None:
        """A new message waits."""
        self._woken.set()

    def stop(self, patience: float) -> None:
        """Deliver what goes at once within `patience` [s]; the rest stays on disk."""
        self._stopping.set()
        self._woken.set()
        self.join(patience)

    def run(self) -> None:
        """Until `stop`."""
        pause, due = self._pause, 0.0
        while True:
            self._woken.clear()
            again = time.monotonic() >= due
            self._deliver_all(again=again)
            if self._stopping.is_set():
                return
            if not self.problem:
                pause, due = self._pause, 0.0
                self._woken.wait()
                continue
            if again:
                due = time.monotonic() + pause
                pause = min(2 * pause, LONGEST_PAUSE)
            self._woken.wait(max(0.0, due - time.monotonic()))  # a new message is tried at once

    def _deliver_all(self, *, again: bool) -> None:
        """One attempt for each waiting message, up to a failure that concerns them all; for those
        that were refused for themselves only `again`."""
        problem = ""
        waiting = self._outbox.waiting()
        self._refused_once.intersection_update(waiting)
        for path in waiting:
            if path in self._refused_once and not again:
                problem = problem or self.problem
                continue
            failure = self._failure(path)
            if failure is None:
                continue
            self._failed += 1
            problem = problem or str(failure)
            if not failure.message_only:
                break
            self._refused_once.add(path)
        if problem and not self.problem:
            logger.warning("%s: an alarm message waits: %s", self._channel.name, problem)
        self.problem = problem

    def _failure(self, path: Path) -> DeliveryFailed | None:
        """Try one file; None if it is delivered, or is no message."""
        try:
            waiting = decoded_waiting(path.read_bytes())
        except FileNotFoundError:
            return None  # dropped meanwhile: too many waited
        except (OSError, ValueError) as error:
            logger.warning("%s is no alarm message and is removed: %s", path, error)
            path.unlink(missing_ok=True)
            return None
        try:
            self._channel.send(waiting.message, waiting.recipients)
            path.unlink(missing_ok=True)
        except DeliveryFailed as failure:
            self._keep(path, waiting, failure)
            return failure
        except Exception as error:  # obspy raises bare Exceptions
            # Why all: no answer of a receiver, and no fault of a library, ends a channel; it is
            # reported as a failure, and the message waits.
            logger.debug("%s", self._channel.name, exc_info=True)
            fault = DeliveryFailed(f"{type(error).__name__}: {error}", message_only=True)
            self._keep(path, waiting, fault)
            return fault
        self._delivered += 1
        self._last_ns = self._clock()
        return None

    def _keep(self, path: Path, waiting: WaitingMessage, failure: DeliveryFailed) -> None:
        """Note on disk who has got a message that failed; set it aside after many refusals."""
        if not failure.message_only:
            return
        refusals = waiting.refusals + 1
        remaining = failure.remaining or waiting.recipients
        try:
            kept = replace(waiting, refusals=refusals, recipients=remaining)
            written_whole(path, kept.encoded())
            if refusals >= MOST_REFUSALS:
                self._outbox.set_aside(path)
                self.refused += 1
                logger.error("%s: a message is refused for good: %s", self._channel.name, failure)
        except OSError as error:
            logger.error("%s: the outbox cannot be written: %s", self._channel.name, error)
