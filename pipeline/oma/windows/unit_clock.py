"""A unit's stamps against its own count of samples: steps, drift and scatter, and its warnings.

    stamp − sample number / sampling rate
        ────────────┐                       a step: the clock was set, or samples are missing
                    └───────────
        ／／／／／／／／／／／／                drift: the converter's rate is not the nominal one

Order, gaps and windows go by the count; the stamps are data that are checked here. A drift that is
no chance is resampled out. `BlockMonitor` files what the link and the clock did with the blocks
under sample numbers of the unit's boot.
"""

from collections import Counter, deque
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from pipeline.messages import QualityWarning
from sensors.acquisition.blocks import CLOCK_STEP, NANOSECONDS, AccelerationBlock
from sensors.acquisition.resampling import HALF_LENGTH, interpolated
from sensors.arrays import BoolArray, FloatArray

CLOCK_ERROR = 0.01  # of a converter's rate, at most [-]
CORRECTED_DRIFT = 10e-6  # of stamps, beyond which samples are read at their instants [-]
FEWEST_FOR_LINE = 20  # that a line is fitted to
OUTLYING_STAMP = 5.0  # median deviations beyond which a stamp does not count
LEAST_STAMP_SCATTER = 1e-6  # of stamps about the line [s]
LEAST_STEP = 0.02  # of the stamps that turns a window's line by more than 50 ppm [s]
CERTAIN_JUMP = 8.0  # median deviations of the jumps beyond which one is a step
COMPARED_STAMPS = 5  # before and after a step; fewer that are off are late stamps
MOST_STEPS_TAKEN_OUT = 5  # that are taken out of a line
AT_ONCE = 1000  # samples that are read by one product: what a kernel's length of each of them takes
MISSING_KEPT = 10_000  # numbers of blocks that have not come, the latest
CLOCK_DRIFT = 10.0  # [ppm]; a crystal that is disciplined by GPS or PTP keeps better than 1
CLOCK_JITTER = 1e-3  # std of the blocks' stamps about a straight line [s]
STILL_BLOCKS = 2  # blocks on end in which a channel that is alive never keeps one value
REMEMBERED_STAMPS = 100_000  # blocks: a day of them without an estimate that asks
UNSET_BEFORE_NS = (
    978_307_200 * NANOSECONDS
)  # 2001; clocks that lost their time begin in 1970 to 2000
FEWEST_OF_BLOCK = 10  # of a block that is checked


@dataclass(frozen=True, slots=True)
class ClockStep:
    """A jump of a unit's stamps against its sample count."""

    first_sample: int
    """First sample after the step, since the unit's start."""
    seconds: float
    """Size of the step, positive forward [s]."""


@dataclass(frozen=True, slots=True)
class ClockFit:
    """A robust line through stamps over the sample count."""

    drift: float
    """Rate of the stamps against the nominal count, minus one [-]; positive: stamps run fast."""
    drift_std: float
    """[-]"""
    scatter: float
    """Standard deviation of the stamps about the line [s]."""
    step: float = 0.0
    """Largest step that was taken out of the stamps, positive forward [s]; 0: none."""

    def exceeds(self, limit: float) -> bool:
        """Whether the drift is beyond a limit [-] and not by chance."""
        return abs(self.drift) > max(limit, 4 * self.drift_std)

    @property
    def true_rate(self) -> float:
        """True sampling rate over the nominal one [-]; 1 for a drift that may be chance."""
        return 1.0 / (1.0 + self.drift) if self.exceeds(CORRECTED_DRIFT) else 1.0


def clock_step(before: tuple[int, int], after: tuple[int, int], sampling_rate: float) -> float:
    """Step of the stamps between two blocks of one boot [s]; 0 where there is none.

    Parameters
    ----------
    before, after : tuple of int
        First sample since the unit's start, and its stamp [ns].
    sampling_rate : float
        Nominal [Hz].
    """
    counted = (after[0] - before[0]) / sampling_rate
    step = (after[1] - before[1]) / NANOSECONDS - counted
    return step if abs(step) > CLOCK_STEP + CLOCK_ERROR * abs(counted) else 0.0


def fit_clock(stamps: Sequence[tuple[int, int]], sampling_rate: float) -> ClockFit | None:
    """Fit a line through the stamps of blocks, steps taken out and outlying stamps left out.

    Parameters
    ----------
    stamps : sequence of (int, int)
        First sample since the unit's start, and its stamp [ns].
    sampling_rate : float
        Nominal [Hz].

    Returns
    -------
    ClockFit or None
        None for fewer than `FEWEST_FOR_LINE` stamps.
    """
    if len(stamps) < FEWEST_FOR_LINE:
        return None
    due = np.array([(number - stamps[0][0]) / sampling_rate for number, _ in stamps])
    off = np.array([(stamp - stamps[0][1]) / NANOSECONDS for _, stamp in stamps]) - due
    off, step = _without_steps(off)
    slope, offset = np.polyfit(due, off, 1)
    residual = off - slope * due - offset
    scale = max(1.4826 * float(np.median(abs(residual - np.median(residual)))), LEAST_STAMP_SCATTER)
    sound = abs(residual - np.median(residual)) <= OUTLYING_STAMP * scale
    if 2 < sound.sum() < len(sound):
        slope, offset = np.polyfit(due[sound], off[sound], 1)
    scatter = float(np.std(off - slope * due - offset))
    spread = float(np.sqrt(np.sum((due[sound] - due[sound].mean()) ** 2)))
    inlying = float(np.std((off - slope * due - offset)[sound]))
    return ClockFit(float(slope), inlying / spread if spread > 0 else np.inf, scatter, step)


def _without_steps(off: FloatArray) -> tuple[FloatArray, float]:
    """Return the offsets of stamps with their steps taken out, and the largest step [s].

    A clock that is set once is no drift: left in, a step of .1 s turns a window's line by 250 ppm.
    """
    moved, largest = off.copy(), 0.0
    for _ in range(MOST_STEPS_TAKEN_OUT):
        first, size = _largest_jump(moved)
        if not size:
            return moved, largest
        moved[first:] -= size
        largest = max(largest, size, key=abs)
    return off, 0.0  # so many are stamps in coarse units that follow a drift


def _largest_jump(off: FloatArray) -> tuple[int, float]:
    """Return the stamp after the largest jump and its size [s]; 0 where there is none for certain.

    Medians of a few stamps before and after are compared, so that late stamps are no jump.
    """
    level = np.median(sliding_window_view(off, COMPARED_STAMPS), axis=1)
    jump = level[COMPARED_STAMPS:] - level[:-COMPARED_STAMPS]
    jump = jump - np.median(jump)
    certain = CERTAIN_JUMP * 1.4826 * float(np.median(abs(jump)))
    place = int(np.argmax(abs(jump)))
    if abs(jump[place]) < max(LEAST_STEP, certain):
        return 0, 0.0
    # near the jump all medians show it; the stamps themselves show where it is
    near = np.arange(place + 1, place + 2 * COMPARED_STAMPS)
    first = int(near[np.argmax(np.diff(off)[near - 1] * np.sign(jump[place]))])
    return first, float(jump[min(max(first - COMPARED_STAMPS, 0), len(jump) - 1)])


def text_of_step(step: ClockStep, unit: str, window_start: int, sampling_rate: float) -> str:
    """For people: what a step of a unit's clock means for a window.

    Parameters
    ----------
    window_start : int
        First sample of the window, since the unit's start.
    """
    at = (step.first_sample - window_start) / sampling_rate
    return (
        f"the stamps of unit {unit} step by {step.seconds:+.3f} s against its sample count at "
        f"{at:.3f} s: its clock was set, or samples are missing"
    )


def stamp_of(block: AccelerationBlock) -> tuple[int, int]:
    """First sample since the unit's start, and its stamp [ns]."""
    return block.first_sample, block.start_ns


def at_nominal_rate(samples: FloatArray, ratio: float) -> FloatArray:
    """Samples of a converter that is off, as a true one takes them from the first one on.

    Parameters
    ----------
    samples : ndarray of shape (n, n_channels)
        NaN where missing.
    ratio : float
        True sampling rate over the nominal one [-].

    Returns
    -------
    ndarray of shape (m, n_channels)
        m = 1 + ⌊(n − 1) / ratio⌋, the same where the ratio is 1. What lies beside a missing sample
        is missing.

    Notes
    -----
    Sample i of a true converter is taken at position i · ratio. Missing samples are bridged by
    straight lines while others are read, so that a gap does not spread over the kernel's length.
    """
    if ratio == 1.0 or not len(samples):
        return samples
    positions = np.arange(1 + int((len(samples) - 1) / ratio)) * ratio
    missing = np.isnan(samples)
    before = np.floor(positions).astype(int)
    lost = missing[before] | missing[np.minimum(before + 1, len(samples) - 1)]
    whole = _bridged(samples, missing)
    read = np.concatenate(
        [
            interpolated(whole[first:], part - first)
            for part in np.array_split(positions, max(1, len(positions) // AT_ONCE))
            for first in [max(0, int(part[0]) - HALF_LENGTH)]
        ]
    )
    return np.where(lost, np.nan, read)


def _bridged(samples: FloatArray, missing: BoolArray) -> FloatArray:
    whole, numbers = samples.copy(), np.arange(len(samples))
    for channel, gone in zip(whole.T, missing.T, strict=True):
        if gone.any() and not gone.all():
            channel[gone] = np.interp(numbers[gone], numbers[~gone], channel[~gone])
    return whole


class BlockMonitor:
    """Counts repeated, late and out-of-order blocks of a turbine and follows its clock.

    Parameters
    ----------
    lateness : float
        How long an out-of-order block is waited for [s].
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
        self._first, self._highest = 0, -1  # numbers of blocks that have come
        self._missing: set[int] = set()  # between them
        # first sample and start [ns] of blocks
        self._stamps: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_STAMPS)
        # first sample of a block, its still channel
        self._dead: deque[tuple[int, int]] = deque(maxlen=REMEMBERED_STAMPS)

    def restart(self) -> None:
        """The unit has started again: it counts from 0."""
        self._begin(self._session)

    def resume(self, session: str, sequence: int) -> None:
        """Go on after a restart of this program, which had a session's blocks before a number."""
        self._begin(session)
        self._highest = sequence - 1

    def note(self, block: AccelerationBlock) -> None:
        """Take a block that its unit has sent."""
        if block.session != self._session:
            self._begin(block.session)
        if not self._is_new(block.sequence):
            self._counts["repeated"] += 1
            return
        if self._newest is None or block.sequence > self._newest.sequence:
            self._newest = block
        else:
            behind = (self._newest.first_sample - block.first_sample) / block.sampling_rate
            self._counts["late" if behind > self._lateness else "out-of-order"] += 1
        self._rate = block.sampling_rate
        self._stamps.append((block.first_sample, block.start_ns))
        self._follow_still_channels(block)

    def _is_new(self, sequence: int) -> bool:
        """Whether a block has not come before; its number has from now on."""
        if self._highest < self._first:  # the first of all
            self._first = self._highest = sequence
            return True
        if self._first <= sequence <= self._highest and sequence not in self._missing:
            return False
        if sequence > self._highest:
            self._missing.update(range(self._highest + 1, sequence)[-MISSING_KEPT:])
        elif sequence < self._first:
            self._missing.update(range(sequence + 1, self._first)[-MISSING_KEPT:])
        self._missing.discard(sequence)
        self._first = min(self._first, sequence)
        self._highest = max(self._highest, sequence)
        if len(self._missing) > MISSING_KEPT:  # the oldest count as come
            self._missing = set(sorted(self._missing)[-MISSING_KEPT:])
        return True

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
