"""Stamps of local time without a zone, over the end and the begin of summer time.

    02:59:59.95, 02:00:00.00      an hour back, in autumn: the stamps behind it are an hour later
    01:59:59.95, 03:00:00.00      an hour ahead, in spring: no sample is missing

Only a Sunday night's hour, to a minute when it goes back and to two samples when it goes ahead,
is taken for it; any other step is what it seems. Times of day without a date go on over midnight.
"""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from sensors.acquisition.blocks import NANOSECONDS
from sensors.constants import DAY

HOUR = 3600 * NANOSECONDS  # [ns]
SLACK = 60 * NANOSECONDS  # that may be missing where the clock goes back [ns]
WHOLE_DAY = round(DAY) * NANOSECONDS  # [ns]
LATE = HOUR  # that may be missing around midnight [ns]
SUNDAY, THURSDAY = 6, 3  # days of a week from Monday; 1970-01-01 was a Thursday
CHANGING_MONTHS = (3, 4, 9, 10, 11)  # in either hemisphere
LATEST_HOUR = 4  # of the night in which clocks change [h]


@dataclass(slots=True)
class SummerTime:
    """Follows the stamps of one column, batch by batch."""

    changes_ns: list[int] = field(default_factory=list)
    """First stamp behind each change, as it is written [ns since 1970]."""

    _added: int = 0
    """To the stamps from the last change on [ns]."""

    _last: int | None = None
    _usual: float = 0.0
    """Step between two stamps [ns]."""

    def continuous(self, stamps: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return stamps on the clock of the column's first one.

        Parameters
        ----------
        stamps : ndarray, shape (n,)
            As written, n > 0 [ns since 1970].
        """
        before = stamps[0] - self._usual if self._last is None else self._last
        steps = np.diff(stamps, prepend=np.int64(before))
        rising = steps[steps > 0]
        if len(rising):
            self._usual = float(np.median(rising))
        back = np.abs(steps + HOUR) <= SLACK
        ahead = np.abs(steps - HOUR - self._usual) <= 2 * min(self._usual, NANOSECONDS)
        change = (back | ahead) & _is_changing_night(stamps)
        self.changes_ns += stamps[change].tolist()
        added = self._added + np.cumsum(np.where(change, np.where(back, HOUR, -HOUR), 0))
        self._last, self._added = int(stamps[-1]), int(added[-1])
        return np.asarray(stamps + added, dtype=np.int64)


@dataclass(slots=True)
class Midnights:
    """Follows times of day without a date over midnight, batch by batch."""

    _added: int = 0
    """To the times from the last midnight on [ns]."""
    _last: int | None = None

    def continuous(self, times: NDArray[np.int64]) -> NDArray[np.int64]:
        """Return times since the first day's midnight.

        Parameters
        ----------
        times : ndarray, shape (n,)
            Since midnight, n > 0 [ns].
        """
        steps = np.diff(times, prepend=times[0] if self._last is None else np.int64(self._last))
        added = self._added + WHOLE_DAY * np.cumsum(steps + WHOLE_DAY <= LATE)
        self._last, self._added = int(times[-1]), int(added[-1])
        return np.asarray(times + added, dtype=np.int64)


def _is_changing_night(stamps: NDArray[np.int64]) -> NDArray[np.bool_]:
    seconds = stamps // NANOSECONDS
    day = seconds // int(DAY)
    month = stamps.astype("datetime64[ns]").astype("datetime64[M]").astype(np.int64) % 12 + 1
    sunday = (day + THURSDAY) % 7 == SUNDAY
    hour = seconds % int(DAY) // 3600
    return np.asarray(sunday & (hour <= LATEST_HOUR) & np.isin(month, CHANGING_MONTHS))
