"""A sampling rate that is stated beside a file, and the time stamps in it.

Stamps that increase throughout are followed, whatever rate is stated beside them. Of others, and
of a file without any, the samples are counted at the stated rate.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, RATE_TOLERANCE
from sensors.files.table import ChannelTable


@dataclass(frozen=True, slots=True)
class StampedTime:
    """How the time stamps of one file run."""

    increase: bool
    """Whether every stamp is later than the one before."""

    pace: float | None
    """Samples per second from the first stamp to the last [Hz]; None where no time passes."""

    pace_tolerance: float
    """Relative uncertainty of the pace: what one step is of the whole time."""


def stamped_time(chunks: Iterable[ChannelTable]) -> StampedTime | None:
    """Return how the stamps of one file's chunks run; None where a chunk has none."""
    increase, count, first_ns, last_ns, longest = True, 0, 0, 0, 0
    for chunk in chunks:
        if chunk.times is None:
            return None
        if not len(chunk.times):
            continue
        times_ns = chunk.start_ns + np.round(chunk.times * NANOSECONDS).astype(np.int64)
        first_ns = first_ns if count else int(times_ns[0])
        steps = np.diff(times_ns, prepend=[last_ns] if count else [])
        if len(steps):
            increase = increase and bool((steps > 0).all())
            longest = max(longest, int(steps.max()))
        last_ns, count = int(times_ns[-1]), count + len(times_ns)
    if not count:
        return None
    span_ns = last_ns - first_ns
    if span_ns <= 0:
        return StampedTime(False, None, 0.0)
    pace = (count - 1) * NANOSECONDS / span_ns
    return StampedTime(increase, pace, RATE_TOLERANCE + longest / span_ns)


def rate_note(own: float | None, stamps: StampedTime | None, stated: float) -> str:
    """Return how a stated rate differs from the file's own, and which one is used; "" if alike.

    Parameters
    ----------
    own : float or None
        Sampling rate of the file, by its own words or stamps [Hz].
    stamps : StampedTime or None
        How its stamps run; None: it has none.
    stated : float
        Sampling rate that was stated beside it [Hz].
    """
    if stamps is None:
        if own is None or abs(own / stated - 1) <= RATE_TOLERANCE:
            return ""
        return f"the file states {own:.6g} Hz; the samples are counted at the {stated:.6g} Hz given"
    if stamps.increase:
        if own is None or abs(own / stated - 1) <= RATE_TOLERANCE:
            return ""
        return (
            f"the file runs at {own:.6g} Hz by its own time, not at the {stated:.6g} Hz given; "
            "its own time is followed"
        )
    if stamps.pace is None or abs(stamps.pace / stated - 1) <= stamps.pace_tolerance:
        return ""
    return (
        f"the time stamps stand still or go back, and have {stamps.pace:.4g} samples a second on "
        f"the whole; the samples are counted at the {stated:.6g} Hz given"
    )


def with_stated_rate(table: ChannelTable, stated: float) -> tuple[ChannelTable, float, str]:
    """Return a whole file's table, the rate that counts, and `rate_note`.

    Stamps that do not increase are left out of the table.

    Parameters
    ----------
    stated : float
        Sampling rate that was stated beside the file [Hz].
    """
    stamps, own = stamped_time([table]), table.sampling_rate
    note = rate_note(own, stamps, stated)
    if stamps is not None and stamps.increase and own is not None:
        return table, own, note
    return replace(table, times=None), stated, note
