"""What the link and the unit's clock did with the blocks, by the blocks alone."""

from collections import Counter, deque

import numpy as np

from pipeline.messages import QualityWarning
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock

REMEMBERED = 600  # blocks by which a repeated one is recognised
CLOCK_DRIFT = 10.0  # [ppm]; a crystal that is disciplined by GPS or PTP keeps better than 1
CLOCK_JITTER = 1e-3  # std of the blocks' stamps about a straight line [s]
FEWEST_STAMPS = 20  # that a line is fitted to
STILL_BLOCKS = 2  # blocks on end in which a channel that is alive never keeps one value
REMEMBERED_STAMPS = 100_000  # blocks: a day of them without an estimate that asks
FEWEST_SAMPLES = 10  # of a block that can tell


class BlockMonitor:
    """Counts repeated, late and out-of-order blocks of a turbine and follows its clock.

    lateness   how long an out-of-order block is waited for [s]
    """

    def __init__(self, lateness: float) -> None:
        self._lateness = lateness
        self._session: str | None = None  # none yet
        self._seen: deque[int] = deque(maxlen=REMEMBERED)
        self._newest: AccelerationBlock | None = None
        self._counts: Counter[str] = Counter()
        self._stamps: deque[tuple[int, float, float]] = deque(
            maxlen=REMEMBERED_STAMPS
        )  # start [ns], due, off [s]
        self._origin: AccelerationBlock | None = None
        self._still: dict[int, int] = {}  # blocks on end that a channel has kept its value
        self._dead: deque[tuple[int, int]] = deque(
            maxlen=REMEMBERED_STAMPS
        )  # start of a block [ns], its still channel

    def note(self, block: AccelerationBlock) -> None:
        """Take a block as it arrives."""
        if block.session != self._session:
            self._session, self._newest, self._origin = block.session, None, block
            self._seen.clear()
            self._stamps.clear()
        if block.sequence in self._seen:
            self._counts["repeated"] += 1
            return
        self._seen.append(block.sequence)
        if self._newest is None or block.sequence > self._newest.sequence:
            self._newest = block
        else:
            behind = (self._newest.first_sample - block.first_sample) / block.sampling_rate
            self._counts["late" if behind > self._lateness else "out-of-order"] += 1
        self._stamp(block)
        self._follow_still_channels(block)

    def _follow_still_channels(self, block: AccelerationBlock) -> None:
        if len(block.samples) < FEWEST_SAMPLES:
            return
        for channel, span in enumerate(np.ptp(block.samples, axis=0)):
            self._still[channel] = self._still.get(channel, 0) + 1 if span == 0 else 0
            if self._still[channel] >= STILL_BLOCKS:
                self._dead.append((block.start_ns, channel))

    def still_channel(self, start_ns: int, end_ns: int) -> tuple[int, float] | None:
        """A channel that kept one value in a part of a window: its index and when it was first
        seen so, from the window's start [s]; what came before the window is forgotten."""
        while self._dead and self._dead[0][0] < start_ns:
            self._dead.popleft()
        if not self._dead or self._dead[0][0] >= end_ns:
            return None
        first_ns, channel = self._dead[0]
        return channel, (first_ns - start_ns) / NANOSECONDS

    def _stamp(self, block: AccelerationBlock) -> None:
        assert self._origin is not None
        due = (block.first_sample - self._origin.first_sample) / block.sampling_rate
        off = (block.start_ns - self._origin.start_ns) / NANOSECONDS - due
        self._stamps.append((block.start_ns, due, off))

    def warnings_until(self, end_ns: int) -> tuple[QualityWarning, ...]:
        """What went wrong since the last time this was asked, stamps up to a moment [ns]."""
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
        return (*counted, *self._clock_warnings(end_ns))

    def _clock_warnings(self, end_ns: int) -> list[QualityWarning]:
        stamps = []
        while self._stamps and self._stamps[0][0] < end_ns:
            stamps.append(self._stamps.popleft())
        if len(stamps) < FEWEST_STAMPS:
            return []
        due, off = np.array([stamp[1:] for stamp in stamps]).T
        slope, offset = np.polyfit(due - due[0], off, 1)
        scatter = float(np.std(off - slope * (due - due[0]) - offset))
        warnings = []
        if abs(slope) * 1e6 > CLOCK_DRIFT:
            text = (
                f"the unit's time stamps run {1e6 * slope:+.0f} ppm against its sampling rate; "
                "frequencies follow the sampling rate"
            )
            warnings.append(QualityWarning("clock-drift", text))
        if scatter > CLOCK_JITTER:
            text = (
                f"the unit's time stamps scatter by {1e3 * scatter:.2g} ms; samples are taken as "
                "even"
            )
            warnings.append(QualityWarning("clock-jitter", text))
        return warnings
