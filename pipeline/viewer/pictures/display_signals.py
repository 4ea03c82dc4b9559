"""Accelerations at display rate: low-passed, decimated, on a coarse step."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.signal import firwin

from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.arrays import FloatArray

DISPLAY_RATE = 20.0  # [Hz]; a day of eight channels then takes about 80 MB in a .rrd
STEPS_IN_SPREAD = 128  # steps at least in the middle half of a chunk's samples: finer than a screen
SAME_CLOCK = NANOSECONDS // 1000  # between the ends of two blocks that are read as one [ns]
_TAPS_PER_SAMPLE = 8  # length of the low-pass filter in display samples


@dataclass(frozen=True, slots=True, eq=False)
class DisplaySignal:
    """Consecutive display samples of all channels of a unit.

    A row of NaN marks missing samples, so that no line is drawn across a gap.
    """

    times_ns: NDArray[np.int64]
    """Sensor clock, shape (n,) [ns since 1970-01-01 UTC]."""
    samples: FloatArray
    """Display samples, shape (n, n_channels) [unit of the channels]."""


def join_runs(blocks: Sequence[AccelerationBlock]) -> Iterator[AccelerationBlock]:
    """Join consecutive blocks of one unit into fewer, longer ones.

    A block whose clock differs by more than SAME_CLOCK starts a new one, which bounds the error of
    each sample's time. Why: a block of a second costs the decimator as much as one of a minute.
    """
    run: list[AccelerationBlock] = []
    for block in blocks:
        if run and not _follows(block, run):
            yield _join_blocks(run)
            run = []
        run.append(block)
    if run:
        yield _join_blocks(run)


def _follows(block: AccelerationBlock, run: Sequence[AccelerationBlock]) -> bool:
    first = run[0]
    n_samples = block.first_sample - first.first_sample
    expected_ns = first.start_ns + round(n_samples * NANOSECONDS / first.sampling_rate)
    return (
        block.session == first.session
        and block.layout_id == first.layout_id
        and block.first_sample == run[-1].first_sample + len(run[-1].samples)
        and block.sampling_rate == first.sampling_rate
        and block.samples.shape[1] == first.samples.shape[1]
        and abs(block.start_ns - expected_ns) <= SAME_CLOCK
    )


def _join_blocks(run: Sequence[AccelerationBlock]) -> AccelerationBlock:
    return replace(run[0], samples=np.concatenate([block.samples for block in run]))


class DisplayDecimator:
    """Anti-aliased decimation of consecutive blocks, each sample at its own time.

    A linear-phase low-pass of 8 display samples' length, read at every `factor`-th sample; its
    delay is taken out of the times. A gap, a restart, another rate or number of channels resets it,
    which costs the first and the last 0.2 s of each stretch. For display only: identification does
    not use it.
    """

    def __init__(self, sampling_rate: float) -> None:
        self._set_rate(sampling_rate)
        self._tail: NDArray[np.float32] | None = None  # samples that the next block still needs
        self._skip = 0  # samples at the tail's front before the next filter position
        self._expected = ("", -1)  # session and first_sample that would follow without a gap
        self._end_ns = 0

    def push(self, block: AccelerationBlock) -> DisplaySignal:
        """Return the display samples that this block completes."""
        broken = self._tail is not None and (
            self._expected != (block.session, block.first_sample)
            or self._rate != block.sampling_rate
            or self._tail.shape[1] != block.samples.shape[1]
        )
        if self._rate != block.sampling_rate:
            self._set_rate(block.sampling_rate)
        if broken or self._tail is None:
            self._tail = np.empty((0, block.samples.shape[1]), np.float32)
            self._skip = 0
        signal = self._decimate(block, self._tail)
        if broken:
            signal = _after_gap(self._end_ns, signal)
        self._expected = (block.session, block.first_sample + len(block.samples))
        self._end_ns = block.end_ns
        return signal

    def _set_rate(self, sampling_rate: float) -> None:
        self._rate = sampling_rate
        self._factor = max(1, int(sampling_rate / DISPLAY_RATE + 1e-9))
        self._taps = low_pass(self._factor)

    def _decimate(self, block: AccelerationBlock, tail: NDArray[np.float32]) -> DisplaySignal:
        joined = np.concatenate([tail, block.samples])
        starts = np.arange(self._skip, len(joined) - len(self._taps) + 1, self._factor)
        samples = self._filter(joined)
        centres = starts + len(self._taps) // 2 - len(tail)  # sample 0 is the block's first
        offsets = np.round(centres * (NANOSECONDS / block.sampling_rate)).astype(np.int64)
        self._keep(joined, first_needed=self._skip + len(starts) * self._factor)
        return DisplaySignal(block.start_ns + offsets, _on_step(samples))

    def _filter(self, samples: NDArray[np.float32]) -> FloatArray:
        """Filter at every `factor`-th position, in the samples' own precision."""
        if len(samples) < self._skip + len(self._taps):
            return np.empty((0, samples.shape[1]))
        windows = sliding_window_view(samples[self._skip :], len(self._taps), axis=0)
        return np.asarray(windows[:: self._factor] @ self._taps.astype(np.float32), dtype=float)

    def _keep(self, joined: NDArray[np.float32], *, first_needed: int) -> None:
        kept = min(first_needed, len(joined))
        self._tail = joined[kept:]
        self._skip = first_needed - kept


def low_pass(factor: int) -> FloatArray:
    """Return the taps of a linear-phase low-pass (sum 1) for decimation by `factor`.

    Hamming-windowed sinc, 6 dB down at 0.8 of the new Nyquist frequency; one tap for factor 1.
    """
    if factor == 1:
        return np.ones(1)
    return firwin(_TAPS_PER_SAMPLE * factor + 1, 0.8 / factor)


def _on_step(samples: FloatArray) -> FloatArray:
    """Round each channel to a power of two well below its spread: its zero bits compress.

    Why not one step: the unit may be any, and a sensor's noise may change a hundredfold. A spike
    moves no quartile; a channel that hardly ever changes is left as it is.
    """
    if not len(samples):
        return samples
    ordered = np.sort(samples, axis=0)  # NaN last
    with np.errstate(invalid="ignore"):
        spread = ordered[3 * len(samples) // 4] - ordered[len(samples) // 4]
    known = np.isfinite(spread) & (spread > 0)
    step = 2.0 ** np.floor(np.log2(np.where(known, spread, 1.0) / STEPS_IN_SPREAD))
    return np.where(known, np.round(samples / step) * step, samples)


def _after_gap(gap_start_ns: int, signal: DisplaySignal) -> DisplaySignal:
    missing = np.full((1, signal.samples.shape[1]), np.nan)
    return DisplaySignal(
        np.concatenate([[gap_start_ns], signal.times_ns]),
        np.concatenate([missing, signal.samples]),
    )
