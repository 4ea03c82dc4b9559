"""An instrument's clock by the stamps of its samples: even, though the stamps are not.

stamps   | | |  ||  | | |        each up to half a sample early or late
clock    | | | | | | | |         follows their mean

A clock that is set, by less than what begins a session, stays off by the same: that is a step of
the blocks' stamps too, which windows take out. Followed as jitter is, it would be a ramp, and the
frequencies of the windows in it off by as much as the ramp is steep.
"""

import math
from statistics import median

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, RATE_TOLERANCE
from sensors.bounded_dict import BoundedDict
from sensors.files.table import rate_of_stamps

# Samples over which the clock follows the stamps: a drift of 100 ppm is followed within a tenth of
# a sample, jitter of half a sample moves it by a fiftieth. At first all stamps count alike.
FOLLOWED = 1000.0
STEP_FROM = 2.0  # of a stamp off the clock [samples] …
STEP_SCATTERS = 8.0  # … and in mean deviations of the stamps before it: less is jitter
STEP_AGREES = 1.0  # of the stamps after it with each other [samples] …
STEP_AGREES_SCATTERS = 4.0  # … or in mean deviations
STEP_MESSAGES = 3  # on end that show a step …
STEP_LASTS = 2.0  # … and this long [s]
SCATTER_FOLLOWED = 20  # messages
SET_ANEW = 10  # messages in a row that report another rate
STAMPS = 64  # single samples whose stamps give their rate


class UnitClock:
    """When each sample of a unit was taken: index 0 at the first stamp, then one a period.

    Parameters
    ----------
    start_ns : int
        Stamp of the sample with index 0 [ns].
    sampling_rate : float
        Nominal [Hz].
    """

    def __init__(self, start_ns: int, sampling_rate: float) -> None:
        self._index, self._ns = 0, start_ns  # a sample and its time
        self._rate = sampling_rate
        self._followed = 1  # samples so far
        self._scatter = 0.0  # mean deviation of the stamps from the clock [samples]
        self._messages = 0  # whose deviations are in it
        self._stepped: list[tuple[int, int]] = []  # deviations that may be a step [ns], samples

    def position(self, time_ns: int) -> float:
        """Index of the sample that would be taken at a time, with its fraction."""
        return self._index + (time_ns - self._ns) * self._rate / NANOSECONDS

    def time_of(self, index: int) -> int:
        """[ns]"""
        return self._ns + round((index - self._index) * NANOSECONDS / self._rate)

    def follow(self, index: int, time_ns: int, n_samples: int) -> None:
        """Take note of the stamp of a sample, of which `n_samples` came with it."""
        if self._may_be_step(time_ns - self.time_of(index)):
            self._stepped.append((time_ns - self.time_of(index), n_samples))
            self._take_step(index)
            return
        for deviation_ns, _ in self._stepped:  # it did not last
            self._note_scatter(deviation_ns)
        self._stepped = []
        self._note_scatter(time_ns - self.time_of(index))
        self._followed += n_samples
        gain = max(1.0 - math.exp(-n_samples / FOLLOWED), n_samples / self._followed)
        expected = self.time_of(index)
        self._index, self._ns = index, expected + round(gain * (time_ns - expected))

    def _may_be_step(self, deviation_ns: int) -> bool:
        """Whether a stamp is off by more than its scatter explains, and as those before it are."""
        if self._messages < SCATTER_FOLLOWED:
            return False
        if abs(self._samples(deviation_ns)) <= max(STEP_FROM, STEP_SCATTERS * self._scatter):
            return False
        apart = self._samples(deviation_ns - self._stepped[0][0]) if self._stepped else 0.0
        return abs(apart) <= max(STEP_AGREES, STEP_AGREES_SCATTERS * self._scatter)

    def _take_step(self, index: int) -> None:
        """Set the clock by what the stamps have stayed off by, once that has lasted."""
        duration = sum(n_samples for _, n_samples in self._stepped) / self._rate
        if len(self._stepped) < STEP_MESSAGES or duration < STEP_LASTS:
            return
        step_ns = round(median(deviation_ns for deviation_ns, _ in self._stepped))
        self._index, self._ns = index, self.time_of(index) + step_ns
        self._stepped = []

    def _note_scatter(self, deviation_ns: int) -> None:
        self._messages += 1
        gain = 1.0 / min(self._messages, SCATTER_FOLLOWED)
        self._scatter += gain * (abs(self._samples(deviation_ns)) - self._scatter)

    def _samples(self, time_ns: int) -> float:
        return time_ns * self._rate / NANOSECONDS


class RateMonitor:
    """Notices that an instrument's sampling rate was changed: so many messages in a row report
    the same other one. A single one that does is nonsense, or of another instrument."""

    def __init__(self) -> None:
        self._stated, self._count = 0.0, 0

    def has_changed(self, stated: float, rate: float) -> bool:
        """Take note of what a message reports [Hz], where the rate so far is `rate`."""
        if are_equal(stated, rate):
            self._count = 0
            return False
        self._count = self._count + 1 if are_equal(stated, self._stated) else 1
        self._stated = stated
        return self._count >= SET_ANEW


def are_equal(stated: float, rate: float) -> bool:
    """Whether two sampling rates are one, as instruments round them."""
    return abs(stated - rate) <= RATE_TOLERANCE * rate


class RateFinder:
    """The sampling rate of samples that come one by one with their stamps."""

    def __init__(self) -> None:
        self._stamps: BoundedDict[str, list[int]] = BoundedDict()  # by stream [ns]

    def rate(self, stream: str, time_ns: int) -> float | None:
        """Take note of a stamp; the rate [Hz] when one stream has shown enough of them."""
        stamps = self._stamps.renewed(stream)
        if stamps is None:
            stamps = []
            self._stamps.put(stream, stamps)
        stamps.append(time_ns)
        if len(stamps) < STAMPS:
            return None
        rising = np.unique(np.array(stamps))
        rate = rate_of_stamps((rising - rising[0]) / NANOSECONDS)
        if rate is None or len(rising) < STAMPS // 2:
            stamps.clear()  # a clock that stands
            return None
        return rate
