"""Samples on their way from Zenoh into an inbox: each publisher's from their beginning.

    published    0 1 2 3 4 5 6 …
    link up              ┌──────
    arriving             3 4 5 …      held back
    fetched      0 1 2                asked of the publisher's cache
    inbox        0 1 2 3 4 5 6 …

Zenoh's advanced subscriber asks for what it misses between two samples. Where a link comes up while
samples are being published, though, the first that gets through opens the stream and those before
it are passed over in silence. So a stream that does not begin with its first sample is held back
until the samples before have been fetched too.
"""

import logging
import math
import queue
import struct
import threading
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import zenoh

from pipeline.streams import stream_of
from pipeline.transport.bus import Delivery, Inbox
from pipeline.transport.zenoh_settings import without_source
from sensors.bounded_dict import BoundedDict

logger = logging.getLogger(__name__)

HEARTBEAT = 0.5  # a publisher reports its position; misses are noticed then at the latest [s]
MOST_KNOWN_PUBLISHERS = 100_000  # publishers of a stream: each start of a unit is one more
FETCH_TIMEOUT = 2.0  # for an answer to who asks for the beginning of a stream [s]
PAUSES = (0.1, 0.3, 0.6)  # before it is asked for again, where it did not come [s]


@dataclass(frozen=True, slots=True)
class Publisher:
    """Who published a sample: one advanced publisher of one session, on one key."""

    session: str
    entity: int
    key: str


class Arrivals:
    """Puts the samples of one stream into an inbox, each publisher's from their beginning.

    Called by Zenoh's threads; asks Zenoh for nothing by itself. `recovered` counts the samples
    that were on their way for so long that they did not come by themselves: their link was down,
    or there was no listener yet; `lost` those of beginnings that were promised and can no longer
    be had.
    """

    def __init__(self, message_type: type, inbox: Inbox, beginnings: "Beginnings") -> None:
        self.recovered = 0
        self.lost = 0
        self._since = time.time()  # what is published from now on is promised [s since 1970]
        self._message_type = message_type
        self._inbox = inbox
        self._beginnings = beginnings
        self._arriving = threading.Lock()
        self._known = BoundedDict[Publisher, None](MOST_KNOWN_PUBLISHERS)
        """The latest to begin: one that was forgotten begins again, with what it still keeps, and
        those who listen know that they have it."""
        self._held: dict[Publisher, list[zenoh.Sample]] = {}  # while their beginning is fetched

    def __call__(self, sample: zenoh.Sample) -> None:
        """Take one sample from Zenoh's thread."""
        publisher, number = _origin(sample)
        with self._arriving:
            self.recovered += is_recovered(sample, time.time())
            if publisher in self._held:
                self._held[publisher].append(sample)
            elif publisher in self._known or number == 0:
                self._known[publisher] = None
                self._inbox.put(self._delivery(sample))
            else:
                self._known[publisher] = None
                self._held[publisher] = [sample]
                kept = stream_of(self._message_type).cached > 1  # else this one is all there is
                self._beginnings.ask(publisher, number, self.begin, patient=kept)

    def begin(self, publisher: Publisher, earlier: Iterable[zenoh.Sample]) -> None:
        """Let a stream that was held back go on, after what came before it."""
        beginning = list(earlier)
        with self._arriving:
            held = self._held.pop(publisher)
            self.recovered += len(beginning)
            self.lost += lost_at_beginning([*beginning, *held], self._since)
            for sample in (*beginning, *held):
                self._inbox.put(self._delivery(sample))

    def _delivery(self, sample: zenoh.Sample) -> Delivery:
        return Delivery(self._message_type, str(sample.key_expr), sample.payload.to_bytes())


def beginning(now: float) -> bytes:
    """Return what a sample carries of its publisher: when it began [s since 1970-01-01 UTC]."""
    return struct.pack("<d", now)


def lost_at_beginning(samples: Sequence[zenoh.Sample], since: float) -> int:
    """Return how many samples before these, a publisher's earliest that can be had, were promised.

    Parameters
    ----------
    samples : sequence of zenoh.Sample
        In the order of their numbers, one at least.
    since : float
        When the reader subscribed [s since 1970-01-01 UTC]; the clocks are taken to agree.
    """
    missing, oldest = _number(samples[0]), _published(samples[0])
    began = _began(samples[0])
    if missing == 0 or oldest is None or began is None or oldest <= since:
        return 0
    if began >= since:
        return missing
    duration = (_published(samples[-1]) or oldest) - began
    rhythm = _number(samples[-1]) / duration if duration > 0 else 0.0  # [1/s]
    return min(missing, math.floor((oldest - since) * rhythm))


def _number(sample: zenoh.Sample) -> int:
    return _origin(sample)[1]


def _published(sample: zenoh.Sample) -> float | None:
    """[s since 1970-01-01 UTC]; None where it is not stated."""
    if sample.timestamp is None:
        return None
    return float(sample.timestamp.get_time_as_ntp64().as_secs_f64())


def _began(sample: zenoh.Sample) -> float | None:
    """When a sample's publisher began; None where it does not state so."""
    attached = b"" if sample.attachment is None else sample.attachment.to_bytes()
    if len(attached) != struct.calcsize("<d"):
        return None
    (moment,) = struct.unpack("<d", attached)
    return moment if math.isfinite(moment) else None


def is_recovered(sample: zenoh.Sample, now: float) -> bool:
    """Whether a sample came later after its publishing than what comes by itself.

    Parameters
    ----------
    sample : zenoh.Sample
        That came.
    now : float
        [s since 1970-01-01 UTC]; the machines' clocks are taken to agree.
    """
    published = _published(sample)
    return published is not None and now - published > HEARTBEAT


def _origin(sample: zenoh.Sample) -> tuple[Publisher, int]:
    """Who published a sample, and its number in their count from 0; 0 where it is not stated."""
    key, source = str(sample.key_expr), sample.source_info
    if source is None:
        return Publisher("", 0, key), 0
    return Publisher(str(source.source_id.zid), source.source_id.eid, key), source.source_sn


_Begin = Callable[[Publisher, Iterable[zenoh.Sample]], None]


@dataclass(frozen=True, slots=True)
class _Wanted:
    """A beginning that is asked for."""

    publisher: Publisher
    first_number: int  # of the sample that arrived
    begin: _Begin
    patient: bool  # an answer that brings nothing is not believed at once
    attempt: int = 0
    due: float = 0.0  # not to be asked for before [s, monotonic]


class Beginnings:
    """Fetches the samples before the first that arrived, in a thread of its own.

    A router that has just come (back) may pass samples on before it knows whose cache to ask:
    where an answer brings nothing although something is kept, it is asked for again.
    """

    def __init__(self, session: zenoh.Session) -> None:
        self._session = session
        self._asked: queue.SimpleQueue[_Wanted | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._fetch_all, name="beginnings", daemon=True)
        self._thread.start()

    def ask(self, publisher: Publisher, first_number: int, begin: _Begin, *, patient: bool) -> None:
        """Have `begin` called with what the publisher still has from before this number.

        Parameters
        ----------
        publisher : Publisher
            Who is asked.
        first_number : int
            Of the first sample that came by itself.
        begin : callable
            Called with the samples.
        patient : bool
            Something is kept for sure: where nothing comes, ask again before giving up.
        """
        self._asked.put(_Wanted(publisher, first_number, begin, patient))

    def close(self) -> None:
        """Fetch what has been asked for until now, then no more."""
        self._asked.put(None)
        self._thread.join()

    def _fetch_all(self) -> None:
        closing = False
        while not (closing and self._asked.empty()):
            wanted = self._asked.get()
            if wanted is None:
                closing = True
                continue
            time.sleep(max(0.0, wanted.due - time.monotonic()))
            earlier = self._tried(wanted)
            if earlier or closing or not wanted.patient:
                wanted.begin(wanted.publisher, earlier)
            elif wanted.attempt < len(PAUSES):
                due = time.monotonic() + PAUSES[wanted.attempt]
                self._asked.put(replace(wanted, attempt=wanted.attempt + 1, due=due))
            else:
                logger.warning(
                    "no publisher has the %d messages with which %s begins any more",
                    *(wanted.first_number, wanted.publisher.key),
                )
                wanted.begin(wanted.publisher, [])

    def _tried(self, wanted: _Wanted) -> list[zenoh.Sample]:
        try:
            return self._fetched(wanted.publisher, wanted.first_number)
        except zenoh.ZError as error:
            logger.warning(
                "the beginning of %s, %d messages, could not be fetched: %s",
                *(wanted.publisher.key, wanted.first_number, without_source(str(error))),
            )
            return []

    def _fetched(self, publisher: Publisher, first_number: int) -> list[zenoh.Sample]:
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
