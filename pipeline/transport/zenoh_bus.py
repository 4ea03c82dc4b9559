"""The bus over Zenoh: nodes in threads, in processes, on several machines.

Every node has a session of its own. By default sessions are peers on this machine: no router,
no multicast scouting, loopback only. One of them listens on an endpoint that the others know
(`hub`); the others connect to it (`peer_of`), hear of each other by gossip and then talk
directly. They may start in any order, and the hub may go: the others keep their links.

Zenoh drops samples where a link is cut or a reader too slow, so every publisher keeps the last
`Stream.cached` samples of each key and says twice a second how far it is; a subscriber asks for
what it missed, and what can no longer be had is counted (`ZenohSubscription.lost`). A put never
waits for a reader. What Zenoh's subscriber overlooks by itself is the beginning: where a link
comes up while samples are being published, the first that gets through opens the stream and those
before it are passed over in silence. So a stream that does not begin with its first sample is held
back until the samples before have been fetched too (`_Beginnings`).

This module and `zenoh_settings` are the only ones that import zenoh. Its advanced publisher and
subscriber are labelled unstable, hence the narrow version range in pyproject.toml.
"""

import logging
import queue
import threading
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import zenoh
from zenoh import ext

from pipeline.messages import Message
from pipeline.streams import Stream, stream_of
from pipeline.transport.bus import Delivery, Inbox, publishing_key
from pipeline.transport.codec import encode
from pipeline.transport.errors import TransportError
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

HEARTBEAT = 0.5  # a publisher says how far it is [s]
FETCH_TIMEOUT = 2.0  # for the beginning of a stream; it is held back so long at most [s]


@dataclass(frozen=True, slots=True)
class Link:
    """One connection of a session."""

    zid: str  # Zenoh's id of the other end
    address: str  # of the other end
    name: str  # in the certificate that the other end showed; "" without one


class ZenohBus:
    """One Zenoh session. `publish` belongs to one thread; a subscriber's inbox is filled by
    Zenoh's threads.

    Raises TransportError where the session cannot be opened: a port in use, a client without a
    router, a configuration that Zenoh does not know.
    """

    def __init__(self, settings: ZenohSettings | None = None) -> None:
        self._session = _opened(settings or ZenohSettings())
        self._publishers: dict[str, ext.AdvancedPublisher] = {}
        self._subscriptions: list[ZenohSubscription] = []
        self._queryables: list[zenoh.Queryable[None]] = []  # forgotten by Zenoh unless held
        self._beginnings = _Beginnings(self._session)

    def publish(self, message: Message) -> None:
        key = publishing_key(message)
        payload = encode(message)
        if key not in self._publishers:
            self._publishers[key] = _publisher(self._session, key, stream_of(type(message)))
        self._publishers[key].put(payload)

    def subscribe(self, message_types: Sequence[type], inbox: Inbox) -> "ZenohSubscription":
        subscription = ZenohSubscription(self._session, self._beginnings, message_types, inbox)
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
    """What the sessions that can be reached through an endpoint answer on these keys.

    Raises TransportError where nobody listens there.
    """
    if isinstance(whom, str):
        whom = ZenohSettings(mode="client", connect=(whom,))
    session = _opened(whom)
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
        beginnings: "_Beginnings",
        message_types: Sequence[type],
        inbox: Inbox,
    ) -> None:
        self._lost: Counter[type] = Counter()
        self._counting = threading.Lock()
        # Zenoh forgets a subscriber or listener that nobody holds.
        self._subscribers = [
            _subscriber(
                session, stream_of(message_type), _Arrivals(message_type, inbox, beginnings)
            )
            for message_type in message_types
        ]
        self._miss_listeners = [
            subscriber.sample_miss_listener(self._missed(message_type))
            for subscriber, message_type in zip(self._subscribers, message_types, strict=True)
        ]

    @property
    def lost(self) -> int:
        return self._lost.total()

    def lost_of(self, message_type: type) -> int:
        return self._lost[message_type]

    def close(self) -> None:
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


@dataclass(frozen=True, slots=True)
class _Publisher:
    """Who published a sample: one advanced publisher of one session, on one key."""

    session: str
    entity: int
    key: str


class _Arrivals:
    """Puts the samples of one stream into an inbox, each publisher's from their beginning.

    Called by Zenoh's threads; asks Zenoh for nothing by itself.
    """

    def __init__(self, message_type: type, inbox: Inbox, beginnings: "_Beginnings") -> None:
        self._message_type = message_type
        self._inbox = inbox
        self._beginnings = beginnings
        self._arriving = threading.Lock()
        self._known: set[_Publisher] = set()
        self._held: dict[_Publisher, list[Delivery]] = {}  # while their beginning is fetched

    def __call__(self, sample: zenoh.Sample) -> None:
        delivery = self._delivery(sample)
        publisher, number = _origin(sample)
        with self._arriving:
            if publisher in self._held:
                self._held[publisher].append(delivery)
            elif publisher in self._known or number == 0:
                self._known.add(publisher)
                self._inbox.put(delivery)
            else:
                self._known.add(publisher)
                self._held[publisher] = [delivery]
                self._beginnings.ask(publisher, number, self.begin)

    def begin(self, publisher: _Publisher, earlier: Iterable[zenoh.Sample]) -> None:
        """Let a stream that was held back go on, after what came before it."""
        beginning = [self._delivery(sample) for sample in earlier]
        with self._arriving:
            for delivery in beginning + self._held.pop(publisher):
                self._inbox.put(delivery)

    def _delivery(self, sample: zenoh.Sample) -> Delivery:
        return Delivery(self._message_type, str(sample.key_expr), sample.payload.to_bytes())


def _origin(sample: zenoh.Sample) -> tuple[_Publisher, int]:
    """Who published a sample, and its number in their count from 0; 0 where nobody says so."""
    key, source = str(sample.key_expr), sample.source_info
    if source is None:
        return _Publisher("", 0, key), 0
    return _Publisher(str(source.source_id.zid), source.source_id.eid, key), source.source_sn


_Begin = Callable[[_Publisher, Iterable[zenoh.Sample]], None]


class _Beginnings:
    """Fetches the samples before the first that arrived, in a thread of its own."""

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._asked: queue.SimpleQueue[tuple[_Publisher, int, _Begin] | None]
        self._asked = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._fetch_all, name="beginnings", daemon=True)
        self._thread.start()

    def ask(self, publisher: _Publisher, first_number: int, begin: _Begin) -> None:
        """Have `begin` called with what the publisher still has from before this number."""
        self._asked.put((publisher, first_number, begin))

    def close(self) -> None:
        """Fetch what has been asked for until now, then no more."""
        self._asked.put(None)
        self._thread.join()

    def _fetch_all(self) -> None:
        while (asked := self._asked.get()) is not None:
            publisher, first_number, begin = asked
            earlier: list[zenoh.Sample] = []
            try:
                earlier = self._fetched(publisher, first_number)
            except zenoh.ZError as error:
                logger.warning(
                    "the beginning of %s, %d messages, could not be fetched: %s",
                    *(publisher.key, first_number, without_source(str(error))),
                )
            begin(publisher, earlier)

    def _fetched(self, publisher: _Publisher, first_number: int) -> list[zenoh.Sample]:
        # The selector with which Zenoh's own subscriber asks a publisher for what it missed.
        selector = (
            f"{publisher.key}/@adv/*/{publisher.session}/{publisher.entity}/**"
            f"?_sn=..{first_number - 1}"
        )
        replies = self._session.get(
            selector,
            target=zenoh.QueryTarget.ALL,
            consolidation=zenoh.ConsolidationMode.NONE,
            accept_replies=zenoh.ReplyKeyExpr.ANY,
            timeout=FETCH_TIMEOUT,
        )
        samples = {_origin(reply.ok): reply.ok for reply in replies if reply.ok is not None}
        earlier = [(who, number) for who, number in samples if who == publisher]
        return [
            samples[origin]
            for origin in sorted(earlier, key=lambda origin: origin[1])
            if origin[1] < first_number
        ]


def _publisher(session: zenoh.Session, key: str, stream: Stream) -> ext.AdvancedPublisher:
    return ext.declare_advanced_publisher(
        session,
        key,
        congestion_control=zenoh.CongestionControl.DROP,
        cache=ext.CacheConfig(max_samples=stream.cached),
        sample_miss_detection=ext.MissDetectionConfig(heartbeat=HEARTBEAT, sporadic_heartbeat=None),
        publisher_detection=True,
    )


def _subscriber(
    session: zenoh.Session, stream: Stream, arrive: Callable[[zenoh.Sample], None]
) -> "ext.AdvancedSubscriber[None]":
    return ext.declare_advanced_subscriber(
        session,
        stream.key_expression,
        arrive,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=stream.cached),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )


def _opened(settings: ZenohSettings) -> zenoh.Session:
    try:
        return zenoh.open(configuration(settings))
    except zenoh.ZError as error:
        raise TransportError(explained(settings, str(error))) from error
