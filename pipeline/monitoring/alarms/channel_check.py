"""A test message through every channel: `pilewatch notices FILE --test`."""

import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from pipeline.monitoring.alarms.channels import DeliveryFailed, channels_of, origin, post_json
from pipeline.monitoring.alarms.settings import AlarmSettings

TEXT = "a test of the alarm channels; nothing is wrong"


@dataclass(frozen=True, slots=True)
class ChannelCheck:
    """What became of a test message."""

    channel: str
    """Its name, e.g. "webhook-1"."""
    place: str
    """The receiver, without secrets."""
    seconds: float
    """Until it was confirmed or given up [s]."""
    problem: str
    """Why it did not arrive; "" if it did."""


def checked_channels(settings: AlarmSettings, folder: Path) -> Iterator[ChannelCheck]:
    """Send one test message through each channel and one ping to each heartbeat.

    Parameters
    ----------
    settings : AlarmSettings
        The notices file.
    folder : Path
        Of the session that the messages name.
    """
    now_ns = time.time_ns()
    where = {"host": socket.gethostname(), "session": str(folder)}
    message = {
        **{"occasion": "test", "id": 0, "serial": now_ns, "kind": "test", "turbine": "session"},
        **{"text": f"session: {TEXT}", "cause": TEXT, "count": 1, "acknowledged": False},
        **{"first_ns": now_ns, "last_ns": now_ns},
        **where,
    }
    for channel in channels_of(settings):
        yield _checked(channel.name, channel.place, partial(channel.send, message))
    for number, each in enumerate(settings.heartbeat, start=1):
        ping = {**where, "time_ns": now_ns, "open": 0}
        yield _checked(
            f"heartbeat-{number}",
            origin(each.url),
            partial(post_json, each, ping, {}),
        )


def _checked(name: str, place: str, send: Callable[[], None]) -> ChannelCheck:
    started, problem = time.monotonic(), ""
    try:
        send()
    except DeliveryFailed as failure:
        problem = str(failure)
    return ChannelCheck(name, place, time.monotonic() - started, problem)
