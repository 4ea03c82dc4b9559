"""What the messages of a feed bring, channel by channel → the AccelerationBlocks of one unit.

topic a  |▮▮▮▮|▮▮▮▮|    |▮▮▮▮|        each piece goes where its stamp places it, on one clock
topic b    |▮▮▮▮|▮▮▮▮|▮▮▮▮|▮▮▮▮|      whose samples the stamps' jitter does not move
             │ rows that every channel has, or for which no channel is waited for any longer
blocks   |0   |1   |2   |3   |        what only some channels lack is NaN, what all lack a gap

Decisions depend on the stamps alone, never on when a message arrived.
"""

import logging
from collections.abc import Iterator

from sensors.acquisition.blocks import BLOCK_DURATION, AccelerationBlock
from sensors.feeds.assembly.block_builder import SessionNames
from sensors.feeds.assembly.channel_map import LayoutColumns
from sensors.feeds.assembly.clock_estimate import (
    SET_ANEW,
    STAMPS,
    RateFinder,
    RateMonitor,
    are_equal,
)
from sensors.feeds.assembly.timestamp_alignment import TimestampAligner
from sensors.feeds.protocol import ChannelSamples, FeedCounts
from sensors.files.layout_file import LayoutFile

logger = logging.getLogger(__name__)

WAIT = 2.0  # of sensor time, for a channel that is late [s]
MOST_EARLY = 10_000  # pieces that wait for a rate
LONGEST_PIECE = 120.0  # of one message [s], however slow the sampling
SHORTEST_LIMIT = 4096  # samples that a message may always have


class Assembler:
    """Puts together the channels of one unit.

    Parameters
    ----------
    layout : LayoutFile
        Which channels there are, and in which unit they come.
    counts : FeedCounts
        Takes what is late, duplicate, unknown or wild.
    sampling_rate : float, optional
        [Hz]; None: as the messages state, or the stamps of single samples; what they state for long
        enough begins a session at another rate.
    block : float, optional
        Length of a block [s].
    wait : float, optional
        For a channel that is late [s of sensor time]; at least two messages' length.
    """

    def __init__(
        self,
        layout: LayoutFile,
        counts: FeedCounts,
        *,
        sampling_rate: float | None = None,
        block: float = BLOCK_DURATION,
        wait: float = WAIT,
    ) -> None:
        self._columns = LayoutColumns(layout)
        self._counts = counts
        self._given, self._rate = sampling_rate, sampling_rate
        self._block, self._wait = block, wait
        self._finder, self._watch = RateFinder(), RateMonitor()
        self._sessions = SessionNames()
        self._early: list[ChannelSamples] = []  # that came before the rate was known
        self._placing: TimestampAligner | None = None
        self._taken = 0  # pieces at the present rate
        self._missing = 0  # blocks that gaps at earlier rates cost
        self._rates_set = 0  # times that the rate became another one

    @property
    def missing_blocks(self) -> int:
        """Blocks that the gaps so far cost."""
        return self._missing + (self._placing.missing_blocks if self._placing else 0)

    def push(self, piece: ChannelSamples) -> Iterator[AccelerationBlock]:
        """Take what a message brought; give the blocks that it completes."""
        usable = self._usable(piece)
        if usable is None:
            return
        self._early.append(usable)
        self._rate = self._rate or self._stated_rate(usable)
        if self._rate is None:
            return
        early, self._early = self._early, []
        for each in early:
            yield from self._rated(each)

    def finish(self) -> Iterator[AccelerationBlock]:
        """Nothing more will come: give what is left."""
        if self._early:
            self._counts.refuse(
                f"{self._early[-1].stream}: {len(self._early)} samples and no rate; {STAMPS} of a "
                "channel show it, or the option rate= says it"
            )
        if self._placing is not None:
            yield from self._placing.finish()

    def _usable(self, piece: ChannelSamples) -> ChannelSamples | None:
        """Return what a piece has of the layout's channels; None where that is nothing."""
        for name in piece.names:
            if not self._columns.has(name):
                self._counts.miss(name)
        listed = self._columns.listed(piece)
        if not listed.names:
            return None
        refusal = self._columns.refusal(listed)
        if not listed.samples.size:
            refusal = f"{piece.stream}: a message without samples"
        if refusal:
            self._refuse(piece, refusal)
            return None
        return listed

    def _refuse(self, piece: ChannelSamples, reason: str) -> None:
        """Count a piece that is dropped; what follows it by its number lies behind a gap."""
        self._counts.refuse(reason)
        if self._placing is not None:
            self._placing.interrupt(piece.stream)

    def _stated_rate(self, piece: ChannelSamples) -> float | None:
        rate = piece.sampling_rate
        if rate is None and len(piece.samples) == 1:
            rate = self._finder.rate(piece.stream, piece.start_ns)
        if rate is None and len(self._early) > MOST_EARLY:
            self._counts.refuse(f"{piece.stream} has no sampling rate; give the option rate=")
            self._early.clear()
        return rate

    def _rated(self, piece: ChannelSamples) -> Iterator[AccelerationBlock]:
        """A piece whose unit's rate is known, or is another one from now on."""
        assert self._rate is not None
        stated = piece.sampling_rate or self._rate
        if self._watch.has_changed(stated, self._rate) and self._may_change_the_rate(piece):
            yield from self.finish()
            self._missing, self._placing, self._taken = self.missing_blocks, None, 0
            self._log_new_rate(piece.stream, stated)
            self._rate = stated
        if self._fits(piece, self._rate):
            yield from self._placed(piece, self._rate)

    def _log_new_rate(self, stream: str, stated: float) -> None:
        self._rates_set += 1
        if self._rates_set.bit_count() == 1:  # the 1st, 2nd, 4th, 8th, …: nonsense fills no log
            logger.warning(
                "%r is sampled at %g Hz from now on, not at %g Hz: a session begins",
                stream,
                stated,
                self._rate,
            )

    def _may_change_the_rate(self, piece: ChannelSamples) -> bool:
        """Whether it is the unit's own, rather than another one's that never had its rate."""
        if self._given is not None or self._placing is None:
            return False
        return self._taken < SET_ANEW or self._placing.knows(piece.stream)

    def _fits(self, piece: ChannelSamples, rate: float) -> bool:
        """Whether a piece has the unit's rate and a length that can be waited for."""
        stated = piece.sampling_rate or rate
        if not are_equal(stated, rate):
            self._refuse(
                piece,
                f"{piece.stream} is sampled at {stated:g} Hz, the unit at {rate:g} Hz; what is "
                "sampled otherwise is a unit of its own",
            )
            return False
        longest = max(SHORTEST_LIMIT, LONGEST_PIECE * rate)
        if len(piece.samples) > longest:
            self._refuse(
                piece,
                f"{piece.stream}: a message of {len(piece.samples)} samples; at most {longest:g}",
            )
            return False
        return True

    def _placed(self, piece: ChannelSamples, rate: float) -> Iterator[AccelerationBlock]:
        if self._placing is None:
            size = max(1, round(self._block * rate))
            self._placing = TimestampAligner(
                piece,
                self._columns,
                self._counts,
                rate=rate,
                size=size,
                wait=self._wait,
                sessions=self._sessions,
            )
        self._taken += 1
        yield from self._placing.push(piece)
