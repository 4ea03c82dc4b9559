"""A sampling rate that is stated beside a file, and the time stamps in it.

Stamps that increase throughout are followed, whatever rate is stated beside them. Of others, and
of a file without any, the samples are counted at the stated rate.
"""

from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS, RATE_TOLERANCE
from sensors.arrays import IntArray
from sensors.files.table import ChannelTable

LONG = 3.0  # a step that is so many times the usual one may be a gap [-]
STEPS_JUDGED = 10_000  # first steps that say what is usual


@dataclass(frozen=True, slots=True)
class StampedTime:
    """How the time stamps of one file run."""

    increase: bool
    """Whether every stamp is later than the one before."""

    pace: float | None
    """Samples per second from the first stamp to the last, gaps left out [Hz]; None where no time
    passes."""

    pace_tolerance: float
    """Relative uncertainty of the pace: what one step is of the whole time."""

    gap: float = 0.0
    """Time that the stamps leap over, in all gaps together [s]."""

    gap_begin: float = 0.0
    """When the first gap begins, since the first stamp [s]."""


def stamped_time(chunks: Iterable[ChannelTable]) -> StampedTime | None:
    """Return how the stamps of one file's chunks run; None where a chunk has none."""
    increase, first_ns, last_ns, steps = True, 0, 0, _Steps()
    for chunk in chunks:
        if chunk.times is None:
            return None
        if not len(chunk.times):
            continue
        times_ns = chunk.start_ns + np.round(chunk.times * NANOSECONDS).astype(np.int64)
        first_ns = first_ns if steps.count else int(times_ns[0])
        before = [last_ns] if steps.count else []
        increase = increase and bool((np.diff(times_ns, prepend=before) > 0).all())
        last_ns = int(times_ns[-1])
        steps.add(times_ns)
    if not steps.count:
        return None
    span_ns = last_ns - first_ns
    if span_ns <= 0:
        return StampedTime(False, None, 0.0)
    gaps = steps.gaps()
    gap_ns = sum(missing_ns for _, missing_ns in gaps)
    pace = (steps.count - 1) * NANOSECONDS / (span_ns - gap_ns)
    tolerance = RATE_TOLERANCE + steps.longest_but(gaps) / span_ns
    begin = (gaps[0][0] - first_ns) / NANOSECONDS if gaps else 0.0
    return StampedTime(increase, pace, tolerance, gap_ns / NANOSECONDS, begin)


class _Steps:
    """Steps from each stamp that is later than all before to the next such one."""

    def __init__(self) -> None:
        self.count = 0  # samples
        self._latest_ns = self._since = 0  # the latest stamp, and the first sample that has it
        self._judged = np.empty(0, dtype=np.int64)  # the first steps [ns]
        self._longest_ns = 0  # of ordinary steps
        self._ordinary = np.zeros(2)  # sum of ordinary steps [ns] and of their samples
        self._long: list[tuple[int, int, int]] = []  # begin [ns], step [ns], samples

    def add(self, times_ns: IntArray) -> None:
        """Take the next stamps, (n,) [ns]."""
        if not self.count:
            self._latest_ns = int(times_ns[0])
        latest = np.maximum.accumulate(np.append(self._latest_ns, times_ns))
        rises = np.flatnonzero(np.diff(latest))
        steps_ns, begins_ns = np.diff(latest)[rises], latest[rises]
        samples = np.diff(self.count + rises, prepend=self._since)
        self.count += len(times_ns)
        if not len(rises):
            return
        self._latest_ns, self._since = int(latest[-1]), self._since + int(samples.sum())
        if len(self._judged) < STEPS_JUDGED:
            self._judged = np.append(self._judged, steps_ns[:STEPS_JUDGED])
        is_long = steps_ns > LONG * np.median(self._judged)
        self._ordinary += [steps_ns[~is_long].sum(), samples[~is_long].sum()]
        self._longest_ns = max(self._longest_ns, *steps_ns[~is_long].tolist(), 0)
        of_long = (each[is_long].tolist() for each in (begins_ns, steps_ns, samples))
        self._long += zip(*of_long, strict=True)

    def gaps(self) -> list[tuple[int, int]]:
        """Return where each gap begins and what is missing in it [ns].

        A long step over as many samples as take that long is none: stamps of packets stand still
        for a packet.
        """
        time_ns, samples = self._ordinary
        if not samples:
            return []
        missing = [
            (begin, step, step - round(n * time_ns / samples)) for begin, step, n in self._long
        ]
        return [(begin, lost) for begin, step, lost in missing if lost > step / 2]

    def longest_but(self, gaps: list[tuple[int, int]]) -> int:
        """Return the longest step that is no gap [ns]."""
        begins = {begin for begin, _ in gaps}
        others = [step for begin, step, _ in self._long if begin not in begins]
        return max(self._longest_ns, *others, 0)


def rate_note(
    own: float | None, stamps: StampedTime | None, stated: float, what: str = "the file"
) -> str:
    """Return how a stated rate differs from the file's own, and which one is used; "" if alike.

    Parameters
    ----------
    own : float or None
        Sampling rate of the file, by its own words or stamps [Hz].
    stamps : StampedTime or None
        How its stamps run; None: it has none.
    stated : float
        Sampling rate that was stated beside it [Hz].
    what : str
        What to call the file.
    """
    if stamps is None:
        if own is None or abs(own / stated - 1) <= RATE_TOLERANCE:
            return ""
        return f"{what} states {own:.6g} Hz; the samples are counted at the {stated:.6g} Hz given"
    if stamps.increase:
        if own is None or abs(own / stated - 1) <= RATE_TOLERANCE:
            return ""
        return (
            f"{what} runs at {own:.6g} Hz by its own time, not at the {stated:.6g} Hz given; "
            "its own time is followed"
        )
    differs = stamps.pace is not None and abs(stamps.pace / stated - 1) > stamps.pace_tolerance
    found = []
    if differs:
        found.append(f"have {stamps.pace:.4g} samples a second on the whole")
    if stamps.gap:
        found.append(
            f"leap over {stamps.gap:.6g} s (first {stamps.gap_begin:.6g} s after they begin)"
        )
    if not found:
        return ""
    early = ", and what follows a gap is that much too early" if stamps.gap else ""
    return (
        f"the time stamps stand still or go back, and {' and '.join(found)}; the samples are "
        f"counted at the {stated:.6g} Hz given{early}"
    )


def with_stated_rate(
    table: ChannelTable, stated: float, what: str = "the file"
) -> tuple[ChannelTable, float, str]:
    """Return a whole file's table, the rate that counts, and `rate_note`.

    Stamps that do not increase are left out of the table.

    Parameters
    ----------
    stated : float
        Sampling rate that was stated beside the file [Hz].
    what : str
        What the note calls the file.
    """
    stamps, own = stamped_time([table]), table.sampling_rate
    note = rate_note(own, stamps, stated, what)
    if stamps is not None and stamps.increase and own is not None:
        return table, own, note
    return replace(table, times=None), stated, note
