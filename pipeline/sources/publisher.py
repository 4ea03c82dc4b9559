"""A source that publishes and does nothing else: what runs on a tower, or stands in for one."""

import logging
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING

from pipeline.messages import Message
from pipeline.runtime.node_thread import open_session
from pipeline.runtime.source_feed import with_end
from pipeline.sources.durable_publisher import kept_until_acknowledged
from pipeline.sources.recorded_source import RecordedSource
from pipeline.sources.recorded_stream import SourceError
from pipeline.sources.replay_control import REPLAY_KEY, ReplayControl
from pipeline.sources.spool import Spool
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from sensors.acquisition.blocks import AccelerationBlock

if TYPE_CHECKING:
    from pipeline.sources.sources import Source

logger = logging.getLogger(__name__)

LINKS_SETTLE = 2.0  # of links between a new publisher and who subscribes [s]
LINGER = 5.0  # after the last block, for subscribers that ask for what they missed [s]


def publish_source(
    source: "Source | RecordedSource",
    settings: ZenohSettings,
    *,
    speed: float,
    stopping: threading.Event,
    report: Callable[[AccelerationBlock], None] | None = None,
    spool: Spool | None = None,
) -> int:
    """Publish a recorded or simulated source at a speed; gives the number of blocks.

    Parameters
    ----------
    spool : Spool, optional
        Keeps blocks until a shore station has them, and is closed in the end; None: what the
        transport keeps in memory has to do.

    Raises
    ------
    SourceError
        For a live source.
    TransportError
        If no endpoint can be reached.
    """
    if source.is_live:
        raise SourceError(
            "--source live is what others publish; choose replay:FILE or simulate:SCENARIO"
        )
    control = ReplayControl(source, speed, stopping)
    published = 0
    with ExitStack() as stack:
        bus = stack.enter_context(open_session(lambda: ZenohBus(settings)))
        assert isinstance(bus, ZenohBus)
        bus.answer(f"{REPLAY_KEY}/{source.layout.turbine}", control.answer)
        publish = stack.enter_context(kept_until_acknowledged(bus, spool))
        messages = with_end(control.messages())
        for message in messages if speed <= 1.0 else settled(messages, stopping.wait):
            if stopping.is_set():
                break
            publish(message)
            if isinstance(message, AccelerationBlock):
                published += 1
                if report:
                    report(message)
        stopping.wait(LINGER)
    return published


def settled(messages: Iterable[Message], wait: Callable[[float], object]) -> Iterator[Message]:
    """Yield messages; wait for the links once the first block of every unit is out.

    As fast as it can, a source would send more before anything listens than the transport keeps for
    late subscribers.

    Parameters
    ----------
    messages : iterable of Message
        Blocks of several units alternate.
    wait : callable
        Waits so many seconds.
    """
    seen: set[tuple[str, str]] = set()
    has_waited = False
    for message in messages:
        if isinstance(message, AccelerationBlock) and not has_waited:
            unit = (message.turbine, message.unit)
            if unit in seen:
                wait(LINKS_SETTLE)
                has_waited = True
            seen.add(unit)
        yield message
