"""How the parts of one session find each other over Zenoh."""

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from pipeline.monitoring.status import ENDPOINT_FILE, StatusNode
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings, free_endpoint


@dataclass(frozen=True, slots=True)
class ZenohEndpoints:
    """How the parts of one session find each other."""

    hub: ZenohSettings
    """Of the one that the source speaks through and that answers for all."""
    nodes: ZenohSettings
    """Of every node."""
    endpoint: str
    """Where the session can be asked from this machine; "" where it listens nowhere."""


def meeting_point(settings: ZenohSettings) -> ZenohEndpoints:
    """The nodes are clients of the hub, which routes between them and everybody else; where the hub
    is a client, all are clients of one router.

    A client connects again to its one link when that is lost. Two peers that found each other
    through a third do not, as long as their links to the third hold: of a machine that had no time
    for ten seconds a recorder missed all later posteriors.

    Raises TransportError for a configuration file that is none.
    """
    if settings.role == "client":
        return ZenohEndpoints(settings, settings, next(iter(settings.endpoints), ""))
    if settings.role == "peer" and settings.config_file is None:
        endpoint = settings.listen[0] if settings.listen else free_endpoint()
        hub = replace(settings, listen=settings.listen or (endpoint,))
    else:
        endpoint = free_endpoint()
        hub = replace(settings, local=endpoint)
    return ZenohEndpoints(hub, ZenohSettings(mode="client", connect=(endpoint,)), endpoint)


@contextmanager
def open_hub(
    meeting: ZenohEndpoints,
    node: StatusNode,
    key: str,
    out: Path,
    stopping: threading.Event | None,
) -> Iterator[ZenohBus]:
    """The session that all others connect to; it answers for all, and its folder records where."""
    place = out / ENDPOINT_FILE
    bus = ZenohBus(meeting.hub, stopping)
    node.connections = lambda: Counter(link.name or link.address for link in bus.links())
    try:
        bus.answer(key, node.answer)
        place.write_text(f"{meeting.endpoint}\n", encoding="utf-8")
        yield bus
    finally:
        place.unlink(missing_ok=True)
        bus.close()


def bus_options(settings: ZenohSettings) -> list[str]:
    """Return the settings of a bus as they are given on the command line."""
    given = [("--connect", endpoint) for endpoint in settings.connect]
    given += [("--listen", endpoint) for endpoint in settings.listen]
    if settings.mode != "peer":
        given.append(("--mode", settings.mode))
    if settings.config_file is not None:
        given.append(("--zenoh-config", str(settings.config_file)))
    return [word for option in given for word in option]
