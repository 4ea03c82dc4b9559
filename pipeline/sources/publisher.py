"""A source that publishes and does nothing else: what runs on a tower, or stands in for one. It
sends blocks again until the shore has them on its disk.

    block ──► spool on disk ──► bus ──► … ──► recorder ──► disk
                 ▲ let go                         │
                 └──────── RecordedUntil ◄────────┘

What the transport keeps in memory is the fast way over a link that was cut; the spool is for longer
cuts, restarts of this process and power cuts on either side. While nothing is acknowledged, one
block now and then asks whether the shore is back; then so many are on their way at once.

The spool is looked after by the thread that publishes, which is awake: a thread that woke for it
costs a unit as much again as the disk does.
"""

import logging
import math
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from types import TracebackType
from typing import TYPE_CHECKING

from pipeline.messages import Message, QualityWarning, RecordedUntil
from pipeline.runtime.node_thread import open_session
from pipeline.runtime.source_feed import with_end
from pipeline.sources.recorded_source import RecordedSource
from pipeline.sources.recorded_stream import SourceError
from pipeline.sources.replay_control import REPLAY_KEY, ReplayControl
from pipeline.sources.spool import Spool, SpooledBlock
from pipeline.streams import stream_of
from pipeline.transport.bus import Bus, Inbox
from pipeline.transport.codec import encode
from pipeline.transport.zenoh_bus import ZenohBus, ZenohSettings
from sensors.acquisition.blocks import AccelerationBlock

if TYPE_CHECKING:
    from pipeline.sources.sources import Source

logger = logging.getLogger(__name__)

LINKS_SETTLE = 2.0  # of links between a new publisher and who subscribes [s]
LINGER = 5.0  # after the last block, for subscribers that ask for what they missed [s]
SYNCED_WITHIN = 0.9  # after a block was written [s]
TENDED_EVERY = 5.0  # where nothing is published [s]
SENT_AGAIN_AFTER = 15.0  # without an acknowledgement [s]
ANSWERS_WITHIN = 10.0  # a shore that has acknowledged something is there for so long [s]
MOST_ON_THEIR_WAY = 200  # blocks that are sent again and not acknowledged yet


class DurablePublisher:
    """A bus to publish on, with a spool behind it, and a thread that looks after it in silence.

    Parameters
    ----------
    clock : callable, optional
        → [s], never set back.
    """

    def __init__(
        self, bus: Bus, spool: Spool, *, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self.sent_again = 0
        """Blocks that were sent once more."""
        self._bus = bus
        self._spool = spool
        self._clock = clock
        self._busy = threading.Lock()
        self._inbox = Inbox()
        self._subscribed: set[tuple[str, str]] = set()  # turbines and units that are listened for
        self._answered: float | None = None  # when something was acknowledged last [s]
        self._tended = -math.inf  # acknowledgements taken, and synced [s]
        self._has_unsynced = threading.Event()
        self._is_publishing = False
        self._refused = ""  # why the disk does not take more
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._look_after, name="spool", daemon=True)

    def __enter__(self) -> "DurablePublisher":
        for spooled in self._spool.waiting():
            self._listen(spooled.session[0], spooled.session[1])
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stopping.set()
        self._has_unsynced.set()
        self._thread.join()
        self._take_acknowledgements()
        self._spool.close()
        if len(self._spool):
            logger.warning(
                "%d blocks are not acknowledged by a shore station; they stay in %s and are sent "
                "again at the next start",
                *(len(self._spool), self._spool.folder),
            )

    def publish(self, message: Message) -> None:
        """Publish a message; a block stays in the spool until it is acknowledged."""
        with self._busy:
            payload = None
            if isinstance(message, AccelerationBlock):
                payload = encode(message)
                self._listen(message.turbine, message.unit)
                with self._disk():
                    self._spool.append(message, payload, self._clock())
            self._bus.publish(message, payload)
            self._is_publishing = True
            if self._is_due:
                self._tend()
            elif payload is not None:
                self._has_unsynced.set()

    @property
    def warnings(self) -> tuple[QualityWarning, ...]:
        """What the spool could not keep."""
        return tuple(self._warnings())

    def tend(self) -> None:
        """Take acknowledgements, sync and send again what is due; publishing does so regularly."""
        with self._busy:
            self._tend()

    @property
    def _is_due(self) -> bool:
        return self._clock() - self._tended >= SYNCED_WITHIN

    def _tend(self) -> None:
        self._take_acknowledgements()
        if self._is_due:
            self._tended = self._clock()
            if not self._spool.is_synced:  # else a disk that has just refused seems to take more
                with self._disk():
                    self._spool.sync()
            self._has_unsynced.clear()
        if self._is_publishing:  # the layout is known then
            now = self._clock()
            for spooled in list(self._due(now)):
                self._send_again(spooled, now)

    def _look_after(self) -> None:
        while not self._stopping.is_set():
            if self._has_unsynced.wait(TENDED_EVERY):
                self._stopping.wait(max(0.0, self._tended + SYNCED_WITHIN - self._clock()))
            self.tend()

    def _listen(self, turbine: str, unit: str) -> None:
        if (turbine, unit) not in self._subscribed:
            self._subscribed.add((turbine, unit))
            key = stream_of(RecordedUntil).key.format(turbine=turbine, unit=unit)
            self._bus.subscribe((RecordedUntil,), self._inbox, key=key)

    @contextmanager
    def _disk(self) -> Iterator[None]:
        """A disk that refuses costs the safety net, not the measurement."""
        try:
            yield
        except OSError as error:
            if not self._refused:
                logger.error("%s takes no more: %s", self._spool.folder, error.strerror or error)
            self._refused = error.strerror or str(error)
        else:
            self._refused = ""

    def _take_acknowledgements(self) -> None:
        while len(self._inbox) and (message := self._inbox.get(timeout=0)):
            assert isinstance(message, RecordedUntil)
            self._answered = self._clock()
            self._spool.acknowledge(message)

    def _due(self, now: float) -> Iterator[SpooledBlock]:
        """Blocks to send again: the oldest, as many as may be on their way."""
        answers = self._answered is not None and now - self._answered < ANSWERS_WITHIN
        room = MOST_ON_THEIR_WAY if answers else 1
        for spooled in self._spool.waiting():
            if room == 0:
                return
            if spooled.sent is None or now - spooled.sent >= SENT_AGAIN_AFTER:
                yield spooled
            room -= 1

    def _send_again(self, spooled: SpooledBlock, now: float) -> None:
        block = self._spool.read(spooled)
        if block is not None:
            spooled.sent = now
            self._bus.publish(block)
            self.sent_again += 1

    def _warnings(self) -> Iterator[QualityWarning]:
        spool = self._spool
        if self._refused:
            yield QualityWarning("spool", f"{spool.folder} takes no more: {self._refused}")
        if spool.dropped:
            yield QualityWarning(
                "spool", f"{spool.folder} is full: {spool.dropped} blocks went unacknowledged"
            )
        if spool.damaged:
            yield QualityWarning(
                "spool", f"{spool.damaged} records in {spool.folder} cannot be read"
            )


@contextmanager
def kept_until_acknowledged(
    bus: Bus,
    spool: Spool | None,
    warnings: Callable[[Callable[[], tuple[QualityWarning, ...]]], None] = lambda _: None,
) -> Iterator[Callable[[Message], None]]:
    """What publishes on a bus, with a spool behind it where there is one.

    Parameters
    ----------
    spool : Spool or None
        Is closed in the end.
    warnings : callable, optional
        Takes what gives the spool's warnings.
    """
    if spool is None:
        yield bus.publish
        return
    with DurablePublisher(bus, spool) as publisher:
        warnings(lambda: publisher.warnings)
        yield publisher.publish


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
        bus = stack.enter_context(open_session(lambda: ZenohBus(settings, stopping)))
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
