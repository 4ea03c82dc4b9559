"""The bus over Zenoh: nodes in threads, in processes, on several machines.

Every node has a session of its own. By default sessions are peers on this machine: no router,
no multicast scouting, loopback only. One of them listens on an endpoint that the others know
(`hub`); the others connect to it (`peer_of`), hear of each other by gossip and then talk
directly. They may start in any order, and the hub may go: the others keep their links.

Zenoh drops samples where a link is cut or a reader too slow, so every publisher keeps the last
`Stream.cached` samples of each key and says twice a second how far it is; a subscriber asks for
what it missed, and what can no longer be had is counted (`ZenohSubscription.lost`). A put never
waits for a reader.

This is the only module that imports zenoh. Its advanced publisher and subscriber are labelled
unstable, hence the narrow version range in pyproject.toml.
"""

import json
import re
import socket
import threading
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import zenoh
from zenoh import ext

from pipeline.messages import Message
from pipeline.streams import Stream, stream_of
from pipeline.transport.bus import Delivery, Inbox, publishing_key
from pipeline.transport.codec import encode
from pipeline.transport.errors import TransportError

LOOPBACK = "127.0.0.1"
HEARTBEAT = 0.5  # a publisher says how far it is [s]
FIRST_RETRY_MS = 100  # to connect to a hub that is not there yet
LONGEST_RETRY_MS = 1000

_MESSAGE_OF_ERROR = re.compile(r'msg: "(.*)", location', re.DOTALL)
_SOURCE_OF_ERROR = re.compile(r"( at /\S+?:\d+\.?| \(os error \d+\))")  # inside zenoh's own code


@dataclass(frozen=True, slots=True)
class ZenohSettings:
    """How one session finds the others. Endpoints are like "tcp/127.0.0.1:7447"."""

    mode: Literal["peer", "client", "router"] = "peer"
    listen: tuple[str, ...] = ()  # none: a peer takes any free port of the loopback interface
    connect: tuple[str, ...] = ()
    scouting: bool = False  # find other sessions by multicast
    config_file: Path | None = None  # Zenoh's own JSON5; the settings above are laid over it


def hub(endpoint: str) -> ZenohSettings:
    """The one session that listens where all others look."""
    return ZenohSettings(listen=(endpoint,))


def peer_of(endpoint: str) -> ZenohSettings:
    """A session that finds the others through the hub at this endpoint."""
    return ZenohSettings(connect=(endpoint,))


def free_endpoint() -> str:
    """A loopback endpoint that nobody listens on at this moment."""
    with socket.socket() as probe:
        probe.bind((LOOPBACK, 0))
        return f"tcp/{LOOPBACK}:{probe.getsockname()[1]}"


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

    def publish(self, message: Message) -> None:
        key = publishing_key(message)
        payload = encode(message)
        if key not in self._publishers:
            self._publishers[key] = _publisher(self._session, key, stream_of(type(message)))
        self._publishers[key].put(payload)

    def subscribe(self, message_types: Sequence[type], inbox: Inbox) -> "ZenohSubscription":
        subscription = ZenohSubscription(self._session, message_types, inbox)
        self._subscriptions.append(subscription)
        return subscription

    def close(self) -> None:
        for subscription in self._subscriptions:
            subscription.close()
        for publisher in self._publishers.values():
            publisher.undeclare()
        self._publishers.clear()
        self._session.close()


class ZenohSubscription:
    """Some streams on their way into one inbox, and what was missed of them for good."""

    def __init__(self, session: zenoh.Session, message_types: Sequence[type], inbox: Inbox) -> None:
        self._lost: Counter[type] = Counter()
        self._counting = threading.Lock()
        # Zenoh forgets a subscriber or listener that nobody holds.
        self._subscribers = [
            _subscriber(session, stream_of(message_type), inbox) for message_type in message_types
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
    session: zenoh.Session, stream: Stream, inbox: Inbox
) -> "ext.AdvancedSubscriber[None]":
    def deliver(sample: zenoh.Sample) -> None:
        key, payload = str(sample.key_expr), sample.payload.to_bytes()
        inbox.put(Delivery(stream.message, key, payload))

    return ext.declare_advanced_subscriber(
        session,
        stream.key_expression,
        deliver,
        history=ext.HistoryConfig(detect_late_publishers=True, max_samples=stream.cached),
        recovery=ext.RecoveryConfig(heartbeat=True, periodic_queries=None),
    )


def _opened(settings: ZenohSettings) -> zenoh.Session:
    try:
        return zenoh.open(_configuration(settings))
    except zenoh.ZError as error:
        raise TransportError(_explained(settings, str(error))) from error


def _configuration(settings: ZenohSettings) -> zenoh.Config:
    config = zenoh.Config()
    if settings.config_file is not None:
        config = _configuration_file(settings.config_file)
    for entry, value in _entries(settings).items():
        config.insert_json5(entry, json.dumps(value))
    return config


def _entries(settings: ZenohSettings) -> dict[str, Any]:
    """What is laid over Zenoh's defaults, or over the file where it leaves no choice."""
    entries: dict[str, Any] = {"timestamping/enabled": True}  # what is cached needs its time
    if settings.listen:
        entries["listen/endpoints"] = settings.listen
    if settings.connect:
        entries["connect/endpoints"] = settings.connect
    if settings.config_file is not None:
        return entries
    if not settings.listen and settings.mode != "client":
        entries["listen/endpoints"] = [f"tcp/{LOOPBACK}:0"]
    return entries | {
        "mode": settings.mode,
        "scouting/multicast/enabled": settings.scouting,
        "connect/retry": {
            "period_init_ms": FIRST_RETRY_MS,
            "period_max_ms": LONGEST_RETRY_MS,
            "period_increase_factor": 2,
        },
    }


def _configuration_file(path: Path) -> zenoh.Config:
    if not path.is_file():
        raise TransportError(f"there is no Zenoh configuration {path}")
    try:
        return zenoh.Config.from_file(path)
    except zenoh.ZError as error:
        raise TransportError(
            f"{path} is no Zenoh configuration: {_without_source(str(error))}"
        ) from error


def _explained(settings: ZenohSettings, error: str) -> str:
    if "Address already in use" in error:
        return (
            f"cannot listen on {_listed(settings.listen)}: the port is in use; "
            "stop the other program or choose another endpoint"
        )
    if "Unable to connect" in error:
        return f"no Zenoh session answers at {_listed(settings.connect)}; a client needs a router"
    return f"cannot open a Zenoh session: {_without_source(error)}"


def _listed(endpoints: tuple[str, ...]) -> str:
    return ", ".join(endpoints) or "the endpoints of its configuration file"


def _without_source(error: str) -> str:
    message = _MESSAGE_OF_ERROR.search(error)
    return " ".join(_SOURCE_OF_ERROR.sub("", message[1] if message else error).split())
