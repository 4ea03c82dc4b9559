"""What every file of an archive holds, without its samples: the first look at each of them.

file ─► fingerprint of its bytes
     ─► parts: one a session of an acquisition unit, by turbine

Surveys are kept by path, size and time of the last change, all in one file, so that a file's bytes
are hashed once and an unchanged one costs a look at its size and time.
Changed content with an unchanged size and an unchanged time (in nanoseconds) is taken for the same:
recordings are written once.
"""

import glob
import hashlib
import json
import logging
import os
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

from pipeline.archive.access.remote import (
    is_remote,
    on_disk,
    remote_files,
    remote_stamp,
    url_of,
)
from pipeline.archive.store import packed, unpacked
from pipeline.messages import StreamGap
from pipeline.recording.file_order import Stretch, stretch_of
from pipeline.recording.info import RecordingInfo, UnitInfo, salvageable_info
from pipeline.transport.codec import decode, encode
from pipeline.transport.errors import CodecError
from sensors.acquisition.layout import SensorLayout
from sensors.atomic_write import written_whole
from sensors.errors import InputError

logger = logging.getLogger(__name__)

SURVEYS_KIND = "surveys 1"  # of the frame that holds them
UNSAVED = 500  # surveys, or a tenth of all, that an interruption may cost
HASHED_AT_ONCE = 2**20  # that is read of a file at a time for its fingerprint [bytes]


@dataclass(frozen=True, slots=True, kw_only=True)
class Part(UnitInfo):
    """One session of one unit within one file."""

    path: Path
    fingerprint: str
    """Of the whole file."""

    @property
    def n_samples(self) -> int:
        """From the first to the last, missing ones counted."""
        return self.next_sample - self.first_sample

    @property
    def stretch(self) -> Stretch:
        """Where it lies in its session."""
        return stretch_of(self.path, self)


@dataclass(frozen=True, slots=True)
class FileSurvey:
    """What one file holds."""

    path: Path
    fingerprint: str
    parts: tuple[Part, ...]
    """In order of time."""
    layouts: tuple[SensorLayout, ...]
    scenario: tuple[tuple[str, str], ...] = ()
    """It was made under, as `scenario_metadata` has it."""
    damage: str = ""
    """What of it cannot be read; "" where all can."""


def archive_files(patterns: Iterable[str]) -> tuple[Path, ...]:
    """The recordings that patterns, files and folders name, each once, in order of their names.

    Raises InputError for one that names none.
    """
    found: dict[Path, None] = {}
    for pattern in patterns:
        named = _named(pattern)
        if not named:
            raise InputError(
                f"{pattern!r} names no recording; give .mcap files, folders or a pattern in quotes "
                "such as 'archive/**/*.mcap'"
            )
        found |= dict.fromkeys(named)
    return tuple(sorted(found))


def _named(pattern: str) -> list[Path]:
    if is_remote(pattern):
        return remote_files(pattern)
    path = Path(pattern)
    if path.is_file():
        return [path]
    if path.is_dir():
        return sorted(path.rglob("*.mcap"))
    found = (Path(each) for each in glob.glob(pattern, recursive=True))
    # a link to what has gone is kept: that it cannot be read is reported
    return sorted(each for each in found if each.is_file() or not each.exists())


def surveyed(path: Path) -> FileSurvey:
    """Fingerprint, parts and layouts of a file. Raises RecordingError where it cannot be read."""
    with on_disk(path) as file:
        info = replace(salvageable_info(file), path=path)
        fingerprint = fingerprint_of(file)
    parts = [_part(info, unit, fingerprint) for unit in info.units]
    return FileSurvey(
        path=path,
        fingerprint=fingerprint,
        parts=tuple(sorted(parts, key=lambda part: (part.start_ns, part.turbine, part.unit))),
        layouts=info.layouts,
        scenario=tuple(sorted(info.metadata.get("scenario", {}).items())),
        damage=info.damage,
    )


def fingerprint_of(path: Path) -> str:
    """BLAKE2b of a file's bytes, 32 hexadecimal digits."""
    digest = hashlib.blake2b(digest_size=16)
    with path.open("rb") as file:
        while piece := file.read(HASHED_AT_ONCE):
            digest.update(piece)
    return digest.hexdigest()


def _part(info: RecordingInfo, unit: UnitInfo, fingerprint: str) -> Part:
    known = {field.name: getattr(unit, field.name) for field in fields(unit)}
    return Part(**known, path=info.path, fingerprint=fingerprint)


def without_copies(surveys: Sequence[FileSurvey]) -> tuple[list[FileSurvey], list[FileSurvey]]:
    """Files whose bytes no earlier one has, and those that are copies."""
    originals: dict[str, FileSurvey] = {}
    copies = []
    for survey in surveys:
        if survey.fingerprint in originals:
            copies.append(survey)
        else:
            originals[survey.fingerprint] = survey
    return list(originals.values()), copies


class SurveyCache:
    """The surveys of earlier runs, in one file of an archive's results.

        files     path → size, time of the last change, survey
        texts     layouts and scenarios, each once

    Raises OSError, from `close`, where the disk refuses.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self._texts: dict[str, str] = {}
        self._layouts: dict[str, SensorLayout] = {}
        self._files: dict[str, list[Any]] = {}
        self._unsaved = 0
        try:
            kept = dict(unpacked(path.read_bytes()))
            table = json.loads(kept[SURVEYS_KIND])
            self._texts, self._files = dict(table["texts"]), dict(table["files"])
        except (OSError, ValueError, KeyError, TypeError):
            logger.debug("%s holds no surveys", path)  # none yet, or damaged: files are read again

    def get(self, path: Path) -> FileSurvey | None:
        """The survey of a file as it is now; None if there is none."""
        stamp, known = _stamp(path), self._files.get(_name(path))
        if known is None or stamp is None or [*stamp] != known[:2]:
            return None
        try:
            survey = self._survey(path, known[2])
            # one without samples is seldom; earlier versions kept other programs' files as such
            return survey if survey.parts else None
        except (CodecError, ValueError, KeyError, TypeError):
            return None  # of another layout of this file: the recording is read again

    def put(self, path: Path, survey: FileSurvey) -> None:
        """Keep a survey; a disk sees it now and then."""
        stamp = _stamp(path)
        if stamp is not None:
            self._files[_name(path)] = [*stamp, self._entry(survey)]
            self._unsaved += 1
        if self._unsaved >= max(UNSAVED, len(self._files) // 10):
            self.close()

    def close(self) -> None:
        """Write what is new."""
        if self._unsaved:
            table = json.dumps({"texts": self._texts, "files": self._files})
            self._path.parent.mkdir(parents=True, exist_ok=True)
            written_whole(self._path, packed([(SURVEYS_KIND, table.encode())]))
            self._unsaved = 0

    def _entry(self, survey: FileSurvey) -> list[Any]:
        """A survey as JSON holds it: names that many files share stand in `texts`."""
        layouts = [encode(layout).hex() for layout in survey.layouts]
        scenario = json.dumps(survey.scenario)
        return [
            survey.fingerprint,
            self._number(scenario),
            [self._number(layout) for layout in layouts],
            survey.damage,
            [_kept_part(part) for part in survey.parts],
        ]

    def _number(self, text: str) -> str:
        """A short name of a text."""
        name = hashlib.blake2b(text.encode(), digest_size=8).hexdigest()
        self._texts[name] = text
        return name

    def _survey(self, path: Path, entry: list[Any]) -> FileSurvey:
        fingerprint, scenario, layouts, damage, parts = entry
        return FileSurvey(
            path=path,
            fingerprint=fingerprint,
            parts=tuple(_part_of(path, fingerprint, each) for each in parts),
            layouts=tuple(self._layout(name) for name in layouts),
            scenario=tuple((name, text) for name, text in json.loads(self._texts[scenario])),
            damage=damage,
        )

    def _layout(self, name: str) -> SensorLayout:
        if name not in self._layouts:
            self._layouts[name] = decode(SensorLayout, bytes.fromhex(self._texts[name]))
        return self._layouts[name]


def _name(path: Path) -> str:
    return url_of(path) or os.path.abspath(path)


def _stamp(path: Path) -> tuple[int, int] | None:
    """Size [bytes] and time of the last change [ns], behind a URL a tag; None where it is gone."""
    if url := url_of(path):
        return remote_stamp(url)
    try:
        status = os.stat(path)
    except OSError:
        return None
    return status.st_size, status.st_mtime_ns


_KEPT_FIELDS = tuple(
    field.name for field in fields(Part) if field.name not in ("path", "fingerprint", "gaps")
)


def _kept_part(part: Part) -> list[Any]:
    gaps = [[gap.start_ns, gap.end_ns, gap.first_sequence, gap.n_blocks] for gap in part.gaps]
    return [*(getattr(part, name) for name in _KEPT_FIELDS), gaps]


def _part_of(path: Path, fingerprint: str, kept: list[Any]) -> Part:
    *values, gaps = kept
    content = dict(zip(_KEPT_FIELDS, values, strict=True))
    content["missing"] = tuple((first, end) for first, end in content["missing"])
    session = (content["turbine"], content["unit"], content["session"])
    own = tuple(StreamGap(*session, *gap) for gap in gaps)
    return Part(**content, gaps=own, path=path, fingerprint=fingerprint)
