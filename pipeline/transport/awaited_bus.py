"""A bus whose session may open later: an instrument is heard from the start, its shore or not.

    publish ──► kept, as a publisher's cache keeps it ──session opens──► bus

Of each key the last `Stream.cached` messages are kept, as of a link that was cut.
"""

import logging
import threading
from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from pipeline.messages import Message
from pipeline.streams import stream_of
from pipeline.transport.bus import Bus, Inbox, Subscription, publishing_key
from pipeline.transport.errors import UnreachableError

logger = logging.getLogger(__name__)

PATIENCE = 1.0  # with a session that opens, before what is published is kept [s]


@dataclass(slots=True, eq=False)
class AwaitedSubscription:
    """A subscription of a session that may open later."""

    message_types: Sequence[type]
    inbox: Inbox
    key: str | None
    opened: Subscription | None = None

    @property
    def lost(self) -> int:
        """As of `Subscription`."""
        return self.opened.lost if self.opened else 0

    def lost_of(self, message_type: type) -> int:
        """As of `Subscription`."""
        return self.opened.lost_of(message_type) if self.opened else 0

    def recovered_of(self, message_type: type) -> int:
        """As of `Subscription`."""
        return self.opened.recovered_of(message_type) if self.opened else 0

    def close(self) -> None:
        """As of `Subscription`."""
        if self.opened:
            self.opened.close()


class AwaitedBus:
    """Opens a bus in a thread of its own, and keeps what is published meanwhile.

    Parameters
    ----------
    open_bus : callable
        Opens it, however long that takes, until the event is set that it is given; what it raises
        is raised here, or by what is called next in this thread.
    patience : float, optional
        With a bus that opens [s].
    """

    def __init__(
        self, open_bus: Callable[[threading.Event], Bus], *, patience: float = PATIENCE
    ) -> None:
        self._owner = threading.current_thread()
        self._bus: Bus | None = None
        self._failure: BaseException | None = None
        self._is_behind = True  # what was kept and subscribed has not reached the bus
        self._kept: dict[str, deque[tuple[Message, bytes | None]]] = {}  # by key
        self._subscriptions: list[AwaitedSubscription] = []
        self._abandoned = threading.Event()
        self._opening = threading.Thread(
            target=self._open, args=(open_bus,), name="opening", daemon=True
        )
        self._opening.start()
        self._opening.join(patience)
        self._opened()

    def publish(self, message: Message, payload: bytes | None = None) -> None:
        """Send on the message's key, or keep it until that can be done. See `Bus`."""
        key, bus = publishing_key(message), self._opened()
        if bus is not None:
            bus.publish(message, payload)
            return
        kept = self._kept.setdefault(key, deque(maxlen=stream_of(type(message)).cached))
        kept.append((message, payload))

    def subscribe(
        self, message_types: Sequence[type], inbox: Inbox, *, key: str | None = None
    ) -> AwaitedSubscription:
        """Deliver all messages of these types into the inbox. See `Bus`."""
        subscription = AwaitedSubscription(message_types, inbox, key)
        self._subscriptions.append(subscription)
        bus = self._opened()
        if bus is not None and subscription.opened is None:
            subscription.opened = bus.subscribe(message_types, inbox, key=key)
        return subscription

    def close(self) -> None:
        """Leave; what could not be sent is logged."""
        self._abandoned.set()
        self._opening.join()
        with suppress(UnreachableError):  # raised before, or nobody waits for it any more
            bus = self._opened()
            if bus is not None:
                bus.close()
        if self._is_behind:
            count = sum(map(len, self._kept.values()))
            logger.warning("no session was opened; %d messages were not sent", count)

    def _open(self, open_bus: Callable[[threading.Event], Bus]) -> None:
        try:
            self._bus = open_bus(self._abandoned)
        except BaseException as error:  # noqa: BLE001  # `_opened` raises it to its caller
            self._failure = error

    def _opened(self) -> Bus | None:
        """The bus, with all that was meant for it; None while it opens."""
        if self._failure is not None and threading.current_thread() is self._owner:
            raise self._failure  # a thread that looks after a spool could give it to no caller
        if self._bus is not None and self._is_behind:
            self._is_behind = False
            for each in self._subscriptions:
                each.opened = self._bus.subscribe(each.message_types, each.inbox, key=each.key)
            for kept in self._kept.values():
                for message, payload in kept:
                    self._bus.publish(message, payload)
            self._kept.clear()
        return self._bus
