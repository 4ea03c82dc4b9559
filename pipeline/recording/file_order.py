"""In which order stretches of recordings were measured, whatever a unit's clock says, and which
files of a folder are of one session.

boot    | 0 … 1000 | 1000 … 2000 | 2000 … 3000 |     by the count of samples
stamps      2036        2026          2026           set after the first stretch: it moves to 2026
next boot follows the one before it in one recorder's parts, whatever both stamps are

session-20260301T…Z.mcap   session-20260302T…Z.mcap   session.mcap   session.part2.mcap
a replay: not included     live ────────────────────► the same session, started again
"""

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

from pipeline.oma.windows.unit_clock import CLOCK_ERROR
from pipeline.recording.errors import RecordingError
from pipeline.recording.info import UnitInfo
from pipeline.recording.reader import leading_metadata
from pipeline.recording.rotation import RESULTS, next_part, part_of, results_of
from pipeline.recording.writer import Metadata
from sensors.acquisition.blocks import CLOCK_STEP, NANOSECONDS, time_apart

SHORTEST_SHARED = 1.0  # below it clocks of two sessions do not agree [s]

_PART = re.compile(r"\.part(\d+)$")  # as `rotation.part_of` names the parts of one recording
SESSION_FILE = "session.mcap"  # the first part of what `pilewatch run` records
FRESH = "fresh"  # in the metadata's section "run": the session was started with --fresh
_EARLIER = re.compile(  # as `pipeline.run.folder.set_aside` names the files of an earlier start
    rf"{Path(SESSION_FILE).stem}-(?P<date>\d{{8}}T\d{{6}}Z(?:-\d+)?)(?:\.part(?P<part>\d+))?"
    rf"(?:\{RESULTS})?\.mcap"
)
_FROM_FILES = ("replay:", "simulate:")  # how the source of what is no live session begins


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


@dataclass(frozen=True, slots=True)
class _EarlierFile:
    """A part of a start that a later one has set aside."""

    path: Path
    date: str
    """Of its last change, as its name has it."""
    part: int
    metadata: Metadata

    @property
    def epoch(self) -> int | None:
        """Number of the start; None in older recordings."""
        text = self.metadata.get("run", {}).get("epoch", "")
        return int(text) if text.isdigit() else None


def session_in(folder: Path) -> tuple[list[Path], list[Path]]:
    """Files of the session in a folder, its earlier starts included; those of other sessions.

    Both in order of recording; both empty where no session was recorded.
    """
    latest = latest_start(folder)
    starts = _earlier_starts(folder, latest)
    if latest:
        starts.append(latest)
    if not starts:
        return [], []
    first = len(starts) - 1
    while first > 0 and _goes_on(starts[first][0]) and _is_live(starts[first - 1][0]):
        first -= 1
    included = [file for start in starts[first:] for file in start]
    return included, [file for start in starts[:first] for file in start]


def latest_start(path: Path) -> list[Path]:
    """The closed parts of the latest start in a folder, results where samples have gone."""
    first = path / SESSION_FILE
    parts = [part_of(first, number) for number in range(1, next_part(first))]
    return [file for part in parts for file in (part, results_of(part)) if file.exists()]


def _earlier_starts(folder: Path, latest: Sequence[Path]) -> list[list[Path]]:
    """The files of each start that was set aside, oldest first.

    The dates in their names are those of last changes, which samples that have gone renew: the
    starts' own numbers come first. Where the folder's lock was deleted, these begin again.
    """
    found = [
        _EarlierFile(path, match["date"], int(match["part"] or 1), _metadata(path))
        for path in folder.glob("*.mcap")
        if (match := _EARLIER.fullmatch(path.name))
    ]
    places = [(file.epoch, file.part, RESULTS in file.path.name) for file in found]
    numbered = None not in {file.epoch for file in found} and len(set(places)) == len(places)
    if numbered and latest:
        newest = _EarlierFile(latest[0], "", 1, _metadata(latest[0])).epoch
        numbered = newest is not None and all((file.epoch or 0) < newest for file in found)
    if numbered:
        found.sort(key=lambda file: (file.epoch or 0, file.part, file.date))
    else:
        found.sort(key=lambda file: (file.date, file.part))
    starts: list[list[Path]] = []
    before: _EarlierFile | None = None
    for file in found:
        same = before is not None and before.epoch == file.epoch and before.part <= file.part
        if same and (file.part > 1 or RESULTS in file.path.name):
            starts[-1].append(file.path)
        else:
            starts.append([file.path])
        before = file
    return starts


def _metadata(file: Path) -> Metadata:
    """What is known of a recording before it is read; nothing of one that is damaged there."""
    try:
        return leading_metadata(file)
    except RecordingError:
        return {}


def _is_live(file: Path) -> bool:
    source = _metadata(file).get("pilewatch", {}).get("source", "")
    return bool(source) and not source.startswith(_FROM_FILES)


def _goes_on(file: Path) -> bool:
    """Whether its session went on from what the one before it in the folder had left."""
    return _is_live(file) and FRESH not in _metadata(file).get("run", {})
