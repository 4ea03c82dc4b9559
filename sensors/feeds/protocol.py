"""What a feed is: something that gives samples as they are measured, for as long as it is let."""

import asyncio
from collections import Counter
from dataclasses import dataclass, field
from typing import Protocol

from sensors.acquisition.blocks import BlockStatus
from sensors.acquisition.scada import ScadaSample
from sensors.arrays import FloatArray
from sensors.errors import InputError

INBOX_ARRIVALS = 10_000  # that wait to be taken out; then a feed is held up, or drops (UDP)
NAMED_UNKNOWN = 20  # channels that no layout lists: so many are remembered by name
LONGEST_NAME, LONGEST_SENTENCE = 60, 240  # of untrusted names and sentences [characters]


class FeedError(InputError):
    """A feed that cannot be understood, opened or reached."""


@dataclass(frozen=True, slots=True, eq=False)
class ChannelSamples:
    """Consecutive samples of some channels of an instrument, as one message brought them."""

    stream: str
    """Whose numbering and time they belong to: a topic, a SEED channel, a sender."""
    names: tuple[str, ...]
    """Of the channels, as the instrument has them."""
    samples: FloatArray
    """(n_samples, n_names), in the instrument's unit."""
    start_ns: int
    """The instrument's clock at the first sample [ns since 1970-01-01 UTC]."""
    sampling_rate: float | None = None
    """[Hz]; None: the message does not state it."""
    follows: bool | None = None
    """Directly on the stream's last one, by their numbers; None: no numbers, or not the next
    one.
    """
    unit: str = ""
    """Of the samples, where the message states it."""
    status: BlockStatus = BlockStatus.OK


Arrival = ChannelSamples | ScadaSample


@dataclass(slots=True)
class FeedCounts:
    """What a feed received, and what it did not; written by the feed, read by what serves it."""

    connected: bool = False
    connections: int = 0
    """How often the link was made."""
    received: int = 0
    """Messages."""
    lost: int = 0
    """Messages that never came, by their numbers."""
    late: int = 0
    """Messages that came too late to be used."""
    duplicate: int = 0
    """Messages that came twice."""
    malformed: int = 0
    """Messages that were dropped: broken, oversized, stamped by a wild clock."""
    forged: int = 0
    """Messages without the right signature."""
    retained: int = 0
    """Measurements that a broker had kept from before; left out."""
    unknown: Counter[str] = field(default_factory=Counter)
    """Channels that the layout does not list."""
    refusal: str = ""
    """Of the last malformed message: what was wrong."""
    problem: str = ""
    """Of the link: why it is down, or went down last."""

    def connect(self) -> bool:
        """Count that the link was made; whether it was there before."""
        self.connected = True
        self.connections += 1
        return self.connections > 1

    def refuse(self, sentence: str) -> None:
        """Count a message that is dropped, and keep why."""
        self.malformed += 1
        self.refusal = printable(sentence, LONGEST_SENTENCE)

    def refuse_forged(self, sentence: str) -> None:
        """Count a message without the right signature."""
        self.forged += 1
        self.refusal = printable(sentence, LONGEST_SENTENCE)

    def miss(self, channel: str) -> None:
        """Count samples of a channel that the layout does not list."""
        name = printable(channel, LONGEST_NAME)
        if name in self.unknown or len(self.unknown) < NAMED_UNKNOWN:
            self.unknown[name] += 1


def printable(text: str, longest: int) -> str:
    """An untrusted text, made fit for a terminal and a status: no control characters, no more than
    so many characters."""
    if len(text) > longest:
        text = f"{text[: longest - 1]}…"
    return "".join(letter if letter.isprintable() else "�" for letter in text)


class ArrivalQueue(asyncio.Queue[Arrival]):
    """Bounded queue between a feed and the consumer of its arrivals."""

    def __init__(self, capacity: int = INBOX_ARRIVALS) -> None:
        super().__init__(capacity)


class Feed(Protocol):
    """One live source.

    `run` puts what arrives into the inbox until it is cancelled, and connects again by itself
    whenever its link is cut. It raises FeedError where a person must act: nothing can be bound, a
    package is missing, a password is refused; with `once`, also where nothing can be reached at
    the start.
    """

    @property
    def name(self) -> str:
        """What to call it: its address without secrets."""
        ...

    @property
    def counts(self) -> FeedCounts:
        """What came and what was wrong with it."""
        ...

    async def run(self, inbox: ArrivalQueue) -> None:
        """Put what arrives into the queue until it is cancelled."""
        ...
