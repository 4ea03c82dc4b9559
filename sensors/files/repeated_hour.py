"""Which of the two a file is of, where an hour of local time comes twice as summer time ends.

    02:30 CEST ─ 02:40 ─ 02:50 ─┐ 02:00 CET ─ 02:10 ─ 02:20
    file 0       1       2      │ 3           4       5        the reading without a break
    ────────────────────────────┘
    02:00 ─ 02:10 ─ 02:20     02:30 ─ 02:40 ─ 02:50            all of the first hour
    3       4       5         0       1       2

A file that runs over the change, or past the hour, shows it by itself. Of the others those
readings are possible in which no two files overlap. If the files are given in an order that is not
that of their stamps, the readings in this order count. Of what is left, the one is taken in which
the files continue one another most; where that leaves a choice, a warning is logged.
"""

import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, pairwise, product

import numpy as np

from sensors.acquisition.blocks import NANOSECONDS
from sensors.files.block_builder import MeasurementFile, moment, open_file
from sensors.files.text.dates import offset_name, repeated_after_ns

logger = logging.getLogger(__name__)

MOST_RUNS = 12  # of files that continue one another: each doubles the number of readings
LONGEST_BREAK = 60 * NANOSECONDS  # and a step of rows, between files that go on one another [ns]
UNKNOWN = "nothing shows which of the two it is"
TWINS = "files of the same local times are taken in the order in which they are given"
CONTINUOUS = "only that files then continue one another shows which of the two it is"
Reading = tuple[bool, ...]  # of each open file, whether it is of the second hour


@dataclass(frozen=True, slots=True, order=True)
class SampledSpan:
    """Where a file lies."""

    begin_ns: int
    """First sample [ns since 1970-01-01 UTC]."""

    end_ns: int
    """Last sample [ns since 1970-01-01 UTC]."""

    step_ns: int = 0
    """Usual step from one sample to the next [ns]."""

    def is_continued_at(self, begin_ns: int) -> bool:
        """Return whether a file that begins at a moment goes on where this one ends."""
        return 0 < begin_ns - self.end_ns <= self.step_ns + LONGEST_BREAK


@dataclass(frozen=True, slots=True)
class _OpenFile:
    """A file whose local time leaves open which of the two hours it begins in."""

    place: int
    """Among the files as they were given."""

    first: MeasurementFile
    """Read as of the first hour."""

    second: MeasurementFile
    span: SampledSpan
    """Where it lies: of the second hour if its own stamps show this, else of the first."""

    later_ns: int
    """How much later the second hour is [ns]."""

    is_second: bool | None
    """What its own stamps show; None: nothing."""

    def interval(self, *, second: bool) -> SampledSpan:
        shift = self.later_ns if second and not self.is_second else 0
        return SampledSpan(self.span.begin_ns + shift, self.span.end_ns + shift, self.span.step_ns)


def settle_repeated_hour(
    files: Sequence[MeasurementFile], sampling_rate: float | None = None
) -> list[MeasurementFile]:
    """Return the files with those of local time that comes twice in the hour that fits the others.

    Parameters
    ----------
    files : sequence of MeasurementFile
        In the order in which they were given: it decides between two files of the same local time.
    sampling_rate : float, optional
        Of files without stamps that state none [Hz].

    Raises
    ------
    FileError
        If a file cannot be read.
    """
    settled = list(files)
    found = [_opened(place, file, sampling_rate) for place, file in enumerate(files)]
    ambiguous = [each for each in found if each is not None]
    for each in ambiguous:
        if each.is_second:
            settled[each.place] = each.second
    unsure = [each for each in ambiguous if each.is_second is None]
    if not unsure:
        return settled
    neighbours = [
        *(each.interval(second=each.is_second) for each in ambiguous if each.is_second is not None),
        *_neighbours(
            [file for file, own in zip(files, found, strict=True) if own is None],
            min(each.first.start_ns for each in unsure),
            sampling_rate,
        ),
    ]
    reading, open_because = _best_reading(unsure, neighbours)
    for each, is_second in zip(unsure, reading, strict=True):
        if is_second:
            settled[each.place] = each.second
    if open_because:
        _warn(unsure, reading, open_because)
    return settled


def _opened(place: int, file: MeasurementFile, sampling_rate: float | None) -> _OpenFile | None:
    """Return both readings of a file; None where its start is not open."""
    time = file.wanted.time
    later_ns = repeated_after_ns(file.start_ns, time.zone) if file.start_ns and time.zone else 0
    if not later_ns or time.second_hour:
        return None
    wanted = replace(file.wanted, time=replace(time, second_hour=True))
    second, _ = open_file(file.path, file.reader, wanted)
    if second.start_ns != file.start_ns + later_ns:  # the file itself states its zone
        return None
    span, stamped, went_back = _span(file, sampling_rate)
    # without a step back the local clock has shown the end of the hour only if it was the second
    is_past = stamped and not repeated_after_ns(span.end_ns, time.zone)
    own = False if went_back else (True if is_past else None)
    if own:
        span, _, _ = _span(second, sampling_rate)
    return _OpenFile(place, file, second, span, later_ns, own)


def _span(file: MeasurementFile, sampling_rate: float | None) -> tuple[SampledSpan, bool, bool]:
    """Return where a file lies, whether its end has a stamp, and whether the clock went back."""
    rate = file.sampling_rate or sampling_rate
    end_ns, stamped, went_back, count = file.start_ns, False, False, 0
    step = 1 / rate if rate else 0.0  # [s]
    for chunk in file.chunks():
        count += len(chunk.samples)
        went_back = chunk.went_back
        if chunk.times is not None:
            stamped = True
            end_ns = chunk.start_ns + round(float(chunk.times[-1]) * NANOSECONDS)
            if len(chunk.times) > 1:
                step = max(0.0, float(np.median(np.diff(chunk.times))))
        elif rate:
            end_ns = chunk.start_ns + round((count - 1) / rate * NANOSECONDS)
    return SampledSpan(file.start_ns, end_ns, round(step * NANOSECONDS)), stamped, went_back


def _neighbours(
    known: Sequence[MeasurementFile], begin_ns: int, sampling_rate: float | None
) -> list[SampledSpan]:
    """Return where the last file before a moment lies, and where the first behind it begins."""
    dated = sorted((file for file in known if file.start_ns), key=lambda file: file.start_ns)
    before = [file for file in dated if file.start_ns < begin_ns][-1:]
    behind = [file for file in dated if file.start_ns >= begin_ns][:1]
    return [
        *(_span(file, sampling_rate)[0] for file in before),
        *(SampledSpan(file.start_ns, file.start_ns) for file in behind),
    ]


def _best_reading(
    unsure: Sequence[_OpenFile], neighbours: Sequence[SampledSpan]
) -> tuple[Reading, str]:
    """Return which files are of the second hour, and what leaves this open; "": nothing."""
    earliest = (False,) * len(unsure)
    runs = _runs(unsure)
    if len(runs) > MOST_RUNS:
        return earliest, UNKNOWN
    breaks: dict[Reading, int] = {}
    for choice in product((False, True), repeat=len(runs)):
        of_place = {each.place: is_second for run, is_second in zip(runs, choice, strict=True)
                    for each in run}  # fmt: skip
        reading = _twins_in_given_order(unsure, tuple(of_place[each.place] for each in unsure))
        count = _breaks([*neighbours, *_intervals(unsure, reading)])
        if count is not None:
            breaks[reading] = count
    if not breaks:
        return earliest, ""  # files that overlap in any case are an error where they are joined
    stated = _in_given_order(unsure, breaks)
    fitting = stated or list(breaks)
    fewest = min(breaks[reading] for reading in fitting)
    best = [reading for reading in fitting if breaks[reading] == fewest]
    reading = min(best, key=sum)
    if len(best) > 1:
        return reading, UNKNOWN
    if not stated and _has_twins(unsure, reading):
        return reading, TWINS
    of_both = any(reading) and not all(reading)
    return reading, CONTINUOUS if of_both and not stated and len(breaks) > 1 else ""


def _runs(unsure: Sequence[_OpenFile]) -> list[list[_OpenFile]]:
    """Return the files in runs that continue one another by their stamps, in the given order."""
    runs: list[list[_OpenFile]] = []
    for each in sorted(unsure, key=_stamp):
        run = next((run for run in runs if _continues(run[-1], each)), None)
        if run is None:
            runs.append([each])
        else:
            run.append(each)
    return runs


def _continues(before: _OpenFile, each: _OpenFile) -> bool:
    return before.span.is_continued_at(each.first.start_ns) and before.place < each.place


def _stamp(each: _OpenFile) -> int:
    return each.first.start_ns


def _intervals(unsure: Sequence[_OpenFile], reading: Reading) -> list[SampledSpan]:
    return [
        each.interval(second=is_second) for each, is_second in zip(unsure, reading, strict=True)
    ]


def _breaks(intervals: Sequence[SampledSpan]) -> int | None:
    """Return how often files do not continue one another; None where two overlap."""
    pairs = list(pairwise(sorted(intervals)))
    if any(later.begin_ns <= earlier.end_ns for earlier, later in pairs):
        return None
    return sum(not earlier.is_continued_at(later.begin_ns) for earlier, later in pairs)


def _twins(unsure: Sequence[_OpenFile]) -> list[tuple[int, int]]:
    """Return the pairs of files of the same local times, the first given first."""
    return [
        (i, j)
        for i, j in combinations(range(len(unsure)), 2)
        if abs(_stamp(unsure[i]) - _stamp(unsure[j])) <= LONGEST_BREAK
    ]


def _twins_in_given_order(unsure: Sequence[_OpenFile], reading: Reading) -> Reading:
    """Put the first given of two files of the same local times first."""
    ordered = list(reading)
    for i, j in _twins(unsure):
        ordered[i], ordered[j] = sorted((ordered[i], ordered[j]))
    return tuple(ordered)


def _has_twins(unsure: Sequence[_OpenFile], reading: Reading) -> bool:
    return any(reading[i] != reading[j] for i, j in _twins(unsure))


def _in_given_order(unsure: Sequence[_OpenFile], readings: Iterable[Reading]) -> list[Reading]:
    """Return the readings that have the files in the given order.

    None where that is the order of their stamps: a list sorted by name shows nothing.
    """
    if all(_stamp(a) <= _stamp(b) for a, b in pairwise(unsure)):
        return []
    return [
        reading
        for reading in readings
        if all(a < b for a, b in pairwise(_intervals(unsure, reading)))
    ]


def _warn(unsure: Sequence[_OpenFile], reading: Reading, open_because: str) -> None:
    """Log what leaves open which of the two hours files are of, how they are read, the way out."""
    first_ns, later_ns = unsure[0].first.start_ns, unsure[0].later_ns
    zone = unsure[0].first.wanted.time.zone
    order = sorted(zip(_intervals(unsure, reading), reading, range(len(unsure)), strict=True))
    names = [unsure[place].first.path for _, _, place in order]
    behind = next((unsure[place].first.path for _, second, place in order if second), None)
    logger.warning(
        "%s%s in an hour that comes twice in %s, as summer time ends; %s. Read as from %s UTC%s; "
        "--zone %s takes all times as those before the clock went back, --zone %s as those after",
        names[0],
        f" and {_more_files(len(names) - 1)} begin" if len(names) > 1 else " begins",
        zone,
        open_because,
        moment(order[0][0].begin_ns)[:19],
        f", from {behind} on as of the second hour" if behind else "",
        offset_name(first_ns, zone),
        offset_name(first_ns + later_ns, zone),
    )


def _more_files(number: int) -> str:
    return f"{number} more file{'s' * (number != 1)}"
