"""In which order stretches of recordings were measured, whatever a unit's clock says.

boot    | 0 … 1000 | 1000 … 2000 | 2000 … 3000 |     by the count of samples
stamps      2036        2026          2026           set after the first stretch: it moves to 2026
next boot follows the one before it in one recorder's parts, whatever both stamps are
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from pipeline.oma.windows.unit_clock import CLOCK_ERROR
from pipeline.recording.info import UnitInfo
from sensors.acquisition.blocks import CLOCK_STEP, NANOSECONDS, time_apart

SHORTEST_SHARED = 1.0  # below it clocks of two sessions do not agree [s]

_PART = re.compile(r"\.part(\d+)$")  # as `rotation.part_of` names the parts of one recording


@dataclass(frozen=True, slots=True)
class Stretch:
    """Samples of one session of one unit within one file."""

    path: Path
    unit: tuple[str, str]
    """Turbine and unit."""
    session: str
    sampling_rate: float
    """[Hz]"""
    first_sample: int
    """Since the session's start."""
    next_sample: int
    """One after the last."""
    start_ns: int
    """Stamp of the first sample [ns since 1970-01-01 UTC]."""


def stretch_of(path: Path, unit: UnitInfo) -> Stretch:
    """Return what a file holds of a unit's session."""
    return Stretch(
        path,
        (unit.turbine, unit.unit),
        unit.session,
        unit.sampling_rate,
        unit.first_sample,
        unit.next_sample,
        unit.start_ns,
    )


def logical_starts(stretches: Sequence[Stretch]) -> list[int]:
    """When each stretch began [ns], steps of its unit's clock taken out.

    Parameters
    ----------
    stretches : sequence of Stretch
        Of one file in the order of recording; files in any order.

    Returns
    -------
    list of int
        In order of the stretches: the stamp where clocks are right.
    """
    starts = [each.start_ns for each in stretches]
    boots = _boots(stretches)
    for boot in boots:
        for before, after in reversed(list(pairwise(boot))):
            starts[before] = starts[after] - _since(stretches[before], stretches[after])
    for in_parts in _recorded_in_parts(stretches, boots):
        for earlier, later in pairwise(in_parts):
            behind = max(0, starts[earlier[0]] + 1 - starts[later[0]])
            for index in later:
                starts[index] += behind
    return starts


def agree(before: Stretch, after: Stretch) -> bool:
    """Whether stamps and counts of two stretches of a session have the same time between them."""
    counted, stamped = time_apart(before, after)
    return abs(stamped - counted) <= CLOCK_STEP + CLOCK_ERROR * abs(counted)


@dataclass(frozen=True, slots=True)
class SharedTime:
    """Time that two stretches of one unit hold under different sessions."""

    before: int
    """Place of the one that began first."""
    after: int
    """Place of the other one."""
    start_ns: int
    end_ns: int


def shared_times(stretches: Sequence[Stretch]) -> list[SharedTime]:
    """Return what stretches of other files hold once more of the time before them.

    Parameters
    ----------
    stretches : sequence of Stretch
        In order of time, of any units.

    Notes
    -----
    Sessions that one recorder wrote part by part share no time: a clock has stepped between them.
    """
    shared = []
    latest: dict[tuple[str, str], tuple[int, int]] = {}  # unit → place of the last one, its end
    for place, stretch in enumerate(stretches):
        n_samples = stretch.next_sample - stretch.first_sample
        end_ns = stretch.start_ns + round(n_samples / stretch.sampling_rate * NANOSECONDS)
        last, last_ns = latest.get(stretch.unit, (place, stretch.start_ns))
        begins_later = stretches[last].start_ns <= stretch.start_ns
        until_ns = min(end_ns, last_ns)
        if (
            begins_later
            and stretches[last].session != stretch.session
            and recording_and_part(stretches[last].path)[0] != recording_and_part(stretch.path)[0]
            and until_ns - stretch.start_ns >= SHORTEST_SHARED * NANOSECONDS
        ):
            shared.append(SharedTime(last, place, stretch.start_ns, until_ns))
        if end_ns > last_ns or not begins_later:
            latest[stretch.unit] = (place, end_ns)
    return shared


def utc_span(start_ns: int, end_ns: int) -> str:
    """Return a stretch of time for people: "2026-02-03 00:07:30 to 00:10:00 UTC (150 s)"."""
    start, end = (datetime.fromtimestamp(each // NANOSECONDS, UTC) for each in (start_ns, end_ns))
    last = end.strftime("%H:%M:%S" if start.date() == end.date() else "%Y-%m-%d %H:%M:%S")
    duration = (end_ns - start_ns) / NANOSECONDS
    return f"{start:%Y-%m-%d %H:%M:%S} to {last} UTC ({duration:.0f} s)"


def _since(before: Stretch, after: Stretch) -> int:
    """Time between the first samples of two stretches of a boot [ns]."""
    if agree(before, after):
        return after.start_ns - before.start_ns
    return round(time_apart(before, after)[0] * NANOSECONDS)


def _boots(stretches: Sequence[Stretch]) -> list[list[int]]:
    """Stretches of each boot, by their first samples: their clocks agree or they join."""
    by_session: dict[tuple[tuple[str, str], str], list[int]] = defaultdict(list)
    for index, each in enumerate(stretches):
        by_session[each.unit, each.session].append(index)
    found: list[list[int]] = []
    for indices in by_session.values():
        boots: list[list[int]] = []
        for index in sorted(indices, key=lambda i: (stretches[i].first_sample, i)):
            own = _boot_of(stretches, boots, stretches[index])
            if own is None:
                boots.append([index])
            else:
                own.append(index)
        found += boots
    return found


def _boot_of(
    stretches: Sequence[Stretch], boots: Sequence[list[int]], stretch: Stretch
) -> list[int] | None:
    lasts = [(boot, stretches[boot[-1]]) for boot in boots]
    agreeing = [boot for boot, last in lasts if agree(last, stretch)]
    joining = [boot for boot, last in lasts if last.next_sample == stretch.first_sample]
    return next(iter([*agreeing, *joining]), None)


def _recorded_in_parts(
    stretches: Sequence[Stretch], boots: Sequence[list[int]]
) -> Iterable[list[list[int]]]:
    """Yield the boots of a unit that one recorder has written part by part, in its order."""
    found: dict[tuple[Path, tuple[str, str]], list[tuple[tuple[int, int], list[int]]]]
    found = defaultdict(list)
    for boot in boots:
        places = {index: recording_and_part(stretches[index].path) for index in boot}
        first = min(boot, key=lambda index: (places[index][1], index))
        recording, number = places[first]
        found[recording, stretches[first].unit].append(((number, first), boot))
    for numbered in found.values():
        yield [boot for _, boot in sorted(numbered)]


def recording_and_part(path: Path) -> tuple[Path, int]:
    """Return the recording that a file is a part of, and the part's number, from 1."""
    found = _PART.search(path.stem)
    if found is None:
        return path, 1
    return path.with_name(path.stem[: found.start()] + path.suffix), int(found.group(1))
