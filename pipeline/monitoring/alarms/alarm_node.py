"""AlarmNode: the sink that tells, and the file that remembers what was told."""

import json
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pipeline.messages import Message, QualityWarning
from pipeline.monitoring.alarms.alarm_log import (
    AlarmLog,
    AlarmMessage,
    decoded_notices,
    encoded_notices,
)
from pipeline.monitoring.alarms.alarm_rules import AlarmRules
from pipeline.monitoring.alarms.channels import Channel
from pipeline.monitoring.alarms.outbox import Delivery, Outbox
from pipeline.monitoring.alarms.settings import AlarmLogSettings
from pipeline.nodes.node import NodeStatistics
from pipeline.recording.atomic_write import written_whole
from pipeline.streams import STREAMS
from sensors.errors import InputError

logger = logging.getLogger(__name__)

FOLDER, BOOK = "notices", "notices.json"  # within a session's folder
KEY = "pilewatch/@notices"  # no stream's key expression matches what begins with @
PATIENCE = 5.0  # at the end, for what is on its way [s]
CHECKED_EVERY = 1_000_000_000  # the book for ends and reminders [ns]


class AlarmNode:
    """Takes every message of a session, tells what is wrong, answers who acknowledges.

    folder     of the book and of what waits to go out
    channels   whom to tell
    clock      → [ns since 1970-01-01 UTC]
    """

    name = "notices"
    inputs: tuple[type, ...] = tuple(stream.message for stream in STREAMS)

    def __init__(
        self,
        folder: Path,
        settings: AlarmLogSettings,
        channels: Sequence[Channel],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / BOOK
        self._place = {"host": socket.gethostname(), "session": str(folder.resolve().parent)}
        self._clock = clock
        self._causes = AlarmRules(settings)
        self._book = AlarmLog(settings, notices_in(self._path))
        self._saved = self._book.notices
        self._asked = threading.Lock()
        self._checked_ns = 0
        self._outboxes = [Outbox(folder / channel.name) for channel in channels]
        self._deliveries = [
            Delivery(channel, outbox)
            for channel, outbox in zip(channels, self._outboxes, strict=True)
        ]
        self._save()  # from now on there is a book to ask for
        for delivery in self._deliveries:
            delivery.start()

    def handle(self, message: Message) -> Iterable[Message]:
        """Take note of a message. Gives nothing back and waits for nobody."""
        now_ns = self._clock()
        with self._asked:
            causes = list(self._causes.causes(message, now_ns))
            tellings = [each for cause in causes for each in self._book.note(cause, now_ns)]
            if now_ns - self._checked_ns >= CHECKED_EVERY:
                self._checked_ns = now_ns
                tellings += self._book.due(now_ns)
            if (causes or tellings) and self._book.notices != self._saved:
                self._save()
        self._tell(tellings)
        return ()

    def close(self) -> None:
        """What can be sent at once is; the rest waits on disk for the next session."""
        for delivery in self._deliveries:
            delivery.stop(PATIENCE)

    @property
    def statistics(self) -> NodeStatistics:
        """What could not be sent."""
        return NodeStatistics(warnings=self.warnings)

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """For the node's status: which channels are away, and what was too much."""
        doubts = [
            QualityWarning("notices-waiting", f"{each.name}: {each.problem}")
            for each in self._deliveries
            if each.problem
        ]
        dropped = sum(outbox.dropped for outbox in self._outboxes)
        if dropped:
            doubts.append(
                QualityWarning("notices-dropped", f"{dropped} notices were too many to keep")
            )
        return tuple(doubts)

    def answer(self, asked: bytes = b"") -> bytes:
        """Acknowledge what the query names, and list all: JSON both ways.

        asked   {"acknowledge": [1, 2], "by": "name"}, or nothing to list alone
        """
        wanted = json.loads(asked) if asked else {}
        with self._asked:
            unknown = self._book.acknowledge(
                [int(each) for each in wanted.get("acknowledge", ())],
                str(wanted.get("by", "")),
                self._clock(),
            )
            self._save()
            return json.dumps(listed(self._book, unknown), ensure_ascii=False).encode()

    def _tell(self, tellings: Sequence[AlarmMessage]) -> None:
        for telling in tellings:
            for outbox, delivery in zip(self._outboxes, self._deliveries, strict=True):
                try:
                    outbox.put(telling.as_json() | self._place)
                except OSError as error:
                    logger.error("a notice could not be kept: %s", error)
                delivery.wake()

    def _save(self) -> None:
        self._saved = self._book.notices
        try:
            written_whole(self._path, encoded_notices(self._saved))
        except OSError as error:
            logger.error("the book of notices could not be written: %s", error)


def notices_in(path: Path) -> tuple[Any, ...]:
    """Of a book's file; none where there is no file. Raises InputError where it is damaged."""
    try:
        return decoded_notices(path.read_bytes())
    except FileNotFoundError:
        return ()
    except ValueError as error:
        raise InputError(f"{path} is no book of notices: {error}; move it away") from error


def listed(book: AlarmLog, unknown: Sequence[int] = ()) -> dict[str, Any]:
    """A book as it is answered; names are stable."""
    return {"notices": [asdict(each) for each in book.notices], "unknown": list(unknown)}


@contextmanager
def desk_of(
    folder: Path, settings: AlarmLogSettings, channels: Sequence[Channel]
) -> Iterator[AlarmNode]:
    """A desk that is closed whatever happens."""
    desk = AlarmNode(folder, settings, channels)
    try:
        yield desk
    finally:
        desk.close()


def acknowledged_in_file(path: Path, ids: Sequence[int], by: str) -> dict[str, Any]:
    """The book of a session that does not run, some of its notices acknowledged.

    Raises InputError where there is no book, or it is damaged.
    """
    if not path.exists():
        raise InputError(f"there is no {path}: no session in that folder has told of anything")
    book = AlarmLog(AlarmLogSettings(), notices_in(path))
    unknown = book.acknowledge(ids, by, time.time_ns())
    written_whole(path, encoded_notices(book.notices))
    return listed(book, unknown)
