"""Which windows are identified from which samples of which files: one task a file and turbine.

    files      |—— a ——|—— b ——|  gap  |—— c ——|      a and b join, c stands alone
    chains     |—————————————————|     |———————|
    windows    |0|1|2|3|4|5|6|7|8|     |0|1|2|3|      from the chain's first sample
    tasks      a: 0 to 3, with the beginning of b for window 3;  b: 4 to 8;  c: 0 to 3

Blocks that were sent again after a long cut lie in later files, or late in their own: they are
taken from where they are, and read in the order of samples.

A window belongs to the file in which it begins; its task reads on in the files that join. So every
task is independent of the others, and windows lie where one recording of the whole would have them.
Pure functions of what `survey` has seen.
"""

from bisect import bisect_left, bisect_right
from collections import defaultdict, deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise
from pathlib import Path

from pipeline.archive.survey import FileSurvey, Part
from pipeline.messages import StreamGap
from pipeline.oma.settings import OmaSettings
from pipeline.recording.file_order import SharedTime, agree, logical_starts, shared_times
from sensors.acquisition.blocks import NANOSECONDS

JOINT = 0.5  # of a sample, by which the clock of a new session may be off where two parts join


@dataclass(frozen=True, slots=True)
class Piece:
    """Samples of one part that a task reads."""

    path: Path
    unit: str
    session: str
    first_sample: int
    """Of the session: the first that is wanted."""
    end_sample: int
    """One after the last."""
    shift: int
    """To be added to a sample's number in its session: since the task's first."""
    sequence_shift: int
    """The same for blocks."""


@dataclass(frozen=True, slots=True)
class IdentificationTask:
    """The windows of one turbine that begin in one file."""

    path: Path
    """Of that file."""
    fingerprints: tuple[str, ...]
    """Of every file that is read, `before` among them."""
    turbine: str
    layout_ids: tuple[str, ...]
    """Of the blocks."""
    pieces: tuple[Piece, ...]
    """In order of time; () the file is taken as it is."""
    start_ns: int
    end_ns: int
    n_windows: int
    """Complete ones and the one that a chain ends in; 0 where not known before."""
    before: Path | None = None
    """File that the chain comes from: SCADA's last report stands there."""
    in_order: bool = True
    """Whether the pieces hold their samples in order."""

    @property
    def content(self) -> str:
        """What is done with what, wherever the files are."""
        pieces = tuple(replace(piece, path=Path()) for piece in self.pieces)
        before = None if self.before is None else Path()
        return repr(replace(self, path=Path(), pieces=pieces, before=before))


@dataclass(frozen=True, slots=True)
class TurbinePlan:
    """Everything that an archive holds of one turbine."""

    turbine: str
    tasks: tuple[IdentificationTask, ...]
    """In order of time."""
    gaps: tuple[StreamGap, ...]
    """Within chains, in order of time."""
    overlaps: tuple["Overlap", ...] = ()
    """Time that two files hold, in order of time."""


@dataclass(frozen=True, slots=True)
class Overlap:
    """Time that two files hold of one unit, under different sessions."""

    first: Path
    """File that is used."""
    second: Path
    """File whose samples of that time are left out."""
    start_ns: int
    end_ns: int
    used_twice: bool
    """True: nothing is left out."""


@dataclass(frozen=True, slots=True)
class _Link:
    """A part in its chain."""

    part: Part
    first: int  # of its samples that are used, since the chain's start
    end: int

    @property
    def shift(self) -> int:
        """Offset from the session's count of samples to the chain's."""
        return self.end - self.part.next_sample


def parts_by_turbine(surveys: Sequence[FileSurvey]) -> dict[str, list[Part]]:
    """Return the parts of each turbine in order of time, turbines in order of their names."""
    parts: dict[str, list[Part]] = defaultdict(list)
    for survey in surveys:
        for part in survey.parts:
            parts[part.turbine].append(part)
    return {turbine: _in_order(parts[turbine]) for turbine in sorted(parts)}


def _in_order(parts: Sequence[Part]) -> list[Part]:
    """Parts of a turbine by time; those of a boot by its count, whatever its clock says."""
    starts = logical_starts([each.stretch for each in parts])
    by_time = sorted(
        zip(parts, starts, strict=True), key=lambda each: (each[1], each[0].path, each[0].unit)
    )
    return [part for part, _ in by_time]


def turbine_plan(parts: Sequence[Part], settings: OmaSettings) -> TurbinePlan:
    """Return the tasks of one turbine, from its parts in order of time.

    Parameters
    ----------
    parts : sequence of Part
        Of one turbine, in order of time.
    settings : OmaSettings
        With the length of the windows.

    Notes
    -----
    Files of a turbine with several acquisition units are taken one by one: its units are joined on
    one clock within a file, never over files.
    """
    turbine, found = parts[0].turbine, PartsBySample(parts)
    once, shared = used_once(parts)
    joined = len({part.unit for part in parts}) > 1
    if joined:
        tasks = _tasks_of_whole_files(turbine, parts)
    else:
        chains = chains_of(once)
        tasks = [task for chain in chains for task in _tasks_of_chain(chain, settings, found)]
    gaps = sorted(
        {
            gap
            for part in parts
            for gap, missing in zip(part.gaps, part.missing or [None] * len(part.gaps), strict=True)
            if missing is None or not _is_filled(part, missing, found)
        },
        key=lambda gap: gap.start_ns,
    )
    overlaps = tuple(
        Overlap(parts[s.before].path, parts[s.after].path, s.start_ns, s.end_ns, used_twice=joined)
        for s in shared
    )
    return TurbinePlan(turbine, tuple(tasks), tuple(gaps), overlaps)


def used_once(parts: Sequence[Part]) -> tuple[list[Part], list[SharedTime]]:
    """Return parts in order of time without what one before them holds, and what that is."""
    shared = shared_times([part.stretch for part in parts])
    until = {each.after: each.end_ns for each in shared}
    once = [
        _since(part, until[place]) if place in until else part for place, part in enumerate(parts)
    ]
    return [part for part in once if part.n_samples > 0], shared


def _since(part: Part, time_ns: int) -> Part:
    """Return what a part holds from a time on; no samples where that is nothing."""
    left_out = round((time_ns - part.start_ns) / NANOSECONDS * part.sampling_rate)
    start_ns = part.start_ns + round(left_out / part.sampling_rate * NANOSECONDS)
    return replace(part, first_sample=part.first_sample + left_out, start_ns=start_ns)


def _tasks_of_whole_files(turbine: str, parts: Sequence[Part]) -> list[IdentificationTask]:
    by_file: dict[Path, list[Part]] = defaultdict(list)
    for part in parts:
        by_file[part.path].append(part)
    return [
        IdentificationTask(
            path=path,
            fingerprints=(own[0].fingerprint,),
            turbine=turbine,
            layout_ids=tuple(dict.fromkeys(part.layout_id for part in own)),
            pieces=(),
            start_ns=min(part.start_ns for part in own),
            end_ns=max(part.end_ns for part in own),
            n_windows=0,
            in_order=all(part.in_order for part in own),
        )
        for path, own in by_file.items()
    ]


def chains_of(parts: Sequence[Part]) -> list[list[Part]]:
    """Parts of one unit, in order of time, put together where they join without a gap.

    What lies wholly within the part before it, as after a recorder's restart, is left out.
    """
    chains: list[list[Part]] = []
    for part in parts:
        last = chains[-1][-1] if chains else None
        if last is not None and _is_within(part, last):
            continue
        if last is not None and joins(last, part):
            chains[-1].append(part)
        else:
            chains.append([part])
    return chains


def _is_within(part: Part, last: Part) -> bool:
    """Whether a part holds no time that the one before it does not."""
    if part.session != last.session:  # no wrong clock brings one into the midst of the other
        return last.start_ns <= part.start_ns and part.end_ns <= last.end_ns
    held = last.first_sample <= part.first_sample and part.next_sample <= last.next_sample
    return held and (agree(last.stretch, part.stretch) or part.end_ns == last.end_ns)


def joins(before: Part, after: Part) -> bool:
    """Whether a part goes on where the one before it ends.

    In one session the count of samples says it; a new session must begin within half a sample.
    """
    alike = (before.unit, before.layout_id, before.sampling_rate, before.n_channels)
    if alike != (after.unit, after.layout_id, after.sampling_rate, after.n_channels):
        return False
    if before.session == after.session:
        return after.first_sample <= before.next_sample < after.next_sample
    return abs(after.start_ns - before.end_ns) <= JOINT * NANOSECONDS / before.sampling_rate


def _links(chain: Sequence[Part]) -> list[_Link]:
    links = [_Link(chain[0], 0, chain[0].n_samples)]
    for before, part in pairwise(chain):
        first = links[-1].end
        overlap = before.next_sample - part.first_sample if before.session == part.session else 0
        links.append(_Link(part, first, first + part.n_samples - overlap))
    return links


class PartsBySample:
    """The parts of a turbine by their place in their session: which of them may hold a sample.

    An archive of years has some 100 000 parts, and most lack nothing: each gap looks only at the
    parts that reach into it.

    Parameters
    ----------
    parts : sequence of Part
        All of the turbine.
    """

    def __init__(self, parts: Sequence[Part]) -> None:
        by_session: dict[tuple[object, ...], list[tuple[int, Part]]] = defaultdict(list)
        for place, part in enumerate(parts):
            by_session[_session_of(part)].append((place, part))
        self._by_session = {
            session: sorted(held, key=lambda each: each[1].first_sample)
            for session, held in by_session.items()
        }
        self._firsts = {
            session: [part.first_sample for _, part in held]
            for session, held in self._by_session.items()
        }
        self._reached = {  # by this part or one before it
            session: list(accumulate((part.next_sample for _, part in held), max))
            for session, held in self._by_session.items()
        }

    def others(self, part: Part, start: int, stop: int) -> list[Part]:
        """Return parts of the same boot that reach into a range of samples, in their order."""
        session = _session_of(part)
        begin = bisect_right(self._reached[session], start)
        end = bisect_left(self._firsts[session], stop)
        return [
            other
            for _, other in sorted(self._by_session[session][begin:end], key=lambda each: each[0])
            if other is not part
            and other.next_sample > start
            and agree(part.stretch, other.stretch)
        ]


def _session_of(part: Part) -> tuple[object, ...]:
    return (part.unit, part.session, part.layout_id, part.sampling_rate, part.n_channels)


def sent_again(
    part: Part, first: int, end: int, parts: PartsBySample
) -> Iterator[tuple[Part, int, int]]:
    """Yield samples that a part lacks and that were recorded later: part, first, one past the last.

    Parameters
    ----------
    first, end : int
        Of its session: the first sample of the range that is looked at, one after its last.
    parts : PartsBySample
        All of the turbine.
    """
    for lacking, lacking_end in part.missing:
        begin, stop = max(first, lacking), min(end, lacking_end)
        wanted = [(begin, stop)]
        for other in parts.others(part, begin, stop) if begin < stop else ():
            left: list[tuple[int, int]] = []
            for start, stop in wanted:
                held = list(_held(other, start, stop))
                yield from ((other, *each) for each in held)
                left += _without(start, stop, held)
            wanted = left


def _held(part: Part, start: int, stop: int) -> Iterator[tuple[int, int]]:
    """Ranges of samples from `start` to `stop` that a part holds."""
    yield from _without(max(start, part.first_sample), min(stop, part.next_sample), part.missing)


def _without(start: int, stop: int, taken: Iterable[tuple[int, int]]) -> Iterator[tuple[int, int]]:
    """Yield a range without others, which are in order."""
    for first, end in taken:
        if start < min(first, stop):
            yield start, min(first, stop)
        start = max(start, end)
    if start < stop:
        yield start, stop


def _is_filled(part: Part, missing: tuple[int, int], parts: PartsBySample) -> bool:
    """Whether other parts hold all samples of a gap."""
    found = sent_again(part, *missing, parts)
    return sum(end - first for _, first, end in found) == missing[1] - missing[0]


def _tasks_of_chain(
    chain: Sequence[Part], settings: OmaSettings, parts: PartsBySample
) -> Iterator[IdentificationTask]:
    """Yield one task for every file of the chain in which a window begins.

    parts   all of the turbine, with what was sent again
    """
    links = _links(chain)
    rate, n_samples = chain[0].sampling_rate, links[-1].end
    length = round(settings.window_duration * rate)
    windows = deque(_windows(n_samples, length, settings.hop * rate))
    for place, link in enumerate(links):
        own = []
        while windows and windows[0] < link.end:
            own.append(windows.popleft())
        if own:
            end = min(own[-1] + length, n_samples)
            read = _links_before(end, links, place)
            before = chain[place - 1] if place else None
            yield _task(read, own[0], end, parts, n_windows=len(own), before=before)


def _links_before(end: int, links: Sequence[_Link], place: int) -> Sequence[_Link]:
    """Links from a place on that begin before a sample of the chain."""
    stop = place
    while stop < len(links) and links[stop].first < end:
        stop += 1
    return links[place:stop]


def _windows(n_samples: int, length: int, hop: float) -> Iterator[int]:
    """First samples of a chain's windows: the complete ones, then the one that it ends in, if it
    holds samples that no other had. `hop` in samples."""
    index, used = 0, 0
    while (first := round(index * hop)) + length <= n_samples:
        yield first
        index, used = index + 1, first + length
    if used < n_samples:
        yield first


def _task(
    read: Sequence[_Link],
    origin: int,
    end: int,
    parts: PartsBySample,
    *,
    n_windows: int,
    before: Part | None,
) -> IdentificationTask:
    """Return the samples from `origin` to `end` of a chain, each from the part that holds it."""
    of, pieces, blocks = read[0].part, [], 0
    late: list[Piece] = []
    late_parts: list[Part] = []
    for link in read:
        part = link.part
        pieces.append(
            Piece(
                path=part.path,
                unit=part.unit,
                session=part.session,
                first_sample=max(origin, link.first) - link.shift,
                end_sample=min(end, link.end) - link.shift,
                shift=link.shift - origin,
                sequence_shift=blocks - part.first_sequence,
            )
        )
        blocks += part.last_sequence + 1 - part.first_sequence
        own = pieces[-1]
        for other, first, last in sent_again(part, own.first_sample, own.end_sample, parts):
            late.append(replace(own, path=other.path, first_sample=first, end_sample=last))
            late_parts.append(other)
    start = pieces[0].first_sample - of.first_sample
    start_ns = of.start_ns + round(start / of.sampling_rate * NANOSECONDS)
    return IdentificationTask(
        path=of.path,
        fingerprints=tuple(
            part.fingerprint
            for part in (before, *(link.part for link in read), *late_parts)
            if part
        ),
        turbine=of.turbine,
        layout_ids=(of.layout_id,),
        pieces=(*pieces, *late),
        start_ns=start_ns,
        end_ns=start_ns + round((end - origin) / of.sampling_rate * NANOSECONDS),
        n_windows=n_windows,
        before=None if before is None else before.path,
        in_order=not late and all(link.part.in_order for link in read),
    )
