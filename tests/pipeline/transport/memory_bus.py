"""A bus inside one process, for running in lock-step and for tests.

Messages pass through the codec as on any other transport, so every way of running sees the same
bits.
"""

from collections import deque
from collections.abc import Sequence

from pipeline.messages import Message
from pipeline.streams import stream_of
from pipeline.transport.bus import Delivery, Inbox, publishing_key
from pipeline.transport.codec import encode


class MemoryBus:
    """Delivers at once and in the order of subscribing; loses nothing."""

    def __init__(self) -> None:
        self._subscriptions: list[MemorySubscription] = []
        self._cached: dict[str, deque[Delivery]] = {}

    def publish(self, message: Message, payload: bytes | None = None) -> None:
        key = publishing_key(message)
        delivery = Delivery(type(message), key, payload or encode(message))
        cached = stream_of(type(message)).cached
        self._cached.setdefault(key, deque(maxlen=cached)).append(delivery)
        for subscription in tuple(self._subscriptions):
            subscription.deliver(delivery)

    def subscribe(
        self, message_types: Sequence[type], inbox: Inbox, *, key: str | None = None
    ) -> "MemorySubscription":
        subscription = MemorySubscription(self, tuple(message_types), inbox, key)
        for deliveries in self._cached.values():
            for delivery in deliveries:
                subscription.deliver(delivery)
        self._subscriptions.append(subscription)
        return subscription

    def close(self) -> None:
        self._subscriptions.clear()
        self._cached.clear()

    def leave(self, subscription: "MemorySubscription") -> None:
        """Deliver nothing more to this subscription."""
        if subscription in self._subscriptions:
            self._subscriptions.remove(subscription)


class MemorySubscription:
    """Some message types on their way into one inbox."""

    lost = 0  # nothing is ever lost inside one process

    def __init__(
        self, bus: MemoryBus, message_types: tuple[type, ...], inbox: Inbox, key: str | None
    ) -> None:
        self._key = key
        self._bus = bus
        self._message_types = message_types
        self._inbox = inbox

    def lost_of(self, message_type: type) -> int:
        return 0

    def recovered_of(self, message_type: type) -> int:
        return 0

    def deliver(self, delivery: Delivery) -> None:
        of_key = self._key in (None, delivery.key)
        if delivery.message_type in self._message_types and of_key:
            self._inbox.put(delivery)

    def close(self) -> None:
        self._bus.leave(self)
