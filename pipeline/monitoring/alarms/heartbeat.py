"""The dead-man's ping: a receiver that gets nothing for some periods raises the alarm itself.

    every `period` seconds   POST {"host", "session", "time_ns", "open"}   while messages come

A session that hangs, a machine without power and a cut cable all end the ping. So does a session
whose messages stop: the ping is sent only if the alarm node has handled one within LIVES.
"""

import logging
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from pipeline.monitoring.alarms.channels import DeliveryFailed, origin, post_json
from pipeline.monitoring.alarms.settings import HeartbeatSettings
from sensors.acquisition.blocks import NANOSECONDS

logger = logging.getLogger(__name__)

LIVES = 60.0  # since the last handled message; nodes report every second [s]


@dataclass(frozen=True, slots=True)
class Pulse:
    """The alarm node's sign of life."""

    received_ns: int
    """When the last message was handled [ns since 1970-01-01 UTC]."""
    open: int
    """Alarms that are open [-]."""


class AlarmHeartbeat(threading.Thread):
    """Pings one receiver until it is stopped.

    Parameters
    ----------
    settings : HeartbeatSettings
        Where and how often.
    pulse : callable
        The session's sign of life.
    place : mapping
        `host` and `session`, for the receiver.
    clock : callable
        Time [ns since 1970-01-01 UTC].
    """

    def __init__(
        self,
        settings: HeartbeatSettings,
        pulse: Callable[[], Pulse],
        place: Mapping[str, str],
        clock: Callable[[], int] = time.time_ns,
    ) -> None:
        super().__init__(name="notices-heartbeat", daemon=True)
        self._settings, self._pulse, self._place, self._clock = settings, pulse, place, clock
        self._stopping = threading.Event()
        self.problem = ""  # why the last ping failed; "" if it did not

    def stop(self) -> None:
        """No further ping; does not wait for one that is on its way."""
        self._stopping.set()

    def run(self) -> None:
        """Until `stop`."""
        while not self._stopping.is_set():
            self.ping()
            self._stopping.wait(self._settings.period)

    def ping(self) -> None:
        """One ping, if the session lives."""
        pulse, now_ns = self._pulse(), self._clock()
        if now_ns - pulse.received_ns > LIVES * NANOSECONDS:
            self.problem = f"no ping: no message was handled for more than {LIVES:g} s"
            return
        content: dict[str, Any] = {**self._place, "time_ns": now_ns, "open": pulse.open}
        try:
            post_json(self._settings, content, {})
        except DeliveryFailed as failure:
            problem = str(failure)
        except Exception as error:  # noqa: BLE001  # why: no answer ends the pings
            problem = f"{origin(self._settings.url)}: {type(error).__name__}: {error}"
        else:
            problem = ""
        if problem and not self.problem:
            logger.warning("the heartbeat does not arrive: %s", problem)
        self.problem = problem
