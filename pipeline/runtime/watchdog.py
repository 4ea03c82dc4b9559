"""systemd's watchdog: a service whose messages stop is started again.

    [Service]
    Type=notify          READY=1 with the first message
    WatchdogSec=180      WATCHDOG=1 while messages come; without it for so long, systemd restarts

Source: sd_notify(3), the protocol of $NOTIFY_SOCKET and $WATCHDOG_USEC.
"""

import logging
import os
import socket
import time
from collections.abc import Callable, Iterable, Mapping

from pipeline.messages import Message
from pipeline.nodes.node import Sink

logger = logging.getLogger(__name__)

USUAL_PERIOD = 30.0  # without a watchdog: READY alone matters [s]


class Watchdog:
    """Notifies systemd, at most once in half the watchdog's time.

    Parameters
    ----------
    environment : mapping
        With NOTIFY_SOCKET and WATCHDOG_USEC, as systemd sets them.
    clock : callable
        Monotonic time [s].
    """

    def __init__(
        self, environment: Mapping[str, str], clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._path = environment.get("NOTIFY_SOCKET", "")
        microseconds = environment.get("WATCHDOG_USEC", "")
        self._period = int(microseconds) * 0.5e-6 if microseconds.isdecimal() else USUAL_PERIOD
        self._clock = clock
        self._last: float | None = None

    def alive(self) -> None:
        """Notify systemd, if it listens, that the service works."""
        now = self._clock()
        if not self._path or (self._last is not None and now - self._last < self._period):
            return
        state = b"WATCHDOG=1" if self._last is not None else b"READY=1\nWATCHDOG=1"
        self._last = now
        address = "\0" + self._path[1:] if self._path.startswith("@") else self._path
        try:
            with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as link:
                link.sendto(state, address)
        except OSError as error:
            logger.debug("systemd cannot be notified: %s", error)


class WatchdogNode(Sink):
    """A sink that keeps the watchdog quiet while messages come."""

    name = "watchdog"

    def __init__(self, watchdog: Watchdog) -> None:
        self._watchdog = watchdog

    def handle(self, message: Message) -> Iterable[Message]:
        """Note that the session works. Returns nothing."""
        self._watchdog.alive()
        return ()


def notified() -> bool:
    """Whether systemd listens to this process."""
    return bool(os.environ.get("NOTIFY_SOCKET"))
