"""What carries messages between nodes: the protocols, and the inbox at a subscriber's end.

A transport's threads only put bytes into an inbox; decoding and everything after it happens in
the thread of the subscriber. So no subscriber, however slow, holds up a publisher or another
subscriber: what its inbox cannot hold is dropped and counted.
"""

import logging
import threading
from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pipeline.messages import Message
from pipeline.streams import key_of
from pipeline.transport.codec import LARGEST_PAYLOAD, decode
from pipeline.transport.errors import CodecError, TransportError
from sensors.acquisition.key_parts import key_part_error
from sensors.bounded_dict import BoundedDict

logger = logging.getLogger(__name__)

INBOX_CAPACITY = 100_000  # messages: of a farm of twenty at ten times real time, eight minutes
INBOX_BYTES = 256 * 2**20  # of all messages that wait: what a flood may cost in memory
KEY_BYTES = 48 * 2**20  # of those on one key: thirteen minutes of sixteen channels at 1 kHz
MOST_KEYS = (
    20_000  # that are listened to: of 1500 turbines; what is kept of each is small, not none
)

PLACES_KEPT = 1000  # of messages that are gone, before the order of arrival is tidied up

_logging = threading.Lock()
_logged: BoundedDict[str, int] = BoundedDict()  # refusals by their text, how many an inbox had then


@dataclass(frozen=True, slots=True)
class Delivery:
    """One message as it arrived."""

    message_type: type
    key: str
    payload: bytes


@dataclass(slots=True)
class _Waiting:
    """A place in the order of arrival."""

    delivery: Delivery | None
    """None: it has been taken, or made room."""


class Subscription(Protocol):
    """Some streams on their way into one inbox."""

    @property
    def lost(self) -> int:
        """Messages that were published and, as the transport knows, will never arrive."""
        ...

    def lost_of(self, message_type: type) -> int:
        """Return those of one type."""
        ...

    def recovered_of(self, message_type: type) -> int:
        """Messages of one type that came when their link was back, from where they were kept."""
        ...

    def close(self) -> None:
        """Deliver no more."""
        ...


class Bus(Protocol):
    """Carries every message of the table of streams from its publisher to its subscribers.

    Messages on one key arrive in the order of publishing. A subscriber that comes late receives
    the last `Stream.cached` messages of each key first.
    """

    def publish(self, message: Message, payload: bytes | None = None) -> None:
        """Send on the message's key. Never waits for a subscriber.

        Parameters
        ----------
        message : Message
            To be sent.
        payload : bytes, optional
            The message as it is encoded, where that is known.

        Raises
        ------
        CodecError
            For a message that contradicts itself.
        TransportError
            For one whose turbine, unit or node cannot be part of a key.
        """
        ...

    def subscribe(
        self, message_types: Sequence[type], inbox: "Inbox", *, key: str | None = None
    ) -> Subscription:
        """Deliver all messages of these types into the inbox: of every turbine, or on one key."""
        ...

    def close(self) -> None:
        """Leave; what was published before has been handed over to the transport."""
        ...


class Inbox:
    """Bounded queue between a transport's threads and the one thread that takes messages out.

    When it is full, the oldest message makes room: what a late subscriber still needs is the end
    of the stream. A key that holds KEY_BYTES makes room by its own oldest one, so that a unit that
    floods costs no other unit a message. `payload` is what the message came in that `get` gave
    last. `dropped` and `malformed` count what was never handed out, and `refusal` gives of the last
    malformed one where it came and what was wrong with it. Messages on more keys than MOST_KEYS
    count as malformed too: an untrusted sender may make up keys for ever, of which all that listen
    would remember something.
    """

    def __init__(
        self, capacity: int = INBOX_CAPACITY, *, capacity_bytes: int = INBOX_BYTES
    ) -> None:
        self._waiting: deque[_Waiting] = deque()  # in the order of arrival
        self._of_key: dict[str, deque[_Waiting]] = {}  # of them, what waits
        self._bytes_of: Counter[str] = Counter()  # by key
        self._count = 0
        self._capacity = capacity
        self._capacity_bytes = capacity_bytes
        self._bytes = 0  # of the deliveries that wait
        self._changed = threading.Condition()
        self._closed = False
        self._keys: set[str] = set()
        self._dropped: Counter[type] = Counter()
        self.malformed = 0
        self.refusal = ""
        self.payload = b""

    def __len__(self) -> int:
        return self._count

    @property
    def dropped(self) -> int:
        """Messages that made room for later ones."""
        return self._dropped.total()

    def dropped_of(self, message_type: type) -> int:
        """Return those of one type."""
        return self._dropped[message_type]

    def put(self, delivery: Delivery) -> None:
        """Take in one delivery. Any thread; never waits for the reader."""
        size = len(delivery.payload)
        if size > LARGEST_PAYLOAD:
            self._reject(
                delivery, CodecError(f"{size} bytes; at most {LARGEST_PAYLOAD} are allowed")
            )
            return
        with self._changed:
            key = delivery.key
            while key in self._of_key and self._bytes_of[key] + size > KEY_BYTES:
                self._drop(self._taken_of(key))
            while self._count >= self._capacity or (
                self._count and self._bytes + size > self._capacity_bytes
            ):
                self._drop(self._taken())
            self._append(delivery)
            self._changed.notify()

    def get(self, timeout: float | None = None) -> Message | None:
        """Return the next message, waiting for it at most `timeout` [s]; None waits for ever.

        Returns None when the time is over, or when the inbox is closed and empty. A delivery
        that is no message of its stream is counted, reported and skipped.
        """
        while (delivery := self._next(timeout)) is not None:
            try:
                message, self.payload = self._opened(delivery), delivery.payload
                return message
            except CodecError as error:
                self._reject(delivery, error)
        return None

    def close(self) -> None:
        """Wake the reader; what is queued can still be taken out."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _opened(self, delivery: Delivery) -> Message:
        message = _opened(delivery)
        if delivery.key not in self._keys:
            if len(self._keys) >= MOST_KEYS:
                raise CodecError(f"another key than the {MOST_KEYS} that are listened to")
            self._keys.add(delivery.key)
        return message

    def _append(self, delivery: Delivery) -> None:
        waiting = _Waiting(delivery)
        self._waiting.append(waiting)
        self._of_key.setdefault(delivery.key, deque()).append(waiting)
        self._bytes_of[delivery.key] += len(delivery.payload)
        self._bytes += len(delivery.payload)
        self._count += 1

    def _taken(self) -> Delivery:
        """Take out the oldest."""
        while (oldest := self._waiting[0].delivery) is None:
            self._waiting.popleft()
        return self._taken_of(oldest.key)

    def _taken_of(self, key: str) -> Delivery:
        """Take out the oldest on a key, which must have one."""
        waiting = self._of_key[key].popleft()
        delivery, waiting.delivery = waiting.delivery, None
        assert delivery is not None
        self._bytes_of[key] -= len(delivery.payload)
        self._bytes -= len(delivery.payload)
        self._count -= 1
        if not self._of_key[key]:
            del self._of_key[key], self._bytes_of[key]
        if len(self._waiting) > 2 * self._count + PLACES_KEPT:
            self._waiting = deque(each for each in self._waiting if each.delivery is not None)
        return delivery

    def _drop(self, delivery: Delivery) -> None:
        self._dropped[delivery.message_type] += 1

    def _reject(self, delivery: Delivery, error: CodecError) -> None:
        with self._changed:
            self.malformed += 1
            self.refusal = f"on {delivery.key}: {error}"
        # the 1st, 2nd, 4th, 8th, …: a flood fills no log
        if self.malformed.bit_count() == 1 and _is_news(self.refusal, self.malformed):
            logger.warning(
                "dropped what came on %s (%d so far): %s", delivery.key, self.malformed, error
            )

    def _next(self, timeout: float | None) -> Delivery | None:
        with self._changed:
            self._changed.wait_for(lambda: self._count or self._closed, timeout)
            return self._taken() if self._count else None


def _is_news(refusal: str, count: int) -> bool:
    """Whether no inbox of this process, of which each node has one, has logged that refusal."""
    with _logging:
        if _logged.get(refusal, 0) >= count:
            return False
        _logged[refusal] = count
        return True


def publishing_key(message: Message) -> str:
    """Return the key on which a message is published.

    Raises TransportError where turbine, unit or node is empty or has a character that divides
    keys, selects many of them or hides them from those who select many.
    """
    for field in ("turbine", "unit", "node"):
        part = getattr(message, field, None)
        wrong = None if part is None else key_part_error(part)
        if wrong:
            raise TransportError(f"{field} {part!r} of a {type(message).__name__}: {wrong}")
    return key_of(message)


def _opened(delivery: Delivery) -> Message:
    message: Message = decode(delivery.message_type, delivery.payload)
    if key_of(message) != delivery.key:
        raise CodecError(f"the message itself belongs on {key_of(message)}")
    return message
