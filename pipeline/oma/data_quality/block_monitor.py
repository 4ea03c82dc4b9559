"""What the link and the unit's clock did with the blocks, by the blocks alone.

Everything is filed under sample numbers of the unit's boot: stamps are what is checked.
"""

from collections import Counter, deque
from datetime import UTC, datetime

import numpy as np

from pipeline.messages import QualityWarning
from pipeline.oma.windows.unit_clock import fit_clock
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

REMEMBERED_BLOCKS = 600  # blocks by which a repeated one is recognised
CLOCK_DRIFT = 10.0  # [ppm]; a crystal that is disciplined by GPS or PTP keeps better than 1
CLOCK_JITTER = 1e-3  # std of the blocks' stamps about a straight line [s]
STILL_BLOCKS = 2  # blocks on end in which a channel that is alive never keeps one value
REMEMBERED_STAMPS = 100_000  # blocks: a day of them without an estimate that asks
UNSET_BEFORE_NS = (
    978_307_200 * NANOSECONDS
)  # 2001; clocks that lost their time begin in 1970 to 2000
FEWEST_OF_BLOCK = 10  # of a block that is checked


class BlockMonitor:
    """Counts repeated, late and out-of-order blocks of a turbine and follows its clock.

    lateness   how long an out-of-order block is waited for [s]
    """

    def __init__(self, lateness: float) -> None:
        self._lateness = lateness
        self._counts: Counter[str] = Counter()
        self._still: dict[int, int] = {}  # blocks on end that a channel has kept its value
        self._begin(None)

    def _begin(self, session: str | None) -> None:
        self._session = session
        self._newest: AccelerationBlock | None = None
        self._rate = 1.0  # [Hz]
        self._seen: deque[int] = deque(maxlen=REMEMBERED_BLOCKS)
        # first sample and start [ns] of blocks
        self._stamps: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_STAMPS)
        # first sample of a block, its still channel
        self._dead: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_STAMPS)

    def restart(self) -> None:
        """The unit has started again: it counts from 0."""
        self._begin(self._session)

    def note(self, block: AccelerationBlock) -> None:
        """Take a block that its unit has sent."""
        if block.session != self._session:
            self._begin(block.session)
        if block.sequence in self._seen:
            self._counts["repeated"] += 1
            return
        self._seen.append(block.sequence)
        if self._newest is None or block.sequence > self._newest.sequence:
            self._newest = block
        else:
            behind = (self._newest.first_sample - block.first_sample) / block.sampling_rate
            self._counts["late" if behind > self._lateness else "out-of-order"] += 1
        self._rate = block.sampling_rate
        self._stamps.append((block.first_sample, block.start_ns))
        self._follow_still_channels(block)

    def _follow_still_channels(self, block: AccelerationBlock) -> None:
        if len(block.samples) < FEWEST_OF_BLOCK:
            return
        for channel, span in enumerate(np.ptp(block.samples, axis=0)):
            self._still[channel] = self._still.get(channel, 0) + 1 if span == 0 else 0
            if self._still[channel] >= STILL_BLOCKS:
                self._dead.append((block.first_sample, channel))

    def still_channel(self, first: int, end: int) -> tuple[int, float] | None:
        """A channel that kept one value in a part of a window, samples `first` to `end`: its index
        and when it was first seen so, from the window's start [s]. What came before the window is
        forgotten."""
        while self._dead and self._dead[0][0] < first:
            self._dead.popleft()
        if not self._dead or self._dead[0][0] >= end:
            return None
        first_dead, channel = self._dead[0]
        return channel, (first_dead - first) / self._rate

    def warnings_until(self, end: int) -> tuple[QualityWarning, ...]:
        """What went wrong since the last time this was asked, stamps up to sample `end`."""
        texts = {
            "repeated": "blocks came twice and were used once",
            "out-of-order": "blocks came after their successors and were put in order",
            "late": "blocks came too late to be waited for",
        }
        counted = [
            QualityWarning(code, f"{self._counts[code]} {text}")
            for code, text in texts.items()
            if self._counts[code]
        ]
        self._counts.clear()
        return (*counted, *self._clock_warnings(end))

    def _clock_warnings(self, end: int) -> list[QualityWarning]:
        stamps = [stamp for stamp in self._stamps if stamp[0] < end]
        kept = [stamp for stamp in self._stamps if stamp[0] >= end]
        self._stamps = deque(kept, maxlen=REMEMBERED_STAMPS)
        clock = fit_clock(stamps, self._rate)
        warnings = (
            [_unset_clock(stamps[-1][1])] if stamps and stamps[-1][1] < UNSET_BEFORE_NS else []
        )
        if clock is None:
            return warnings
        if clock.step:
            text = (
                f"the unit's time stamps step by {clock.step:+.3g} s against its sample count: its "
                "clock was set, or samples are missing"
            )
            warnings.append(QualityWarning("clock-step", text))
        if clock.exceeds(1e-6 * CLOCK_DRIFT):
            text = (
                f"the unit's time stamps run {1e6 * clock.drift:+.0f} ppm against its sampling "
                "rate; frequencies follow the time stamps"
            )
            warnings.append(QualityWarning("clock-drift", text))
        if clock.scatter > CLOCK_JITTER:
            text = (
                f"the unit's time stamps scatter by {1e3 * clock.scatter:.2g} ms; samples are "
                "taken as even"
            )
            warnings.append(QualityWarning("clock-jitter", text))
        return warnings


def _unset_clock(start_ns: int) -> QualityWarning:
    day = datetime.fromtimestamp(start_ns / NANOSECONDS, UTC)
    return QualityWarning(
        "clock-unset",
        f"the time stamps are of {day:%Y-%m-%d}: the unit's clock was never set, or the "
        "measurements are without a date; SCADA, tide and history go by it",
    )
