"""An instrument's clock by the stamps of its samples: even, though the stamps are not.

stamps   | | |  ||  | | |        each up to half a sample early or late
clock    | | | | | | | |         follows their mean
"""

import math

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, RATE_TOLERANCE
from sensors.bounded_dict import BoundedDict
from sensors.files.table import rate_of_stamps

# Samples over which the clock follows the stamps: a drift of 100 ppm is followed within a tenth of
# a sample, jitter of half a sample moves it by a fiftieth. At first all stamps count alike.
FOLLOWED = 1000.0
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

    def position(self, time_ns: int) -> float:
        """Index of the sample that would be taken at a time, with its fraction."""
        return self._index + (time_ns - self._ns) * self._rate / NANOSECONDS

    def time_of(self, index: int) -> int:
        """[ns]"""
        return self._ns + round((index - self._index) * NANOSECONDS / self._rate)

    def follow(self, index: int, time_ns: int, n_samples: int) -> None:
        """Take note of the stamp of a sample, of which `n_samples` came with it."""
        self._followed += n_samples
        gain = max(1.0 - math.exp(-n_samples / FOLLOWED), n_samples / self._followed)
        expected = self.time_of(index)
        self._index, self._ns = index, expected + round(gain * (time_ns - expected))


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
