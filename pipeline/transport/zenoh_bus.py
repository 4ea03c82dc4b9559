"""The bus over Zenoh: nodes in threads, in processes, on several machines.

Every node has a session of its own. By default sessions are on this machine: no router, no
multicast scouting, loopback only. One of them, the hub, listens on an endpoint that the others know
(`hub`). A run's own nodes are its clients (`run/endpoints.py`): a client opens its link again
whenever it is lost. Others are peers (`peer_of`), which may start before the hub, find each other
by gossip, talk directly and keep their links when the hub goes; but a link that two peers found
by gossip stays lost while both have theirs to the hub.

Zenoh drops samples where a link is cut or a reader too slow, so every publisher keeps the last
`Stream.cached` samples of each key and reports its position twice a second; a subscriber asks
for what it missed, and what can no longer be had is counted (`ZenohSubscription.lost`). A put never
waits for a reader. What Zenoh overlooks is the beginning of a stream: see `zenoh_arrivals`, which
is why every sample states when its publisher began.

This module, `zenoh_arrivals` and `zenoh_settings` are the only ones that import zenoh. Its advanced
publisher and subscriber are labelled unstable, hence the narrow version range in pyproject.toml.
"""

import logging
import math
import threading
import time
from collections import Counter
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Protocol

import zenoh
from zenoh import ext

from pipeline.messages import Message
from pipeline.streams import Stream, stream_of
from pipeline.transport.bus import Inbox, publishing_key
from pipeline.transport.codec import encode
from pipeline.transport.errors import TransportError, UnreachableError
from pipeline.transport.zenoh_arrivals import (
    FETCH_TIMEOUT,
    HEARTBEAT,
    Arrivals,
    Beginnings,
    beginning,
)
from pipeline.transport.zenoh_settings import (
    ZenohSettings,
    configuration,
    explained,
    free_endpoint,
    hub,
    peer_of,
    without_source,
)

__all__ = [
    "ZenohBus",
    "ZenohSettings",
    "ZenohSubscription",
    "asked",
    "free_endpoint",
    "hub",
    "peer_of",
]

logger = logging.getLogger(__name__)

BURST = 32  # messages that a link's queue holds for sure, one after the other
SETTLING = 3 * HEARTBEAT  # after a burst, until what a link dropped has been asked for again [s]
SIGNALS_WITHIN = 0.1  # are handled while a session is opened [s]
ALONE = 10.0  # without anybody at the endpoints that were given, until that is said [s]
MOST_PUBLISHERS = 5000  # of one session: of 1000 turbines' estimates, or posteriors, and their kin


@dataclass(frozen=True, slots=True)
class Link:
    """One connection of a session."""

    zid: str
    """Zenoh's id of the other end."""
    address: str
    """Of the other end."""
    name: str
    """In the certificate that the other end showed; "" without one."""


class ZenohBus:
    """One Zenoh session. `publish` belongs to one thread; a subscriber's inbox is filled by
    Zenoh's threads.

    Raises TransportError where the session cannot be opened: a port in use, a configuration that
    Zenoh does not know; UnreachableError for a client without a router, and for one whose
    configuration lets it wait for its router, when `stopping` is set meanwhile.
    """

    def __init__(
        self, settings: ZenohSettings | None = None, stopping: threading.Event | None = None
    ) -> None:
        settings = settings or ZenohSettings()
        self._session = _opened(settings, stopping or threading.Event())
        self._publishers: dict[str, _Publisher] = {}  # by key
        self._began: dict[str, bytes] = {}  # when they were declared, by key
        self._subscriptions: list[ZenohSubscription] = []
        self._queryables: list[zenoh.Queryable[None]] = []  # forgotten by Zenoh unless held
        self._beginnings = Beginnings(self._session)
        self._burst, self._last_put = 0, -math.inf  # messages within a heartbeat; the last [s]
        self._alone = threading.Timer(ALONE, self._say_if_alone, [settings.endpoints])
        self._alone.daemon = True
        if settings.endpoints:
            self._alone.start()

    def _say_if_alone(self, endpoints: Sequence[str]) -> None:
        """Log that a session at these endpoints is still awaited, where nobody is connected."""
        with suppress(zenoh.ZError):  # closed meanwhile
            if not self.links():
                _log_alone(endpoints)

    def publish(self, message: Message, payload: bytes | None = None) -> None:
        """Send on the message's key. See `Bus`."""
        key = publishing_key(message)
        payload = encode(message) if payload is None else payload
        publisher = self._publisher_of(key, stream_of(type(message)))
        publisher.put(payload, attachment=self._began[key])
        now = time.monotonic()
        self._burst = self._burst + 1 if now - self._last_put < HEARTBEAT else 1
        self._last_put = now

    def _publisher_of(self, key: str, stream: Stream) -> "_Publisher":
        """The key's publisher. Of more than MOST_PUBLISHERS the one that was silent longest goes,
        and its cache with it: what is answered to made-up, untrusted turbines is bounded."""
        publisher = self._publishers.pop(key, None)
        if publisher is None:
            publisher = _publisher(self._session, key, stream)
            self._began[key] = beginning(time.time())
            if len(self._publishers) >= MOST_PUBLISHERS:
                silent = next(iter(self._publishers))
                self._publishers.pop(silent).undeclare()
                del self._began[silent]
        self._publishers[key] = publisher  # the last is who spoke last
        return publisher

    def subscribe(
        self, message_types: Sequence[type], inbox: Inbox, *, key: str | None = None
    ) -> "ZenohSubscription":
        """Deliver all messages of these types into the inbox. See `Bus`."""
        subscription = ZenohSubscription(self._session, self._beginnings, message_types, inbox, key)
        self._subscriptions.append(subscription)
        return subscription

    def answer(self, key: str, reply: Callable[[bytes], bytes]) -> None:
        """Answer every query on this key with what `reply` gives for the query's payload, from one
        of Zenoh's threads."""

        def respond(query: zenoh.Query) -> None:
            asked_with = b"" if query.payload is None else query.payload.to_bytes()
            query.reply(key, reply(asked_with))

        self._queryables.append(self._session.declare_queryable(key, respond))

    def links(self) -> tuple[Link, ...]:
        """Who this session is connected with now."""
        return tuple(
            Link(str(link.zid), str(link.dst), link.auth_identifier or "")
            for link in self._session.info.links()
        )

    def close(self) -> None:
        """Leave, when what was published has been handed over.

        A link that is too slow for a burst drops messages, which are fetched from the publisher's
        cache when its next heartbeat reports its position: after a burst it stays for that long.
        """
        self._alone.cancel()
        if self._burst > BURST:
            time.sleep(max(0.0, self._last_put + SETTLING - time.monotonic()))
        for queryable in self._queryables:
            queryable.undeclare()
        self._queryables.clear()
        for subscription in self._subscriptions:
            subscription.close()
        for publisher in self._publishers.values():
            publisher.undeclare()
        self._publishers.clear()
        self._beginnings.close()
        try:
            self._session.close()
        except zenoh.ZError as error:  # a link that hangs; what was published has been handed over
            logger.warning("a Zenoh session was not closed: %s", without_source(str(error)))


def asked(whom: str | ZenohSettings, key_expression: str, payload: bytes = b"") -> list[bytes]:
    """Return what the sessions that can be reached through an endpoint answer on these keys.

    Raises UnreachableError where nothing listens there.
    """
    if isinstance(whom, str):
        whom = ZenohSettings(mode="client", connect=(whom,))
    session = _opened(whom, threading.Event())
    try:
        replies = session.get(
            key_expression,
            target=zenoh.QueryTarget.ALL,
            timeout=FETCH_TIMEOUT,
            payload=payload or None,
        )
        return [reply.ok.payload.to_bytes() for reply in replies if reply.ok is not None]
    finally:
        session.close()


class ZenohSubscription:
    """Some streams on their way into one inbox, and what was missed of them for good."""

    def __init__(
        self,
        session: zenoh.Session,
        beginnings: Beginnings,
        message_types: Sequence[type],
        inbox: Inbox,
        key: str | None = None,
    ) -> None:
        self._lost: Counter[type] = Counter()
        self._counting = threading.Lock()
        self._arrivals = {each: Arrivals(each, inbox, beginnings) for each in message_types}
        # Zenoh forgets a subscriber or listener that nothing holds.
        self._subscribers = [
            _subscriber(session, stream_of(message_type), arrive, key)
            for message_type, arrive in self._arrivals.items()
        ]
        self._miss_listeners = [
            subscriber.sample_miss_listener(self._missed(message_type))
            for subscriber, message_type in zip(self._subscribers, message_types, strict=True)
            if isinstance(subscriber, ext.AdvancedSubscriber)
        ]

    @property
    def lost(self) -> int:
        """Messages that were published and will never arrive."""
        return sum(map(self.lost_of, self._arrivals))

    def lost_of(self, message_type: type) -> int:
        """Return those of one type."""
        at_beginnings = self._arrivals[message_type].lost if message_type in self._arrivals else 0
        return self._lost[message_type] + at_beginnings

    def recovered_of(self, message_type: type) -> int:
        """Messages of one type that came when their link was back."""
        return self._arrivals[message_type].recovered if message_type in self._arrivals else 0

    def close(self) -> None:
        """Deliver no more."""
        for listener in self._miss_listeners:
            listener.undeclare()
        for subscriber in self._subscribers:
            subscriber.undeclare()
        self._miss_listeners.clear()
        self._subscribers.clear()

    def _missed(self, message_type: type) -> Callable[[ext.Miss], None]:
        def count(miss: ext.Miss) -> None:
            with self._counting:
                self._lost[message_type] += miss.nb

        return count


class _Publisher(Protocol):
    """One of Zenoh's publishers, with a cache or without."""

    def put(self, payload: bytes, *, attachment: bytes) -> None: ...
    def undeclare(self) -> None: ...


class _Subscriber(Protocol):
    """One of Zenoh's subscribers, that asks for what it missed or does not."""

    def undeclare(self) -> None: ...


def _publisher(session: zenoh.Session, key: str, stream: Stream) -> _Publisher:
    if not stream.cached:
        return session.declare_publisher(key, congestion_control=zenoh.CongestionControl.DROP)
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        cache=ext.CacheConfig(max_samples=stream.cached),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT, sporadic_heartbeat=None),
        publisher_detection=True,
    )


def _subscriber(
    session: zenoh.Session,
    stream: Stream,
    arrive: Callable[[zenoh.Sample], None],
    key: str | None,
) -> _Subscriber:
    if not stream.cached:
        return session.declare_subscriber(key or stream.key_expression, arrive)
    return ext.declare_advanced_subscriber(
        session,
        key or stream.key_expression,
        arrive,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=stream.cached),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )


def _log_alone(endpoints: Sequence[str]) -> None:
    logger.warning(
        "no session answers at %s so far; it is tried again until one does", ", ".join(endpoints)
    )


class _Opening(threading.Thread):
    """Opens a session, which may take for ever; in the main thread no signal is handled then."""

    def __init__(self, config: zenoh.Config) -> None:
        super().__init__(name="zenoh-opening", daemon=True)
        self.session: zenoh.Session | None = None
        self.failure: zenoh.ZError | None = None
        self._config = config

    def run(self) -> None:
        try:
            self.session = zenoh.open(self._config)
        except zenoh.ZError as error:
            self.failure = error


def _opened(settings: ZenohSettings, stopping: threading.Event) -> zenoh.Session:
    try:
        opening = _Opening(configuration(settings))
    except zenoh.ZError as error:
        raise TransportError(explained(settings, str(error))) from error
    opening.start()
    alone_at = time.monotonic() + ALONE
    while opening.is_alive():
        opening.join(SIGNALS_WITHIN)
        if stopping.is_set() and opening.is_alive():  # it ends with the process
            where = ", ".join(settings.endpoints)
            raise UnreachableError(f"no Zenoh session answered at {where} until the command's end")
        if time.monotonic() > alone_at:
            alone_at = math.inf
            _log_alone(settings.endpoints)
    if opening.session is not None:
        return opening.session
    text = str(opening.failure)
    kind = UnreachableError if "Unable to connect" in text else TransportError
    raise kind(explained(settings, text)) from opening.failure
