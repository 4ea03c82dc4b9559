"""The files of one session: their names, what a crash left of them, and what may go.

session.mcap  session.part2.mcap  session.part3.mcap.active     the last is being written
session.results.mcap                                            once its samples had to go

session-20260301T…Z.mcap   session-20260302T…Z.mcap   session.mcap   session.part2.mcap
a replay: not included     live ────────────────────► the same session, started again
"""

import logging
import os
import re
import struct
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode

from pipeline.recording.errors import RecordingError
from pipeline.recording.mcap_file import MCAP_MAGIC, complete_records, open_recording
from pipeline.recording.reader import decoded, leading_metadata, read_metadata, recorded_messages
from pipeline.recording.settings import RecordingSettings
from pipeline.recording.writer import ACTIVE_SUFFIX, Metadata, whole_recording
from sensors.acquisition.blocks import NANOSECONDS, AccelerationBlock
from sensors.atomic_write import sync_folder
from sensors.constants import DAY

logger = logging.getLogger(__name__)

PICTURE_SUFFIX = ".rrd"  # how the names of the viewer's files end
RESULTS = ".results"
SESSION_FILE = "session.mcap"  # the first part of what `pilewatch run` records
FRESH = "fresh"  # in the metadata's section "run": the session was started with --fresh
_EARLIER = re.compile(  # as `pipeline.run.folder.set_aside` names the files of an earlier start
    rf"{Path(SESSION_FILE).stem}-(?P<date>\d{{8}}T\d{{6}}Z(?:-\d+)?)(?:\.part(?P<part>\d+))?"
    rf"(?:\{RESULTS})?\.mcap"
)
_FROM_FILES = ("replay:", "simulate:")  # how the source of what is no live session begins
_HEAD = struct.Struct("<BQ")  # opcode, length of what follows [bytes]
# Data end without a checksum, footer without a summary. Source: https://mcap.dev/spec
_ENDING = (
    _HEAD.pack(Opcode.DATA_END, 4)
    + bytes(4)
    + _HEAD.pack(Opcode.FOOTER, 20)
    + bytes(20)
    + MCAP_MAGIC
)


def part_of(path: Path, number: int) -> Path:
    """Return the file that a session's recording goes on in; the first is `path` itself."""
    return path if number == 1 else path.with_name(f"{path.stem}.part{number}{path.suffix}")


def next_part(path: Path) -> int:
    """Number of the first part of which there is no file yet."""
    number = 1
    while is_taken(path, number):
        number += 1
    return number


def is_taken(path: Path, number: int) -> bool:
    """Whether there is a file of the part of that number: finished, in writing or its results."""
    part = part_of(path, number)
    files = (part, part.with_name(part.name + ACTIVE_SUFFIX), results_of(part))
    return any(file.exists() for file in files)


def parts_of(path: Path) -> list[Path]:
    """Return the closed parts of one recording that still hold samples, in order of recording."""
    numbered = range(1, next_part(path))
    return [part for number in numbered if (part := part_of(path, number)).exists()]


def results_of(part: Path) -> Path:
    """Return where the results of a part stay when its samples have gone."""
    return part.with_name(f"{part.stem}{RESULTS}{part.suffix}")


def repeats_part(file: Path) -> bool:
    """Whether a file has the results of a part that is still there: a kill came before that went.

    The part's metadata are in it: dates in the names of two starts could be the same.
    """
    part = _part_of_results(file)
    if part is None or not (part.exists() and file.exists()):
        return False
    return _metadata(file) == _metadata(part)


def _part_of_results(file: Path) -> Path | None:
    """Path of the part that a file has the results of, by its name; None for another file."""
    ending = f"{RESULTS}{file.suffix}"
    if not file.name.endswith(ending):
        return None
    return file.with_name(file.name.removesuffix(ending) + file.suffix)


def close_leftovers(path: Path) -> Iterator[Path]:
    """Give every part that a killed recorder left behind its ending and its name.

    Yields the files that are whole now. What is no recording at all is left as it is; results of a
    part that is still there, whole or not, are removed: they are made again when it has to go.
    """
    for active in sorted(path.parent.glob(f"{path.stem}*{path.suffix}{ACTIVE_SUFFIX}")):
        try:
            part = _part_of_results(active.with_name(active.name.removesuffix(ACTIVE_SUFFIX)))
            if part is not None and part.exists():
                active.unlink()
            else:
                yield closed_in_place(active)
        except (RecordingError, OSError) as error:
            logger.warning("%s stays as it is: %s", active, error)
    for results in path.parent.glob(f"{path.stem}*{RESULTS}{path.suffix}"):
        if repeats_part(results):
            results.unlink()


def closed_in_place(active: Path) -> Path:
    """Cut an unfinished recording after its last complete record and end it there.

    Needs no room on the disk beyond what the cut record had. Returns its new path. Raises
    RecordingError where it is no recording or its name is taken, OSError where the disk refuses.
    """
    whole = active.with_name(active.name.removesuffix(ACTIVE_SUFFIX))
    if whole.exists():
        raise RecordingError(f"{whole} exists already")
    with open_recording(active) as file:
        end = _end_of_records(file)
    with active.open("r+b") as file:
        file.truncate(end)
        file.seek(end)
        file.write(_ENDING)
        file.flush()
        os.fsync(file.fileno())
    active.rename(whole)
    sync_folder(whole.parent)
    return whole


def _end_of_records(file: object) -> int:
    end = len(MCAP_MAGIC)
    for record in complete_records(file):  # type: ignore[arg-type]
        if record.opcode == Opcode.DATA_END or not 0 < record.opcode <= Opcode.DATA_END:
            break  # zeros, where the machine itself went down, are no record
        end = record.offset + _HEAD.size + len(record.content)
    return end


def thin(path: Path, settings: RecordingSettings, now_ns: int, *, needed: int = 0) -> list[Path]:
    """Let the oldest samples go, results kept, until age and size are within the settings.

    Parameters
    ----------
    path : Path
        Of the recording's first part; files of earlier sessions beside it count too.
    settings : RecordingSettings
        Days and gigabytes that are kept.
    now_ns : int
        [ns since 1970-01-01 UTC].
    needed : int, optional
        Free at least so many bytes, where the settings allow any deletion.

    Returns
    -------
    list of Path
        The parts that went. Each is replaced by its results before it goes.

    Notes
    -----
    Pictures of past days, which can be drawn again from the samples, go by age, too, and before any
    sample where there is no room.
    """
    if not settings.may_delete:
        return []
    needed -= _without_pictures(path, settings.keep_days, now_ns, needed)
    return _without_samples(raw_files(path), settings, now_ns, needed)


def _without_samples(
    parts: Sequence[Path], settings: RecordingSettings, now_ns: int, needed: int
) -> list[Path]:
    """Replace parts by their results, the oldest first, until what is left is within the settings;
    gives those that have gone. One that cannot be replaced stays and counts."""
    gone: list[Path] = []
    files = {part: part.stat() for part in parts}
    total = sum(stat.st_size for stat in files.values())
    for part in sorted(files, key=lambda each: files[each].st_mtime_ns):
        age = _age(files[part], now_ns)
        if age <= settings.keep_days and total <= settings.keep_gigabytes * 1e9 and needed <= 0:
            break
        results = keep_results(part)
        if results is not None:
            total -= files[part].st_size
            needed -= files[part].st_size - results.stat().st_size
            gone.append(part)
    return gone


def _without_pictures(path: Path, keep_days: float, now_ns: int, needed: int) -> int:
    """Delete the viewer's files that are too old or in the way, but for the one in writing; gives
    how much room that made [bytes]."""
    found = {each: each.stat() for each in path.parent.glob(f"{path.stem}*{PICTURE_SUFFIX}")}
    *past, _ = sorted(found, key=lambda each: found[each].st_mtime_ns) or [path]
    freed = 0
    for each in past:
        if freed >= needed and _age(found[each], now_ns) <= keep_days:
            break
        each.unlink()
        freed += found[each].st_size
        logger.warning("the pictures in %s have gone; `pilewatch show` draws them again", each)
    return freed


def _age(stat: os.stat_result, now_ns: int) -> float:
    """[d]"""
    return (now_ns - stat.st_mtime_ns) / NANOSECONDS / DAY


def raw_files(path: Path) -> list[Path]:
    """Closed recordings with samples of this and earlier sessions of the folder."""
    found = path.parent.glob(f"{path.stem}*{path.suffix}")
    return [each for each in found if not each.stem.endswith(RESULTS)]


def keep_results(part: Path) -> Path | None:
    """Replace a part by its results, a recording without acceleration blocks.

    Returns the path of that; None where the part is kept whole: it is damaged, or there is no room.
    """
    results = results_of(part)
    results.with_name(results.name + ACTIVE_SUFFIX).unlink(missing_ok=True)  # left by a kill
    if repeats_part(results):
        results.unlink()
    try:
        with whole_recording(results, metadata=read_metadata(part)) as recorder:
            for recorded in recorded_messages(part):
                if recorded.message_type is not AccelerationBlock:
                    message = decoded(part, recorded)
                    recorder.record(message, recorded.log_time, recorded.publish_time)
    except RecordingError as error:
        logger.warning("%s is kept whole: %s", part, error)
        return None
    part.unlink()
    logger.warning("the samples of %s have gone; its results are in %s", part, results)
    return results


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
    either = [part if part.exists() else results_of(part) for part in parts]
    return [file for file in either if file.exists()]


def _earlier_starts(folder: Path, latest: Sequence[Path]) -> list[list[Path]]:
    """The files of each start that was set aside, oldest first.

    The dates in their names are those of last changes, which samples that have gone renew: the
    starts' own numbers come first. Where the folder's lock was deleted, these begin again.
    """
    found = [
        _EarlierFile(path, match["date"], int(match["part"] or 1), _metadata(path))
        for path in folder.glob("*.mcap")
        if (match := _EARLIER.fullmatch(path.name)) and not repeats_part(path)
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
