"""AlarmNode: the sink that raises alarms, and the file that keeps them over a restart."""

import json
import logging
import socket
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from pipeline.messages import Message, QualityWarning
from pipeline.monitoring.alarms.alarm_log import (
    Alarm,
    AlarmLog,
    AlarmMessage,
    decoded_notices,
    encoded_notices,
)
from pipeline.monitoring.alarms.alarm_rules import WHOLE_SESSION, AlarmCondition, AlarmRules
from pipeline.monitoring.alarms.channels import AlarmChannel
from pipeline.monitoring.alarms.heartbeat import AlarmHeartbeat, Pulse
from pipeline.monitoring.alarms.outbox import DeliveryState, DeliveryThread, Outbox
from pipeline.monitoring.alarms.settings import AlarmLogSettings, HeartbeatSettings
from pipeline.nodes.node import NodeStatistics, Sink
from sensors.atomic_write import written_whole
from sensors.errors import InputError

logger = logging.getLogger(__name__)

FOLDER, BOOK = "notices", "notices.json"  # within a session's folder
ALARMS_KEY = "pilewatch/@notices"  # no stream's key expression matches what begins with @
DELIVERY_PATIENCE = 5.0  # at the end, for what is on its way [s]
CHECKED_EVERY = 1_000_000_000  # the log for ends and reminders, the channels for failures [ns]


class AlarmNode(Sink):
    """Handles every message of a session, raises alarms, answers acknowledgements.

    Parameters
    ----------
    folder : Path
        Of the alarm log and of the outboxes.
    settings : AlarmLogSettings
        What raises an alarm.
    channels : sequence of Channel
        Where alarm messages go.
    clock : callable
        Time [ns since 1970-01-01 UTC].
    heartbeats : sequence of HeartbeatSettings
        Receivers of the dead-man's ping.

    Raises
    ------
    InputError
        If the folder's alarm log is damaged.
    """

    name = "notices"

    def __init__(
        self,
        folder: Path,
        settings: AlarmLogSettings,
        channels: Sequence[AlarmChannel],
        clock: Callable[[], int] = time.time_ns,
        heartbeats: Sequence[HeartbeatSettings] = (),
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._path = folder / BOOK
        self._place = {"host": socket.gethostname(), "session": str(folder.resolve().parent)}
        self._clock, self._settings = clock, settings
        self._log = AlarmLog(settings, notices_in(self._path))
        self._rules = AlarmRules(settings, self._log.lasting)
        self._saved = self._log.notices
        self._lock = threading.Lock()
        self._checked_ns, self._received_ns = 0, clock()
        self._outboxes = [Outbox(folder / channel.name, clock=clock) for channel in channels]
        self._deliveries = [
            DeliveryThread(channel, outbox, clock=clock)
            for channel, outbox in zip(channels, self._outboxes, strict=True)
        ]
        self._heartbeats = [
            AlarmHeartbeat(each, self._pulse, self._place, clock) for each in heartbeats
        ]
        self._end_unwatched()
        self._save()  # from now on `pilewatch ack` finds a log
        for thread in (*self._deliveries, *self._heartbeats):
            thread.start()

    def handle(self, message: Message) -> Iterable[Message]:
        """Take note of a message. Returns nothing and waits for no receiver."""
        now_ns = self._received_ns = self._clock()
        with self._lock:
            conditions = list(self._rules.conditions(message, now_ns))
            check = now_ns - self._checked_ns >= CHECKED_EVERY
            if check:
                conditions += self._delivery_conditions()
            raised = [each for cause in conditions for each in self._log.note(cause, now_ns)]
            if check:
                self._checked_ns = now_ns
                raised += self._log.due(now_ns)
            if (conditions or raised) and self._log.notices != self._saved:
                self._save()
        self._queue(raised)
        return ()

    def close(self) -> None:
        """Deliver what goes at once; the rest waits on disk for the next session."""
        for heartbeat in self._heartbeats:
            heartbeat.stop()
        for delivery in self._deliveries:
            delivery.stop(DELIVERY_PATIENCE)

    @property
    def delivery_states(self) -> tuple[DeliveryState, ...]:
        """What became of the messages, one a channel."""
        return tuple(delivery.state() for delivery in self._deliveries)

    @property
    def statistics(self) -> NodeStatistics:
        """What could not be sent."""
        return NodeStatistics(warnings=self.warnings)

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """Channels that do not deliver, and what was dropped."""
        problems = [
            *((each.name, each.problem) for each in self._deliveries),
            *((each.name, each.problem) for each in self._heartbeats),
        ]
        found = [
            QualityWarning("notices-waiting", f"{name}: {problem}")
            for name, problem in problems
            if problem
        ]
        dropped = sum(outbox.dropped for outbox in self._outboxes)
        if dropped:
            found.append(
                QualityWarning("notices-dropped", f"{dropped} alarm messages were too many to keep")
            )
        refused = sum(delivery.refused for delivery in self._deliveries)
        if refused:
            found.append(
                QualityWarning(
                    "notices-refused",
                    f"{refused} alarm messages are refused; see notices/*/refused",
                )
            )
        return tuple(found)

    def answer(self, asked: bytes = b"") -> bytes:
        """Acknowledge the alarms that a query names, and list all: JSON both ways.

        Parameters
        ----------
        asked : bytes
            {"acknowledge": [1, 2], "by": "name"}, or nothing to list alone.
        """
        wanted = json.loads(asked) if asked else {}
        with self._lock:
            unknown = self._log.acknowledge(
                [int(each) for each in wanted.get("acknowledge", ())],
                str(wanted.get("by", "")),
                self._clock(),
            )
            self._save()
            return json.dumps(listed(self._log, unknown), ensure_ascii=False).encode()

    def _end_unwatched(self) -> None:
        """End what an earlier session raised and this one does not watch: no message would."""
        deliveries = {_delivery_key(each.channel) for each in self._deliveries}
        for cause in self._log.lasting:
            has_channel = cause.kind != "delivery" or cause.key in deliveries
            if not (has_channel and self._rules.watches(cause)):
                ended = replace(cause, text="", over=True)
                list(self._log.note(ended, self._clock()))  # its message comes once it has settled

    def _delivery_conditions(self) -> Iterator[AlarmCondition]:
        """A channel that does not deliver is an alarm, which the other channels deliver."""
        if "delivery" not in self._settings.kinds:
            return
        for delivery in self._deliveries:
            text = self._undelivered(delivery.state()) if delivery.problem else ""
            key = _delivery_key(delivery.channel)
            yield AlarmCondition(key, "delivery", WHOLE_SESSION, text, over=not text, counted=False)

    def _undelivered(self, state: DeliveryState) -> str:
        """Return the sentence on a channel whose messages wait for too long; "" if they do not."""
        if state.age < self._settings.undelivered:
            return ""
        return f"{state.waiting} alarm messages wait for {state.channel}: {state.problem}"

    def _pulse(self) -> Pulse:
        return Pulse(self._received_ns, sum(not each.closed for each in self._log.notices))

    def _queue(self, raised: Sequence[AlarmMessage]) -> None:
        for message in raised:
            for outbox, delivery in zip(self._outboxes, self._deliveries, strict=True):
                try:
                    outbox.put(message.as_json() | self._place)
                except OSError as error:
                    logger.error("an alarm message could not be kept: %s", error)
                delivery.wake()

    def _save(self) -> None:
        self._saved = self._log.notices
        try:
            written_whole(self._path, encoded_notices(self._saved))
        except OSError as error:
            logger.error("the alarm log could not be written: %s", error)


def _delivery_key(channel: str) -> str:
    return f"{WHOLE_SESSION}/delivery/{channel}"


def notices_in(path: Path) -> tuple[Alarm, ...]:
    """Return the alarms of a log's file; none if there is no file.

    Raises
    ------
    InputError
        If it is damaged.
    """
    try:
        return decoded_notices(path.read_bytes())
    except FileNotFoundError:
        return ()
    except ValueError as error:
        raise InputError(f"{path} is no alarm log: {error}; move it away") from error


def listed(log: AlarmLog, unknown: Sequence[int] = ()) -> dict[str, Any]:
    """Return an alarm log as it is answered; names are stable."""
    return {"notices": [asdict(each) for each in log.notices], "unknown": list(unknown)}


@contextmanager
def running_alarm_node(
    folder: Path,
    settings: AlarmLogSettings,
    channels: Sequence[AlarmChannel],
    heartbeats: Sequence[HeartbeatSettings] = (),
) -> Iterator[AlarmNode]:
    """An alarm node that is closed whatever happens."""
    node = AlarmNode(folder, settings, channels, heartbeats=heartbeats)
    try:
        yield node
    finally:
        node.close()


def acknowledged_in_file(path: Path, ids: Sequence[int], by: str) -> dict[str, Any]:
    """Acknowledge alarms of a session that does not run.

    Parameters
    ----------
    path : Path
        Of the alarm log.
    ids : sequence of int
        Of the alarms.
    by : str
        Who acknowledges them.

    Raises
    ------
    InputError
        If there is no alarm log, or it is damaged.
    """
    if not path.exists():
        raise InputError(f"there is no {path}: no session in that folder has raised an alarm")
    log = AlarmLog(AlarmLogSettings(), notices_in(path))
    unknown = log.acknowledge(ids, by, time.time_ns())
    written_whole(path, encoded_notices(log.notices))
    return listed(log, unknown)
